"""Several nodes in one process: each with its own parameters, and ended in order."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState

from hunt_ros.bag import Bag, read_columns
from hunt_ros.cli.support.suite import start_nodes
from hunt_ros.cli.support.supervisor import Supervisor

pytestmark = pytest.mark.ros

NODES = ('bag_recorder', 'rig_simulator', 'lateral_sensor', 'yaw_sensor', 'roller_speed')


@pytest.mark.slow
def test_nodes_of_one_process_have_their_own_parameters_and_close_their_recording(graph) -> None:
    folder = graph.folder / 'recordings'
    rate = {'port': graph.port, 'sample_rate_hz': 250.0}
    parameters = dict.fromkeys(NODES[1:-1], rate)
    parameters |= {
        'roller_speed': {'port': graph.port},
        'bag_recorder': {'directory': str(folder)},
    }
    health = graph.collect(DiagnosticArray, '/diagnostics')
    samples = graph.collect(JointState, 'lateral')
    with Supervisor('rig', graph.folder / 'logs', private=False, keep=False) as processes:
        start_nodes(processes, NODES, {}, parameters, one_process=True)
        assert list(processes.pids()) == ['roller_speed', 'suite'], 'a guard is alone'
        graph.spin_until(lambda: len(samples) > 200, 60.0)
        names = {f'rig/{name}' for name in NODES}
        graph.spin_until(lambda: names <= {m.status[0].name for m in health})
        full_names = {f'/{name}' for name in names}
        graph.spin_until(
            lambda: full_names <= described(folder), 60.0
        )  # one asked after the other
        assert processes.look() == []
        log = processes.logs / 'suite.log'
    assert 'Traceback' not in log.read_text()
    (bag,) = folder.glob('hunt_*')
    assert bag.suffix != '.active', 'the recording is closed'
    recorded = read_columns(bag, {'y': '/rig/lateral.position[0]'})['y']
    assert recorded.rate_hz == pytest.approx(250.0, rel=0.05)
    first = samples[0].header.stamp
    heard = {s.header.stamp.sec * 10**9 + s.header.stamp.nanosec for s in samples}
    late = recorded.stamps_ns >= first.sec * 10**9 + first.nanosec
    assert heard <= set(recorded.stamps_ns[late].tolist()), 'nothing that others heard is lost'
    assert full_names <= described(folder)


def described(folder: Path) -> set[str]:
    """Return the nodes whose parameters are in the one recording, open or closed."""
    (bag,) = folder.glob('hunt_*')
    with Bag(bag) as opened:
        return set(opened.strings('parameters'))


def test_the_executable_of_several_nodes_asks_which() -> None:
    words = [sys.executable, '-m', 'hunt_ros.nodes.entry']
    ran = subprocess.run(words, capture_output=True, text=True)
    assert ran.returncode == 2
    (line,) = ran.stderr.splitlines()
    assert 'bag_recorder' in line
