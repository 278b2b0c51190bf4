"""
The frames between the rig simulator and its drivers, on a loopback TCP socket.

Every frame is a 16-byte header and `count` records, all little-endian::

    header   magic b'HR' | version u8 | kind u8 | count u32 | sequence u64
    record   float64 x columns of the kind

===========  ====  ======================================  =====================
kind         code  record                                  direction
===========  ====  ======================================  =====================
SUBSCRIBE    1     channel: 0 lateral, 1 yaw, 2 drive      driver -> simulator
SENSOR       2     stamp (int64, ns), value (m or rad)     simulator -> driver
DRIVE        3     stamp (int64, ns), angle (rad), m/s     simulator -> driver
SET_SPEED    4     running speed, m/s                      driver -> simulator
TAKEN        5     channel, held by another driver         simulator -> driver
===========  ====  ======================================  =====================

The drive has one driver: who subscribes to it beside another gets TAKEN, and the
connection is closed.

`sequence` counts the records sent on the connection before this frame: a
driver that sees it jump knows how many samples it has lost.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from hunt_ros.errors import DriverError

VERSION = 1
HEADER = struct.Struct('<2sBBIQ')
_MAGIC = b'HR'
_MOST_RECORDS = 1 << 16


class Kind(IntEnum):
    """Kind of a frame."""

    SUBSCRIBE = 1
    SENSOR = 2
    DRIVE = 3
    SET_SPEED = 4
    TAKEN = 5


class Channel(IntEnum):
    """What a driver subscribes to."""

    LATERAL = 0
    YAW = 1
    DRIVE = 2


RECORDS: dict[Kind, np.dtype[np.void]] = {
    Kind.SUBSCRIBE: np.dtype([('channel', '<f8')]),
    Kind.SENSOR: np.dtype([('stamp_ns', '<i8'), ('value', '<f8')]),
    Kind.DRIVE: np.dtype([('stamp_ns', '<i8'), ('angle', '<f8'), ('speed', '<f8')]),
    Kind.SET_SPEED: np.dtype([('speed', '<f8')]),
    Kind.TAKEN: np.dtype([('channel', '<f8')]),
}


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame: its kind, the sequence number of its first record, its records."""

    kind: Kind
    sequence: int
    records: NDArray[np.void]


def encode(kind: Kind, sequence: int, *columns: NDArray[np.float64] | float) -> bytes:
    """
    Make a frame of the columns of its kind, in their order.

    Parameters
    ----------
    kind : Kind
        Kind of frame.
    sequence : int
        Records sent before on this connection.
    *columns : ndarray or float
        One for each column of the record, of one length.
    """
    layout = RECORDS[kind]
    records = np.empty(np.size(columns[0]), dtype=layout)
    for name, column in zip(layout.names or (), columns, strict=True):
        records[name] = column
    return HEADER.pack(_MAGIC, VERSION, kind, records.size, sequence) + records.tobytes()


class Decoder:
    """Cuts a stream of bytes, in whatever pieces it comes, into frames."""

    def __init__(self) -> None:
        self._pending = bytearray()

    def feed(self, data: bytes) -> Iterator[Frame]:
        """
        Add bytes; iterate over the frames that are complete now.

        Raises
        ------
        DriverError
            If the bytes are no frames of this version.
        """
        self._pending += data
        while len(self._pending) >= HEADER.size:
            magic, version, code, count, sequence = HEADER.unpack_from(self._pending)
            if magic != _MAGIC or version != VERSION or code not in RECORDS:
                raise DriverError(
                    f'not the rig simulator: frame starts with {bytes(self._pending[:4])!r},'
                    f' expected {_MAGIC + bytes([VERSION])!r} and a kind from 1 to 5'
                )
            if count > _MOST_RECORDS:
                raise DriverError(f'rig simulator: frame claims {count} records')
            layout = RECORDS[Kind(code)]
            end = HEADER.size + count * layout.itemsize
            if len(self._pending) < end:
                return
            records = np.frombuffer(bytes(self._pending[HEADER.size : end]), dtype=layout)
            del self._pending[:end]
            yield Frame(Kind(code), sequence, records)
