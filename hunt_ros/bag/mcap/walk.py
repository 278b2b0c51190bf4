"""
Finding the way in an MCAP file: by its summary, by its indexes, or record by record.

Functions on the bytes of a file; what does not fit raises `ValueError`.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from hunt_ros.bag.blocks import Places, Topic
from hunt_ros.bag.compression import expand
from hunt_ros.bag.mcap import format as fmt

#: Where the (log time, offset) pairs of a topic stand in the file, and how many they are.
IndexPlace: TypeAlias = tuple[int, int]

#: Bytes of one entry of a message index.
ENTRY_BYTES = 16


class NotIndexedError(ValueError):
    """
    A sound file whose summary leaves out where the messages are, as MCAP allows.

    Attributes
    ----------
    counts : dict of int to int, or None
        Messages by topic id that were written; None where the summary does not say.
    """

    def __init__(self, reason: str, counts: dict[int, int] | None = None) -> None:
        super().__init__(reason)
        self.counts = counts


@dataclass
class Walk:
    """
    What was found in a file.

    Attributes
    ----------
    chunks : list of Chunk
        In the order of the file.
    indexes : dict
        By chunk offset: topic id -> IndexPlace. A chunk missing here has no index and
        is walked when it is read.
    loose : dict of int to Places
        Messages that stand outside of chunks, by topic id.
    metadata_places : list of (offset, bytes, name)
        Of the metadata records; where a file was walked.
    end : int
        File offset behind the last complete record.
    problem : str
        Why a walk ended before the end of the file; '' where it did not.
    """

    schemas: dict[int, fmt.Schema] = field(default_factory=dict)
    channels: dict[int, fmt.Channel] = field(default_factory=dict)
    chunks: list[fmt.Chunk] = field(default_factory=list)
    indexes: dict[int, dict[int, IndexPlace]] = field(default_factory=dict)
    loose: dict[int, Places] = field(default_factory=dict)
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    metadata_places: list[tuple[int, int, str]] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    end: int = 0
    problem: str = ''

    def topics(self) -> list[Topic]:
        """Return the channels with their schemas, as topics."""
        none = fmt.Schema(0, '', '', '')
        result = []
        for channel in self.channels.values():
            schema = self.schemas.get(channel.schema, none)
            result.append(
                Topic(
                    channel.id,
                    channel.topic,
                    schema.name,
                    channel.encoding,
                    schema.encoding,
                    schema.text,
                )
            )
        return result

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """First and last log time over chunks and loose messages, ns."""
        filled = [chunk for chunk in self.chunks if chunk.size]
        firsts = [chunk.first_ns for chunk in filled]
        lasts = [chunk.last_ns for chunk in filled]
        for places in self.loose.values():
            firsts.append(int(places.log_ns.min()))
            lasts.append(int(places.log_ns.max()))
        return (min(firsts), max(lasts)) if firsts and sum(self.counts.values()) else None


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
        opcode, length = fmt.RECORD.unpack_from(data, position)
        if position + 9 + length > end:
            raise ValueError(
                f'cut short: the record at byte {position} claims {length} bytes,'
                f' {end - position - 9} are there'
            )
        yield opcode, position, length
        position += 9 + length


def read_summary(data: bytes | memoryview) -> Walk:
    """
    Read the summary section, and check that it agrees with the chunks it names.

    Raises
    ------
    NotIndexedError
        If there is none, or it does not tell where the messages are.
    ValueError
        If it is damaged.
    """
    size = len(data)
    footer = size - fmt.FOOTER_SIZE
    if footer < len(fmt.MAGIC) or data[size - 8 : size] != fmt.MAGIC:
        raise ValueError('the file does not end as a complete MCAP file does')
    opcode, length = fmt.RECORD.unpack_from(data, footer)
    fields = fmt.Fields(data[footer + 9 : size - 8])
    start, _, crc = fields.u64(), fields.u64(), fields.u32()
    if opcode != fmt.FOOTER or length != 20:
        raise ValueError('the footer is damaged')
    if start == 0:
        raise NotIndexedError('it has no summary section')
    if not len(fmt.MAGIC) <= start < footer:
        raise ValueError(f'the summary is said to be at byte {start}, behind the end')
    # The CRC covers the summary and the footer up to the CRC itself.
    if crc and zlib.crc32(data[start : size - 12]) != crc:
        raise ValueError('the CRC of the summary does not fit')
    walk = Walk(end=size)
    statistics: fmt.Statistics | None = None
    try:
        for opcode, offset, length in records(data, start, footer):
            payload = memoryview(data)[offset + 9 : offset + 9 + length]
            if opcode == fmt.STATISTICS:
                statistics = fmt.parse_statistics(payload)
            elif opcode == fmt.CHUNK_INDEX:
                _add_indexed_chunk(walk, data, fmt.parse_chunk_index(payload))
            elif opcode == fmt.METADATA_INDEX:
                _add_indexed_metadata(walk, data, payload)
            else:
                _add_description(walk, opcode, payload)
    except UnicodeDecodeError as error:
        raise ValueError('a name in the summary is not UTF-8') from error
    _check_summary(walk, statistics)
    return walk


def _check_summary(walk: Walk, statistics: fmt.Statistics | None) -> None:
    """Refuse a summary that does not name every chunk, message and topic."""
    indexed: Counter[int] = Counter()
    for places in walk.indexes.values():
        for channel, (_, count) in places.items():
            indexed[channel] += count
    if statistics is None:
        raise NotIndexedError('the summary has no statistics')
    counted = {key: count for key, count in statistics.per_channel.items() if count}
    reason = ''
    if statistics.chunks != len(walk.chunks):
        reason = f'the summary names {len(walk.chunks)} of {statistics.chunks} chunks'
    elif counted != dict(indexed):
        reason = 'the message indexes do not hold as many messages as were written'
    elif not set(indexed) <= set(walk.channels):
        reason = 'the summary does not describe every topic'
    if reason:
        raise NotIndexedError(reason, counted)
    walk.counts = indexed
    walk.chunks.sort(key=lambda chunk: chunk.offset)


def _add_indexed_chunk(walk: Walk, data: bytes | memoryview, index: fmt.ChunkIndex) -> None:
    """Take a chunk from the summary; what stands at its place must be that chunk."""
    if index.offset + index.length + index.index_length > len(data) or index.length < 9:
        raise ValueError(f'a chunk is said to be at byte {index.offset}, behind the end')
    opcode, length = fmt.RECORD.unpack_from(data, index.offset)
    if opcode != fmt.CHUNK or length + 9 != index.length:
        raise ValueError(f'there is no chunk at byte {index.offset}')
    head = data[index.offset + 9 : index.offset + 9 + min(length, 64)]
    chunk = fmt.parse_chunk(head, index.offset, length)
    # The summary and the chunk must tell one story: the summary alone is not trusted.
    if (chunk.first_ns, chunk.last_ns, chunk.size) != (index.first_ns, index.last_ns, index.size):
        raise ValueError(f'the summary contradicts the chunk at byte {index.offset}')
    if chunk.last_ns >= 1 << 63:
        raise ValueError(f'the chunk at byte {index.offset} has an impossible time')
    walk.chunks.append(chunk)
    walk.indexes[chunk.offset] = {
        channel: _index_place(data, offset, channel)
        for channel, offset in index.index_offsets.items()
    }


def _index_place(data: bytes | memoryview, offset: int, channel: int) -> IndexPlace:
    """Return where the entries of a message index begin, byte, and how many there are."""
    if offset + 15 > len(data):
        raise ValueError(f'a message index is said to be at byte {offset}, behind the end')
    opcode, length = fmt.RECORD.unpack_from(data, offset)
    if opcode != fmt.MESSAGE_INDEX or length < 6 or offset + 9 + length > len(data):
        raise ValueError(f'there is no message index at byte {offset}')
    fields = fmt.Fields(data[offset + 9 : offset + 15])
    found, size = fields.u16(), fields.u32()
    if found != channel or size != length - 6 or size % ENTRY_BYTES:
        raise ValueError(f'the message index at byte {offset} is damaged')
    return offset + 15, size // ENTRY_BYTES


def _add_indexed_metadata(walk: Walk, data: bytes | memoryview, payload: memoryview) -> None:
    offset = fmt.Fields(payload).u64()
    if offset + 9 > len(data):
        raise ValueError(f'metadata is said to be at byte {offset}, behind the end')
    opcode, length = fmt.RECORD.unpack_from(data, offset)
    if opcode == fmt.METADATA and offset + 9 + length <= len(data):
        walk.metadata.append(fmt.parse_metadata(data[offset + 9 : offset + 9 + length]))


def _add_description(walk: Walk, opcode: int, payload: bytes | memoryview) -> None:
    if opcode == fmt.SCHEMA:
        schema = fmt.parse_schema(payload)
        walk.schemas[schema.id] = schema
    elif opcode == fmt.CHANNEL:
        channel = fmt.parse_channel(payload)
        walk.channels[channel.id] = channel


def walk_file(data: bytes | memoryview) -> Walk:
    """
    Walk a file from the front, as far as it is whole.

    Chunks are opened only where their topics are not known from elsewhere. The last
    chunk of a file that was cut is not among them: see `hunt_ros.bag.repair`.
    """
    walk = Walk(end=len(fmt.MAGIC))
    loose: dict[int, list[tuple[int, int, int]]] = {}
    view = memoryview(data)
    last: fmt.Chunk | None = None
    try:
        for opcode, offset, length in records(data, walk.end, len(data)):
            payload = view[offset + 9 : offset + 9 + length]
            if opcode == fmt.CHUNK:
                last = _add_walked_chunk(walk, payload, offset, length)
            elif opcode == fmt.MESSAGE_INDEX and last is not None:
                _add_walked_index(walk, last, payload, offset)
            elif opcode == fmt.MESSAGE:
                if length < fmt.MESSAGE_HEAD.size:
                    raise ValueError(f'the message at byte {offset} has no head')
                channel, _, log_ns, _ = fmt.MESSAGE_HEAD.unpack_from(payload)
                place = (log_ns, offset + fmt.MESSAGE_PREFIX, length - fmt.MESSAGE_HEAD.size)
                loose.setdefault(channel, []).append(place)
            elif opcode == fmt.METADATA:
                walk.metadata.append(fmt.parse_metadata(payload))
                walk.metadata_places.append((offset, 9 + length, walk.metadata[-1][0]))
            elif opcode in (fmt.DATA_END, fmt.FOOTER):
                break
            else:
                _add_description(walk, opcode, payload)
            walk.end = offset + 9 + length
    except ValueError as error:
        walk.problem = str(error)
    _settle(walk, view, loose)
    return walk


def _add_walked_chunk(walk: Walk, payload: memoryview, offset: int, length: int) -> fmt.Chunk:
    chunk = fmt.parse_chunk(payload[:64], offset, length)
    if chunk.last_ns >= 1 << 63:
        raise ValueError(f'the chunk at byte {offset} has an impossible time')
    walk.chunks.append(chunk)
    return chunk


def _add_walked_index(walk: Walk, chunk: fmt.Chunk, payload: memoryview, offset: int) -> None:
    """Take the message index that stands behind its chunk."""
    fields = fmt.Fields(payload)
    channel, size = fields.u16(), fields.u32()
    if size != len(payload) - 6 or size % ENTRY_BYTES:
        raise ValueError(f'the message index at byte {offset} is damaged')
    if size:
        walk.indexes.setdefault(chunk.offset, {})[channel] = (offset + 15, size // ENTRY_BYTES)


def _settle(walk: Walk, view: memoryview, loose: dict[int, list[tuple[int, int, int]]]) -> None:
    """Count the messages, and open the chunks that alone know their topics."""
    for number, chunk in enumerate(list(walk.chunks)):
        index = walk.indexes.get(chunk.offset)
        # The last chunk's indexes may have been cut away in part.
        trusted = index is not None and (number + 1 < len(walk.chunks) or not walk.problem)
        if trusted and index is not None and set(index) <= set(walk.channels):
            walk.counts.update({key: count for key, (_, count) in index.items()})
            continue
        walk.indexes.pop(chunk.offset, None)
        try:
            inner = expand(view[chunk.data : chunk.end], chunk.compression, chunk.size)
            for opcode, offset, length in records(inner, 0, len(inner)):
                payload = memoryview(inner)[offset + 9 : offset + 9 + length]
                if opcode == fmt.MESSAGE:
                    walk.counts[fmt.Fields(payload).u16()] += 1
                else:
                    _add_description(walk, opcode, payload)
        except ValueError as error:
            # Reading it will say the same with its place; opening the file goes on.
            walk.problem = walk.problem or f'chunk at byte {chunk.offset}: {error}'
    for key, rows in loose.items():
        table = np.array(rows, dtype=np.uint64).astype(np.int64).reshape(-1, 3)
        walk.loose[key] = Places(table[:, 0], table[:, 1], table[:, 2])
        walk.counts[key] += len(rows)
