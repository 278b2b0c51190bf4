"""A node says at once what it is doing, and ends at a signal whatever it is doing."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

pytest.importorskip('rclpy', reason='the extra ros is not installed')
pytestmark = pytest.mark.ros

#: The promise, s, of a quick idle machine.
SAYS_S, ENDS_S = 2.0, 2.0


def text(graph, node: str) -> str:
    return graph.log(node).read_text()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_node_that_imports_says_so_and_ends_without_a_traceback(graph, number) -> None:
    graph.start('hunting_detector')
    graph.spin_until(lambda: text(graph, 'hunting_detector'), SAYS_S)
    assert graph.end('hunting_detector', number, ENDS_S) == 0
    lines = text(graph, 'hunting_detector').splitlines()
    assert lines[0] == 'hunting_detector: starting'
    # Where the import is over within the notice, the node ends by itself and has nothing to say.
    assert set(lines[1:]) <= {'hunting_detector: ended while starting'}


def test_a_node_that_compiles_says_so_and_ends(graph, monkeypatch) -> None:
    pytest.importorskip('numba', reason='the extra fast is not installed')
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(graph.folder / 'empty'))
    graph.start('hunting_detector')
    said = 'hunting_detector: compiling kernels, once: about'
    graph.spin_until(lambda: said in text(graph, 'hunting_detector'), 30.0)
    graph.spin(3.0)  # into the compiler, which lets the main thread go seldom
    assert graph.end('hunting_detector', signal.SIGINT, ENDS_S) == 0
    assert 'Traceback' not in text(graph, 'hunting_detector')


def test_a_node_that_waits_for_its_hardware_ends(graph) -> None:
    graph.start('roller_speed', port=graph.port)  # where nobody answers
    graph.spin_until(
        lambda: ('roller_speed', '/rig') in graph.node.get_node_names_and_namespaces()
    )
    assert graph.end('roller_speed', signal.SIGTERM, ENDS_S) == 0


def test_a_recorder_that_runs_closes_its_recording(graph) -> None:
    graph.start('bag_recorder')
    graph.spin_until(lambda: list(graph.folder.glob('recordings/*.active')))
    assert graph.end('bag_recorder', signal.SIGTERM, ENDS_S) == 0
    assert not list(graph.folder.glob('recordings/*.active'))


#: Prints what is compiled beside that which `hunt compile` has compiled.
_COVERED = """
import gc
from numba.core.dispatcher import Dispatcher
from hunt_ros.cli.main import main

def known():
    mine = [d for d in gc.get_objects() if isinstance(d, Dispatcher)
            and d.py_func.__module__.startswith('hunt_ros.')]
    return {(d.py_func.__qualname__, str(s)) for d in mine for s in d.signatures}

assert main(['compile']) == 0
before = known()
from hunt_ros.detection import DetectorConfig, HuntingDetector
from hunt_ros.detection.offline import detect
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation.roller_rig import RollerRig
from hunt_ros.dynamics.simulation import Kick, SimulationSettings, SpeedProfile, simulate

settings = SimulationSettings(sample_rate_hz=100.0, initial_speed=7.2)
RollerRig(paper_rig(), settings, seed=1).advance(100)
profile = SpeedProfile((0.0, 30.0), (7.2, 7.2))
record = simulate(paper_rig(), settings, profile, kicks=[Kick(10.0, lateral_m=3e-4)], seed=1)
form = IdentifiedNormalForm(PAPER_NORMAL_FORM)
detect(HuntingDetector(DetectorConfig(), form), record)
detect(HuntingDetector(DetectorConfig(channels=('lateral', 'speed'))), record)
print('NEW', sorted(known() - before))
"""


def test_what_make_install_compiles_is_what_the_nodes_use() -> None:
    pytest.importorskip('numba', reason='the extra fast is not installed')
    words = [sys.executable, '-c', _COVERED]
    ran = subprocess.run(words, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.splitlines()[-1] == 'NEW []'
