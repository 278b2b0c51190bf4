"""
Drivers whose hardware is the rig simulator on the other end of a loopback TCP socket.

All numbers are little-endian. A driver sends numbers (float64): the channel that it wants, then
the set points of the drive, m/s. The simulator sends records of 32 bytes::

    sequence int64 | stamp int64, ns | value float64, m or rad | speed float64, m/s

`sequence` counts the records sent on the connection: a driver that sees it jump knows how many
samples it has lost; -1: another driver holds the drive. `value` is the angle of the roller for
the drive, which alone has a `speed`.
"""

from __future__ import annotations

import contextlib
import socket
import struct
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from hunt_ros.drivers.base import DriveBlock, DriveDriver, Driver, SensorBlock, SensorDriver
from hunt_ros.errors import DriverError
from hunt_ros.settings import Settings, setting

RECORD = np.dtype([('sequence', '<i8'), ('stamp_ns', '<i8'), ('value', '<f8'), ('speed', '<f8')])
#: What a driver sends.
NUMBER = struct.Struct('<d')
#: Sequence number of the one record that says that the drive is taken.
TAKEN = -1
_RECEIVE_BYTES = 1 << 16
_CONNECT_S = 1.0
#: Who claims to have lost more records at once is no rig simulator.
_MOST_LOST = 1 << 32


class Channel(IntEnum):
    """What a driver asks for."""

    LATERAL = 0
    YAW = 1
    DRIVE = 2


@dataclass(frozen=True)
class SimulatorAddress(Settings):
    """Where the rig simulator listens."""

    host: str = setting('127.0.0.1', 'Address of the rig simulator.')
    port: int = setting(47100, 'TCP port of the rig simulator.', low=1, high=65535)


class _Simulated(Driver):
    """A connection to one channel of the simulator."""

    Settings = SimulatorAddress
    settings: SimulatorAddress
    _wanted = Channel.DRIVE

    def open(self) -> None:
        """Connect; raises DriverError where nobody answers."""
        address = (self.settings.host, self.settings.port)
        try:
            connection = socket.create_connection(address, timeout=_CONNECT_S)
        except OSError as error:
            raise DriverError(f'{self}: cannot connect ({error})') from error
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.handle, self._pending, self._received = connection, b'', 0
        self._send(self._wanted)

    def _receive(self, timeout_s: float) -> tuple[NDArray[np.void], int]:
        """Return the records of one receive, and how many were lost."""
        connection = self.opened()
        connection.settimeout(max(timeout_s, 1e-3))
        try:
            data = connection.recv(_RECEIVE_BYTES)
        except TimeoutError:
            return np.zeros(0, RECORD), 0
        except OSError as error:
            raise DriverError(f'{self}: connection lost ({error})') from error
        if not data:
            raise DriverError(f'{self}: the simulator closed the connection')
        data = self._pending + data
        whole = len(data) // RECORD.itemsize * RECORD.itemsize
        records, self._pending = np.frombuffer(data[:whole], RECORD), data[whole:]
        if not records.size:
            return records, 0
        if records['sequence'][0] == TAKEN:
            raise DriverError(f'{self}: another speed node holds the drive')
        after = int(records['sequence'][-1]) + 1
        lost, self._received = after - self._received - records.size, after
        if not 0 <= lost < _MOST_LOST:
            raise DriverError(f'{self}: not the rig simulator, it sends {data[:16]!r}')
        return records, lost

    def _send(self, number: float) -> None:
        connection = self.opened()
        try:
            connection.sendall(NUMBER.pack(number))
        except OSError as error:
            raise DriverError(f'{self}: connection lost ({error})') from error

    def _release(self, handle: socket.socket) -> None:
        with contextlib.suppress(OSError):  # the other end may have gone first
            handle.shutdown(socket.SHUT_RDWR)
        handle.close()

    def __str__(self) -> str:
        where = f'{self.settings.host}:{self.settings.port}'
        return f'rig simulator {self._wanted.name.lower()} at {where}'


class Sensor(_Simulated, SensorDriver):
    """A sensor of the simulated rig."""

    channels = ('lateral', 'yaw')

    def __init__(self, settings: SimulatorAddress, channel: str, rate_hz: float) -> None:
        super().__init__(settings, channel, rate_hz)
        self._wanted = Channel[channel.upper()]

    def read(self, timeout_s: float) -> SensorBlock:
        """Wait for samples; raises DriverError when the connection is lost."""
        records, lost = self._receive(timeout_s)
        return SensorBlock(records['stamp_ns'], records['value'], lost)


class Drive(_Simulated, DriveDriver):
    """The drive of the simulated rig."""

    def read(self, timeout_s: float) -> DriveBlock:
        """Wait for readings; raises DriverError when the connection is lost."""
        records, _ = self._receive(timeout_s)
        return DriveBlock(records['stamp_ns'], records['value'], records['speed'])

    def set_speed(self, speed_mps: float) -> None:
        """Command a running speed, m/s; raises DriverError when the connection is lost."""
        self._send(speed_mps)
