"""The simulator's server and its drivers on a real loopback socket."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator

import numpy as np
import pytest

from hunt_ros.drivers.simulated import Channel, Drive, Sensor, SimulatorAddress
from hunt_ros.drivers.simulator_server import SimulatorServer
from hunt_ros.errors import DriverError


@pytest.fixture
def server() -> Iterator[SimulatorServer]:
    server = SimulatorServer()
    yield server
    server.close()


@pytest.fixture
def until(server: SimulatorServer, machine):
    """Return what lets the server work until something is so."""

    def wait(wanted=lambda speed: server.readers == 1) -> None:
        machine.until(lambda: wanted(server.poll()))

    return wait


def test_a_sensor_receives_its_own_channel_only(server: SimulatorServer, until) -> None:
    sensor = Sensor(SimulatorAddress(port=server.port), 'yaw', 500.0)
    sensor.open()
    until()
    server.send(Channel.LATERAL, np.array([1]), np.array([9.0]))
    server.send(Channel.YAW, np.array([10, 20]), np.array([0.5, np.nan]))
    block = sensor.read(2.0)
    assert block.stamps_ns.tolist() == [10, 20]
    assert block.values[0] == 0.5
    assert np.isnan(block.values[1])
    assert block.lost == 0
    sensor.close()


def test_the_drive_reads_and_takes_a_set_point(server: SimulatorServer, until) -> None:
    drive = Drive(SimulatorAddress(port=server.port), 0.3)
    drive.open()
    until()
    server.send(Channel.DRIVE, np.array([5]), np.array([1.5]), np.array([7.25]))
    block = drive.read(2.0)
    assert (block.stamps_ns[0], block.angle_rad[0], block.speed_mps[0]) == (5, 1.5, 7.25)
    drive.set_speed(6.5)
    until(lambda speed: speed == 6.5)
    drive.close()


def test_a_slow_reader_loses_samples_and_is_told_how_many(server: SimulatorServer, until) -> None:
    sensor = Sensor(SimulatorAddress(port=server.port), 'lateral', 500.0)
    sensor.open()
    until()
    sent = 0
    for _ in range(4000):
        stamps = np.arange(sent, sent + 500)
        server.send(Channel.LATERAL, stamps, stamps * 1.0)
        sent += stamps.size
    received, lost = 0, 0
    for _ in range(2000):
        block = sensor.read(0.02)
        received += block.values.size
        lost += block.lost
        if not block.values.size:
            if received + lost == sent:
                break
            server.send(Channel.LATERAL, np.array([sent]), np.array([0.0]))
            sent += 1
    assert lost > 0
    assert received + lost == sent
    sensor.close()


def test_a_simulator_that_goes_away_is_a_driver_error(server: SimulatorServer, until) -> None:
    sensor = Sensor(SimulatorAddress(port=server.port), 'lateral', 500.0)
    sensor.open()
    until()
    server._drop(server._clients[0])
    with pytest.raises(DriverError, match='closed the connection'):
        sensor.read(2.0)


@pytest.mark.parametrize(
    'data', [b'HTTP/1.1 200 OK, and what else comes', b'\0' * 7 + b'\x7f' * 9]
)
def test_foreign_bytes_are_refused_by_both_ends(
    server: SimulatorServer, until, data: bytes
) -> None:
    with socket.create_server(('127.0.0.1', 0)) as foreign:
        sensor = Sensor(SimulatorAddress(port=foreign.getsockname()[1]), 'yaw', 500.0)
        sensor.open()
        connection, _ = foreign.accept()
        with connection:
            for part in (data[:5], data[5:] + 20 * b'x'):
                connection.sendall(part)
            with pytest.raises(DriverError, match='not the rig simulator'):
                any(sensor.read(2.0).values.size for _ in range(10))
        sensor.close()
    with socket.create_connection(('127.0.0.1', server.port), timeout=5.0) as connection:
        connection.sendall(data)
        connection.setblocking(False)

        def ended(_: object) -> bool:
            with contextlib.suppress(BlockingIOError):
                return connection.recv(1) == b''
            return False

        until(ended)


def test_a_drive_has_one_master(server: SimulatorServer, until) -> None:
    first, second = (Drive(SimulatorAddress(port=server.port), 0.3) for _ in range(2))
    for drive in (first, second):
        drive.open()
        until(lambda _: server.readers == 1 and len(server._clients) == 1)
    with pytest.raises(DriverError, match='another speed node holds the drive'):
        second.read(2.0)
    first.close()
    second.close()
