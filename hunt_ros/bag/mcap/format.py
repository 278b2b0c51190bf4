"""
The MCAP container as bytes: opcodes, fixed layouts, packing and unpacking of records.

Source: MCAP specification, version 0 (mcap.dev/spec). Everything read is bounded
by the bytes at hand; what does not fit raises `ValueError`, which the callers turn
into a `BagError` with the file and the place.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import NamedTuple

MAGIC = b'\x89MCAP0\r\n'

HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, STATISTICS, METADATA, METADATA_INDEX = 0x09, 0x0B, 0x0C, 0x0D
SUMMARY_OFFSET, DATA_END = 0x0E, 0x0F

#: Opcode and length in front of each record.
RECORD = struct.Struct('<BQ')
#: channel, sequence, log time, publish time; the message's own bytes follow.
MESSAGE_HEAD = struct.Struct('<HIQQ')
#: From the start of a message record to the message's own bytes.
MESSAGE_PREFIX = RECORD.size + MESSAGE_HEAD.size
#: first and last log time, uncompressed size, CRC, length of the compression's name.
CHUNK_HEAD = struct.Struct('<QQQII')
#: Magic, footer record and its 20 bytes at the end of a complete file.
FOOTER_SIZE = RECORD.size + 20 + len(MAGIC)

_U16, _U32, _U64 = struct.Struct('<H'), struct.Struct('<I'), struct.Struct('<Q')
_STATISTICS = struct.Struct('<QHIIIIQQ')


class Schema(NamedTuple):
    """A message type: its name, and its definition as text."""

    id: int
    name: str
    encoding: str
    text: str


class Channel(NamedTuple):
    """A topic as MCAP knows it."""

    id: int
    schema: int
    topic: str
    encoding: str
    metadata: dict[str, str]


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


class ChunkIndex(NamedTuple):
    """What the summary says about a chunk."""

    first_ns: int
    last_ns: int
    offset: int
    length: int
    index_offsets: dict[int, int]
    index_length: int
    compression: str
    stored: int
    size: int


class Statistics(NamedTuple):
    """Counts of the whole file."""

    messages: int
    schemas: int
    channels: int
    attachments: int
    metadata: int
    chunks: int
    first_ns: int
    last_ns: int
    per_channel: dict[int, int]


class Fields:
    """Reads one field after the other, and never behind the end."""

    def __init__(self, data: bytes | memoryview) -> None:
        self._data = memoryview(data)
        self.position = 0

    def take(self, count: int) -> memoryview:
        """Return the next `count` bytes; `ValueError` where there are fewer."""
        end = self.position + count
        if end > len(self._data):
            raise ValueError(f'a field of {count} bytes reaches behind its record')
        part = self._data[self.position : end]
        self.position = end
        return part

    def u16(self) -> int:
        """Return an unsigned 16-bit number."""
        return int(_U16.unpack(self.take(2))[0])

    def u32(self) -> int:
        """Return an unsigned 32-bit number."""
        return int(_U32.unpack(self.take(4))[0])

    def u64(self) -> int:
        """Return an unsigned 64-bit number."""
        return int(_U64.unpack(self.take(8))[0])

    def text(self) -> str:
        """Return a length-prefixed UTF-8 string."""
        return str(self.take(self.u32()), 'utf-8')

    def text_map(self) -> dict[str, str]:
        """Return a length-prefixed map of strings."""
        inner = Fields(self.take(self.u32()))
        result = {}
        while inner.position < len(inner._data):
            key = inner.text()
            result[key] = inner.text()
        return result

    def number_map(self) -> dict[int, int]:
        """Return a length-prefixed map of 16-bit to 64-bit numbers."""
        inner = self.take(self.u32())
        if len(inner) % 10:
            raise ValueError(f'a map of {len(inner)} bytes is no multiple of 10')
        return dict(struct.iter_unpack('<HQ', inner))


def parse_schema(payload: bytes | memoryview) -> Schema:
    """Unpack a schema record."""
    fields = Fields(payload)
    key, name, encoding = fields.u16(), fields.text(), fields.text()
    return Schema(key, name, encoding, str(fields.take(fields.u32()), 'utf-8', 'replace'))


def parse_channel(payload: bytes | memoryview) -> Channel:
    """Unpack a channel record."""
    fields = Fields(payload)
    return Channel(fields.u16(), fields.u16(), fields.text(), fields.text(), fields.text_map())


def parse_chunk(head: bytes | memoryview, offset: int, length: int) -> Chunk:
    """
    Unpack the head of a chunk.

    Parameters
    ----------
    head : bytes
        The first bytes of the payload: 64 are enough for every known compression.
    offset : int
        File offset of the chunk record.
    length : int
        Length of its payload, as the record claims it.
    """
    if len(head) < CHUNK_HEAD.size + 8:
        raise ValueError(f'a chunk of {len(head)} bytes has no room for its head')
    first, last, size, crc, name_length = CHUNK_HEAD.unpack_from(head)
    if name_length > 16:
        raise ValueError(f'the name of the compression is {name_length} bytes long')
    fields = Fields(head[CHUNK_HEAD.size :])
    compression = str(fields.take(name_length), 'utf-8')
    stored = fields.u64()
    before = CHUNK_HEAD.size + name_length + 8
    if stored != length - before:
        raise ValueError(f'a chunk of {length} bytes claims to hold {stored}')
    return Chunk(offset, first, last, size, crc, compression, offset + 9 + before, stored)


def parse_chunk_index(payload: bytes | memoryview) -> ChunkIndex:
    """Unpack a chunk index record of the summary."""
    fields = Fields(payload)
    first, last, offset, length = (fields.u64() for _ in range(4))
    offsets, index_length = fields.number_map(), fields.u64()
    return ChunkIndex(
        first,
        last,
        offset,
        length,
        offsets,
        index_length,
        fields.text(),
        fields.u64(),
        fields.u64(),
    )


def parse_statistics(payload: bytes | memoryview) -> Statistics:
    """Unpack the statistics record of the summary."""
    fields = Fields(payload)
    numbers = _STATISTICS.unpack(fields.take(_STATISTICS.size))
    return Statistics._make((*numbers, fields.number_map()))


def parse_metadata(payload: bytes | memoryview) -> tuple[str, dict[str, str]]:
    """Unpack a metadata record: its name and its strings."""
    fields = Fields(payload)
    return fields.text(), fields.text_map()


def record(opcode: int, *parts: bytes) -> bytes:
    """Pack a record."""
    payload = b''.join(parts)
    return RECORD.pack(opcode, len(payload)) + payload


def text(value: str) -> bytes:
    """Pack a length-prefixed UTF-8 string."""
    raw = value.encode('utf-8')
    return _U32.pack(len(raw)) + raw


def text_map(values: Mapping[str, str]) -> bytes:
    """Pack a map of strings."""
    raw = b''.join(text(key) + text(value) for key, value in values.items())
    return _U32.pack(len(raw)) + raw


def number_map(values: Mapping[int, int]) -> bytes:
    """Pack a map of 16-bit to 64-bit numbers."""
    raw = b''.join(struct.pack('<HQ', key, value) for key, value in values.items())
    return _U32.pack(len(raw)) + raw


def schema_record(schema: Schema) -> bytes:
    """Pack a schema."""
    raw = schema.text.encode('utf-8')
    head = _U16.pack(schema.id) + text(schema.name) + text(schema.encoding)
    return record(SCHEMA, head, _U32.pack(len(raw)), raw)


def channel_record(channel: Channel) -> bytes:
    """Pack a channel."""
    head = struct.pack('<HH', channel.id, channel.schema)
    return record(
        CHANNEL, head, text(channel.topic), text(channel.encoding), text_map(channel.metadata)
    )


def chunk_index_record(index: ChunkIndex) -> bytes:
    """Pack a chunk index."""
    head = struct.pack('<QQQQ', index.first_ns, index.last_ns, index.offset, index.length)
    sizes = struct.pack('<QQ', index.stored, index.size)
    middle = number_map(index.index_offsets) + _U64.pack(index.index_length)
    return record(CHUNK_INDEX, head, middle, text(index.compression), sizes)


def statistics_record(statistics: Statistics) -> bytes:
    """Pack the statistics."""
    return record(
        STATISTICS, _STATISTICS.pack(*statistics[:8]), number_map(statistics.per_channel)
    )
