"""The sensor node: real sockets, real subscribers, and one driver on a device."""

from __future__ import annotations

import itertools
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from made import install_driver
from sensor_msgs.msg import JointState

from hunt_ros.drivers.simulated import Channel
from hunt_ros.drivers.simulator_server import SimulatorServer
from hunt_ros.nodes.support.conversions import to_ns


class Wire:
    """A simulator's server, the lateral sensor that reads it, and what that publishes."""

    def __init__(self, graph) -> None:
        self.server = SimulatorServer('127.0.0.1', graph.port)
        self.heard = graph.collect(JointState, 'lateral')
        self.sensor = graph.start('lateral_sensor', port=graph.port)
        graph.spin_until(lambda: self.server.poll() is None and self.server.readers == 1)
        graph.spin_until(self._is_heard)

    def _is_heard(self) -> bool:
        """Send a sample now and then: what comes before the node is ready is thrown away."""
        if not self.heard:
            self.send(np.array([10]))
        return bool(self.heard)

    def send(self, stamps: np.ndarray) -> None:
        self.server.send(Channel.LATERAL, stamps, 1e-9 * (stamps % 10**9))

    def stamps(self, first: int = 0) -> list[int]:
        """Return the stamps that were heard, from the first one on."""
        stamps = (to_ns(message.header.stamp) for message in self.heard)
        return [stamp for stamp in stamps if stamp >= first]


@pytest.fixture
def wire(graph) -> Iterator[Wire]:
    wire = Wire(graph)
    yield wire
    wire.server.close()


def test_every_sample_is_published_with_the_stamp_of_the_driver(graph, wire) -> None:
    stamps = 1_700_000_000_000_000_000 + 1_000_000 * np.arange(500)
    for block in np.split(stamps, 50):
        wire.send(block)
    graph.spin_until(lambda: wire.stamps()[-1] == stamps[-1])
    assert wire.stamps(stamps[0]) == stamps.tolist()
    values = [message.position[0] for message in wire.heard[-500:]]
    assert values == (1e-9 * (stamps % 10**9)).tolist()
    assert wire.heard[0].name == ['lateral']


def test_a_stopped_sensor_leaves_its_backlog_out_and_is_well_again_a_second_later(
    graph, wire
) -> None:
    health = graph.told()
    wire.sensor.send_signal(signal.SIGSTOP)
    graph.spin(1.0)
    for first in range(1000, 5000, 100):
        wire.send(np.arange(first, first + 100))
        graph.spin(0.02)
    graph.spin(0.5)
    wire.sensor.send_signal(signal.SIGCONT)
    graph.spin_until(lambda: health.says('samples lost'))
    numbers = itertools.count(100_001)
    health.clear()

    def fresh() -> bool:
        wire.send(np.array([next(numbers)]))
        return any(one['level'] != 'STALE' and 'lost' not in one['message'] for one in health)

    graph.spin_until(fresh)
    late = [stamp for stamp in wire.stamps(1000) if stamp < 100_000]
    assert not late, 'old samples come too late for everybody'


ABSENT = """
import time

from hunt_ros.drivers.base import SensorDriver
from hunt_ros.errors import DriverError
from hunt_ros.settings import Settings


class Sensor(SensorDriver):
    Settings = Settings

    def open(self):
        with open('tried', 'a') as file:
            print(time.monotonic(), file=file)
        raise DriverError('it is not there')

    def read(self, timeout_s):
        raise DriverError('it is not there')

    def close(self):
        pass
"""


def test_hardware_that_is_not_there_is_tried_again_less_and_less_often(
    graph, tmp_path, monkeypatch
) -> None:
    """Three waits of 0.5, 1 and 2 s; without a back-off they would be 0.75 s together."""
    install_driver(tmp_path, 'absent', ABSENT)
    monkeypatch.setenv('PYTHONPATH', f'{Path(__file__).parents[2]}{os.pathsep}{tmp_path}')
    monkeypatch.chdir(tmp_path)
    graph.start('lateral_sensor', driver='absent')
    tried = tmp_path / 'tried'
    graph.spin_until(lambda: tried.exists() and tried.read_text().count('\n') == 4)
    times_s = [float(line) for line in tried.read_text().split()][:4]
    assert times_s[-1] - times_s[0] > 2.5
