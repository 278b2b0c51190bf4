"""Drivers whose hardware is the rig simulator on the other end of a loopback socket."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hunt_ros.drivers.base import DriveBlock, DriveDriver, Driver, SensorBlock, SensorDriver
from hunt_ros.drivers.simulator_protocol import Channel, Decoder, Frame, Kind, encode
from hunt_ros.errors import DriverError
from hunt_ros.settings import Settings, setting

_RECEIVE_BYTES = 1 << 16
_CONNECT_S = 1.0


@dataclass(frozen=True)
class SimulatorAddress(Settings):
    """Where the rig simulator listens."""

    host: str = setting('127.0.0.1', 'Address of the rig simulator.', fixed=True)
    port: int = setting(47100, 'TCP port of the rig simulator.', low=1, high=65535, fixed=True)


class _Connection:
    """A subscription to one channel of the simulator."""

    def __init__(self, address: SimulatorAddress, channel: Channel) -> None:
        self._address = (address.host, address.port)
        self._channel = channel
        self._socket: socket.socket | None = None
        self._decoder = Decoder()
        self._received = 0

    def open(self) -> None:
        """Connect."""
        try:
            connection = socket.create_connection(self._address, timeout=_CONNECT_S)
        except OSError as error:
            raise DriverError(f'{self}: cannot connect ({error})') from error
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket, self._decoder, self._received = connection, Decoder(), 0
        self.send(encode(Kind.SUBSCRIBE, 0, float(self._channel)))

    def frames(self, timeout_s: float) -> Iterator[tuple[Frame, int]]:
        """Iterate over the frames of one receive, each with the records lost before it."""
        connection = self._opened()
        connection.settimeout(max(timeout_s, 1e-3))
        try:
            data = connection.recv(_RECEIVE_BYTES)
        except TimeoutError:
            return
        except OSError as error:
            raise DriverError(f'{self}: connection lost ({error})') from error
        if not data:
            raise DriverError(f'{self}: the simulator closed the connection')
        for frame in self._decoder.feed(data):
            if frame.kind is Kind.TAKEN:
                raise DriverError(f'{self}: another speed node holds the drive')
            lost = frame.sequence - self._received
            self._received = frame.sequence + frame.records.size
            yield frame, lost

    def send(self, data: bytes) -> None:
        """Send a frame."""
        connection = self._opened()
        try:
            connection.sendall(data)
        except OSError as error:
            raise DriverError(f'{self}: connection lost ({error})') from error

    def close(self) -> None:
        """Close the socket; a read under way in another thread ends."""
        if self._socket is not None:
            connection, self._socket = self._socket, None
            with contextlib.suppress(OSError):  # the other end may have gone first
                connection.shutdown(socket.SHUT_RDWR)
            connection.close()

    def _opened(self) -> socket.socket:
        connection = self._socket  # another thread may close it meanwhile
        if connection is None:
            raise DriverError(f'{self}: not open')
        return connection

    def __str__(self) -> str:
        host, port = self._address
        return f'rig simulator {self._channel.name.lower()} at {host}:{port}'


class _Simulated(Driver):
    """What both have: a connection."""

    Settings = SimulatorAddress
    _connection: _Connection

    def open(self) -> None:
        """Connect; raises DriverError where nobody answers."""
        self._connection.open()

    def close(self) -> None:
        """Disconnect."""
        self._connection.close()

    def __str__(self) -> str:
        return str(self._connection)


class Sensor(_Simulated, SensorDriver):
    """A sensor of the simulated rig."""

    channels = ('lateral', 'yaw')

    def __init__(self, settings: SimulatorAddress, channel: str, rate_hz: float) -> None:
        super().__init__(settings, channel, rate_hz)
        self._connection = _Connection(settings, Channel[channel.upper()])

    def read(self, timeout_s: float) -> SensorBlock:
        """Wait for samples; raises DriverError when the connection is lost."""
        received = list(self._connection.frames(timeout_s))
        if not received:
            return SensorBlock()
        records = np.concatenate([frame.records for frame, _ in received])
        lost = sum(lost for _, lost in received)
        return SensorBlock(records['stamp_ns'], records['value'], lost)


class Drive(_Simulated, DriveDriver):
    """The drive of the simulated rig."""

    def __init__(self, settings: SimulatorAddress, roller_diameter_m: float) -> None:
        super().__init__(settings, roller_diameter_m)
        self._connection = _Connection(settings, Channel.DRIVE)

    def read(self, timeout_s: float) -> DriveBlock:
        """Wait for readings; raises DriverError when the connection is lost."""
        received = [frame.records for frame, _ in self._connection.frames(timeout_s)]
        if not received:
            return DriveBlock()
        records = np.concatenate(received)
        return DriveBlock(records['stamp_ns'], records['angle'], records['speed'])

    def set_speed(self, speed_mps: float) -> None:
        """Command a running speed, m/s; raises DriverError when the connection is lost."""
        self._connection.send(encode(Kind.SET_SPEED, 0, speed_mps))
