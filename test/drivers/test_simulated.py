"""The simulator's server and its drivers on a real loopback socket."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.drivers.simulated import Drive, Sensor, SimulatorAddress
from hunt_ros.drivers.simulator_protocol import HEADER, Channel, Decoder, Kind, encode
from hunt_ros.drivers.simulator_server import SimulatorServer
from hunt_ros.errors import DriverError


@pytest.fixture
def server() -> Iterator[SimulatorServer]:
    server = SimulatorServer()
    yield server
    server.close()


def _poll_until(server: SimulatorServer, wanted) -> None:
    deadline = time.monotonic() + 5.0
    while not wanted(server.poll()):
        assert time.monotonic() < deadline, 'the server saw nothing'


def _connected(server: SimulatorServer) -> bool:
    return server.readers == 1


def test_a_sensor_receives_its_own_channel_only(server: SimulatorServer) -> None:
    sensor = Sensor(SimulatorAddress(port=server.port), 'yaw', 500.0)
    sensor.open()
    _poll_until(server, lambda _: _connected(server))
    server.send_sensor(Channel.LATERAL, np.array([1]), np.array([9.0]))
    server.send_sensor(Channel.YAW, np.array([10, 20]), np.array([0.5, np.nan]))
    block = sensor.read(2.0)
    assert block.stamps_ns.tolist() == [10, 20]
    assert block.values[0] == 0.5
    assert np.isnan(block.values[1])
    assert block.lost == 0
    sensor.close()


def test_the_drive_reads_and_takes_a_set_point(server: SimulatorServer) -> None:
    drive = Drive(SimulatorAddress(port=server.port), 0.3)
    drive.open()
    _poll_until(server, lambda _: _connected(server))
    server.send_drive(np.array([5]), np.array([1.5]), np.array([7.25]))
    block = drive.read(2.0)
    assert (block.stamps_ns[0], block.angle_rad[0], block.speed_mps[0]) == (5, 1.5, 7.25)
    drive.set_speed(6.5)
    _poll_until(server, lambda speed: speed == 6.5)
    drive.close()


def test_a_slow_reader_loses_samples_and_is_told_how_many(server: SimulatorServer) -> None:
    sensor = Sensor(SimulatorAddress(port=server.port), 'lateral', 500.0)
    sensor.open()
    _poll_until(server, lambda _: _connected(server))
    sent = 0
    for _ in range(4000):
        stamps = np.arange(sent, sent + 500)
        server.send_sensor(Channel.LATERAL, stamps, stamps * 1.0)
        sent += stamps.size
    received, lost = 0, 0
    for _ in range(2000):
        block = sensor.read(0.02)
        received += block.values.size
        lost += block.lost
        if not block.values.size:
            if received + lost == sent:
                break
            server.send_sensor(Channel.LATERAL, np.array([sent]), np.array([0.0]))
            sent += 1
    assert lost > 0
    assert received + lost == sent
    sensor.close()


def test_nobody_listening_is_one_clear_line() -> None:
    server = SimulatorServer()
    port = server.port
    server.close()
    sensor = Sensor(SimulatorAddress(port=port), 'lateral', 500.0)
    with pytest.raises(DriverError, match=rf'lateral at 127\.0\.0\.1:{port}: cannot connect'):
        sensor.open()


def test_a_simulator_that_goes_away_is_a_driver_error(server: SimulatorServer) -> None:
    sensor = Sensor(SimulatorAddress(port=server.port), 'lateral', 500.0)
    sensor.open()
    _poll_until(server, lambda _: _connected(server))
    server._drop(server._clients[0])
    with pytest.raises(DriverError, match='closed the connection'):
        sensor.read(2.0)


@given(cuts=st.lists(st.integers(1, 40), max_size=60))
def test_frames_survive_any_cutting_of_the_stream(cuts: list[int]) -> None:
    stream = encode(Kind.SENSOR, 0, np.arange(3), np.arange(3.0)) + encode(Kind.SET_SPEED, 3, 7.0)
    decoder, frames, start = Decoder(), [], 0
    for length in [*cuts, len(stream)]:
        frames += list(decoder.feed(stream[start : start + length]))
        start += length
    assert [frame.kind for frame in frames] == [Kind.SENSOR, Kind.SET_SPEED]
    assert frames[0].records['value'].tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize('data', [b'HTTP/1.1 200 OK\r\n', HEADER.pack(b'HR', 1, 2, 1 << 30, 0)])
def test_foreign_bytes_are_refused_not_waited_for(data: bytes) -> None:
    with pytest.raises(DriverError):
        list(Decoder().feed(data))
