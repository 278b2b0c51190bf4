"""
The records of an MCAP file: packed and unpacked by the package mcap, within bounds.

Source: MCAP specification, version 0 (mcap.dev/spec). Everything read is bounded
by the bytes at hand; what does not fit raises `ValueError`, which the callers turn
into a `BagError` with the file and the place.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import Any, NamedTuple, TypeVar

from mcap import records as peer
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode

from hunt_ros.bag.blocks import expand

MAGIC = b'\x89MCAP0\r\n'

#: Opcode and length in front of each record.
RECORD = struct.Struct('<BQ')
#: channel, sequence, log time, publish time; the message's own bytes follow.
MESSAGE_HEAD = struct.Struct('<HIQQ')
#: From the start of a message record to the message's own bytes.
MESSAGE_PREFIX = RECORD.size + MESSAGE_HEAD.size
#: Magic, footer record and its 20 bytes at the end of a complete file.
FOOTER_SIZE = RECORD.size + 20 + len(MAGIC)

MESSAGE, CHUNK = int(Opcode.MESSAGE), int(Opcode.CHUNK)

_Kind = TypeVar('_Kind', bound=peer.McapRecord)


class _Bounded(ReadDataStream):
    """Reads one field after the other without a copy, and never behind the end."""

    def __init__(self, data: bytes | memoryview) -> None:
        self._data = memoryview(data)
        self._count = 0

    def read(self, length: int) -> Any:
        """Return the next bytes; raises ValueError where there are not so many."""
        end = self._count + length
        if end > len(self._data):
            raise ValueError(f'a field of {length} bytes reaches behind its record')
        part = self._data[self._count : end]
        self._count = end
        return part


class Chunk(NamedTuple):
    """The head of a chunk, and where its bytes lie in the file."""

    offset: int
    first_ns: int
    last_ns: int
    size: int
    crc: int
    compression: str
    data: int
    stored: int

    @property
    def end(self) -> int:
        """File offset just behind the chunk record."""
        return self.data + self.stored


def unpack(kind: type[_Kind], payload: bytes | memoryview) -> _Kind:
    """Unpack a record of the package mcap; `ValueError` where the payload does not hold it."""
    found: _Kind = kind.read(_Bounded(payload))  # type: ignore[attr-defined]
    return found


def unpack_chunk(data: bytes | memoryview, offset: int, length: int) -> Chunk:
    """
    Unpack the head of the chunk record at a place, of which the end may be missing.

    Raises
    ------
    ValueError
        If it is no chunk, or claims another size than its record has.
    """
    head = _Bounded(memoryview(data)[offset + RECORD.size : offset + RECORD.size + length])
    first, last, size, crc = head.read8(), head.read8(), head.read8(), head.read4()
    compression = str(head.read(head.read4()), 'utf-8')
    stored = head.read8()
    if stored != length - head.count:
        raise ValueError(f'a chunk of {length} bytes claims to hold {stored}')
    start = offset + RECORD.size + head.count
    return Chunk(offset, first, last, size, crc, compression, start, stored)


def expand_chunk(data: bytes | memoryview, chunk: Chunk) -> bytes | memoryview:
    """
    Return the records of a chunk.

    Raises
    ------
    ValueError
        If it cannot be expanded, or its CRC is wrong.
    """
    stored = memoryview(data)[chunk.data : chunk.end]
    raw = expand(stored, chunk.compression, chunk.size)
    if chunk.crc and zlib.crc32(raw) != chunk.crc:
        raise ValueError('its CRC does not fit its bytes')
    return raw


def pack(*records: peer.McapRecord) -> bytes:
    """Pack records one behind the other."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    packed: bytes = builder.end()  # type: ignore[no-untyped-call]
    return packed


def records(data: bytes | memoryview, start: int, end: int) -> Iterator[tuple[int, int, int]]:
    """
    Yield (opcode, offset, payload length) of each complete record in [start, end).

    Raises
    ------
    ValueError
        At a record that reaches behind `end`.
    """
    position = start
    while position < end:
        if position + 9 > end:
            raise ValueError(f'{end - position} bytes at byte {position} are no record')
        opcode, length = RECORD.unpack_from(data, position)
        if position + 9 + length > end:
            raise ValueError(
                f'cut short: the record at byte {position} claims {length} bytes,'
                f' {end - position - 9} are there'
            )
        yield opcode, position, length
        position += 9 + length


def summary_records(data: memoryview) -> list[tuple[int, memoryview]]:
    """
    Return (opcode, payload) of the records of the summary section; none without one.

    Raises
    ------
    ValueError
        If the file does not end as a complete one does, or its summary is damaged.
    """
    size = len(data)
    footer = size - FOOTER_SIZE
    if footer < len(MAGIC) or data[size - 8 : size] != MAGIC:
        raise ValueError('the file does not end as a complete MCAP file does')
    opcode, length = RECORD.unpack_from(data, footer)
    if opcode != Opcode.FOOTER or length != 20:
        raise ValueError('the footer is damaged')
    found = unpack(peer.Footer, data[footer + RECORD.size : size - 8])
    start = found.summary_start
    if start == 0:
        return []
    if not len(MAGIC) <= start < footer:
        raise ValueError(f'the summary is said to be at byte {start}, behind the end')
    # The CRC covers the summary and the footer up to the CRC itself.
    if found.summary_crc and zlib.crc32(data[start : size - 12]) != found.summary_crc:
        raise ValueError('the CRC of the summary does not fit')
    return [
        (opcode, data[offset + 9 : offset + 9 + length])
        for opcode, offset, length in records(data, start, footer)
    ]
