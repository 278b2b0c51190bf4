"""
Finding the way in an MCAP file: by its summary, by its indexes, or record by record.

Functions on the bytes of a file; what does not fit raises `ValueError`.
"""

from __future__ import annotations

from array import array
from collections import Counter
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from mcap import records as peer
from mcap.opcode import Opcode

from hunt_ros.bag.blocks import Places, Topic, strided
from hunt_ros.bag.compression import expand
from hunt_ros.bag.mcap import records as rec
from hunt_ros.bag.mcap.records import Chunk

#: Where the (log time, offset) pairs of a topic stand in the file, and how many they are.
IndexPlace: TypeAlias = tuple[int, int]

#: Bytes of a message index in front of its entries, and of one entry.
INDEX_HEAD, ENTRY_BYTES = 15, 16


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
    metadata : list of Metadata
    counts : Counter of int
        Messages by topic id, also of a topic that nothing describes.
    impossible : int
        Loose messages that were passed over: their times are no times.
    end : int
        File offset behind the last complete record.
    problem : str
        Why a walk ended before the end of the file; '' where it did not.
    """

    schemas: dict[int, peer.Schema] = field(default_factory=dict)
    channels: dict[int, peer.Channel] = field(default_factory=dict)
    chunks: list[Chunk] = field(default_factory=list)
    indexes: dict[int, dict[int, IndexPlace]] = field(default_factory=dict)
    loose: dict[int, Places] = field(default_factory=dict)
    metadata: list[peer.Metadata] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    impossible: int = 0
    end: int = 0
    problem: str = ''

    def topics(self) -> list[Topic]:
        """Return the channels with their schemas, as topics."""
        none = peer.Schema(0, b'', '', '')
        result = []
        for channel in self.channels.values():
            schema = self.schemas.get(channel.schema_id, none)
            text = schema.data.decode('utf-8', 'replace')
            result.append(
                Topic(
                    channel.id, channel.topic, schema.name, channel.message_encoding,
                    schema.encoding, text, channel.metadata.get('offered_qos_profiles', ''),
                    channel.metadata.get('topic_type_hash', ''),
                )
            )  # fmt: skip
        return result

    @property
    def homeless(self) -> int:
        """Messages of topics that are described nowhere."""
        return sum(count for key, count in self.counts.items() if key not in self.channels)

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """First and last log time over chunks and loose messages, ns."""
        # A chunk without a message says 0; a time that is none is passed over.
        times = [
            time_ns
            for chunk in self.chunks
            if chunk.size and (chunk.first_ns or chunk.last_ns)
            for time_ns in (chunk.first_ns, chunk.last_ns)
            if time_ns < rec.IMPOSSIBLE_NS
        ]
        for places in self.loose.values():
            if places.log_ns.size:
                times += [int(places.log_ns.min()), int(places.log_ns.max())]
        return (min(times), max(times)) if times and sum(self.counts.values()) else None

    def describe(self, opcode: int, payload: bytes | memoryview) -> None:
        """Take a schema or a channel; another record is passed over."""
        if opcode == Opcode.SCHEMA:
            schema = rec.unpack_schema(payload)
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = rec.unpack(peer.Channel, payload)
            self.channels[channel.id] = channel


def read_summary(data: memoryview) -> Walk:
    """
    Read the summary section, and check that it agrees with the chunks it names.

    Raises
    ------
    NotIndexedError
        If there is none, or it does not tell where the messages are.
    ValueError
        If it is damaged.
    """
    walk = Walk(end=len(data))
    statistics: peer.Statistics | None = None
    named: list[tuple[int, int, int]] = []
    found = rec.summary_records(data)
    if found is None:
        raise NotIndexedError('it has no summary section')
    for opcode, payload in found:
        if opcode == Opcode.STATISTICS:
            statistics = rec.unpack(peer.Statistics, payload)
        elif opcode == Opcode.CHUNK_INDEX:
            chunk, offsets = _indexed_chunk(data, rec.unpack(peer.ChunkIndex, payload))
            walk.chunks.append(chunk)
            walk.indexes[chunk.offset] = {}
            named += ((chunk.offset, key, offset) for key, offset in offsets.items())
        elif opcode == Opcode.METADATA_INDEX:
            _add_indexed_metadata(walk, data, rec.unpack(peer.MetadataIndex, payload).offset)
        else:
            walk.describe(opcode, payload)
    _add_indexes(walk, data, named)
    _check_summary(walk, statistics)
    return walk


def _check_summary(walk: Walk, statistics: peer.Statistics | None) -> None:
    """Refuse a summary that does not name every chunk, message and topic."""
    for places in walk.indexes.values():
        for channel, (_, count) in places.items():
            walk.counts[channel] += count
    if statistics is None:
        raise NotIndexedError('the summary has no statistics')
    counted = {key: count for key, count in statistics.channel_message_counts.items() if count}
    reason = ''
    if statistics.chunk_count != len(walk.chunks):
        reason = f'the summary names {len(walk.chunks)} of {statistics.chunk_count} chunks'
    elif counted != {key: count for key, count in walk.counts.items() if count}:
        reason = 'the message indexes do not hold as many messages as were written'
    elif walk.homeless:
        reason = 'the summary does not describe every topic'
    if reason:
        raise NotIndexedError(reason, counted)
    walk.chunks.sort(key=lambda chunk: chunk.offset)


def _indexed_chunk(data: memoryview, index: peer.ChunkIndex) -> tuple[Chunk, dict[int, int]]:
    """Return a chunk of the summary; what stands at its place must be that chunk."""
    offset, size = index.chunk_start_offset, index.chunk_length
    if offset + size + index.message_index_length > len(data) or size < 9:
        raise ValueError(f'a chunk is said to be at byte {offset}, behind the end')
    opcode, length = rec.RECORD.unpack_from(data, offset)
    if opcode != Opcode.CHUNK or length + 9 != size:
        raise ValueError(f'there is no chunk at byte {offset}')
    chunk = rec.unpack_chunk(data, offset, length)
    # The summary and the chunk must tell one story: the summary alone is not trusted.
    told = index.message_start_time, index.message_end_time, index.uncompressed_size
    if (chunk.first_ns, chunk.last_ns, chunk.size) != told:
        raise ValueError(f'the summary contradicts the chunk at byte {offset}')
    return chunk, index.message_index_offsets


def _add_indexes(walk: Walk, data: memoryview, named: list[tuple[int, int, int]]) -> None:
    """Check the message indexes that a summary names, all at once, and note their entries."""
    if not named:
        return
    if max(offset for _, _, offset in named) + INDEX_HEAD > len(data):
        raise ValueError('a message index is said to be behind the end')
    whole = np.frombuffer(data, dtype=np.uint8)
    _, channels, offsets = np.array(named, dtype=np.int64).T
    lengths = strided(whole, '<u8', 1)[offsets]
    sizes = strided(whole, '<u4', 11)[offsets]
    sound = (
        (whole[offsets] == Opcode.MESSAGE_INDEX)
        & (strided(whole, '<u2', 9)[offsets] == channels)
        & (lengths == sizes + np.uint64(6))
        & (sizes % ENTRY_BYTES == 0)
        & (sizes <= len(data) - INDEX_HEAD - offsets)
    )
    if not sound.all():
        raise ValueError(f'the message index at byte {offsets[~sound][0]} is damaged')
    counts = (sizes // ENTRY_BYTES).tolist()
    for (chunk, channel, offset), count in zip(named, counts, strict=True):
        walk.indexes[chunk][channel] = (offset + INDEX_HEAD, count)


def _add_indexed_metadata(walk: Walk, data: memoryview, offset: int) -> None:
    if offset + 9 > len(data):
        raise ValueError(f'metadata is said to be at byte {offset}, behind the end')
    opcode, length = rec.RECORD.unpack_from(data, offset)
    if opcode == Opcode.METADATA and offset + 9 + length <= len(data):
        payload = data[offset + 9 : offset + 9 + length]
        walk.metadata.append(rec.unpack(peer.Metadata, payload))


def walk_file(data: bytes | memoryview) -> Walk:
    """
    Walk a file from the front, as far as it is whole.

    Chunks are opened only where their topics are not known from elsewhere. The last
    chunk of a file that was cut is not among them: see `hunt_ros.bag.repair`.
    """
    walk = Walk(end=len(rec.MAGIC))
    loose: dict[int, array[int]] = {}
    view = memoryview(data)
    last: Chunk | None = None
    ended = False
    try:
        for opcode, offset, length in rec.records(data, walk.end, len(data)):
            payload = view[offset + 9 : offset + 9 + length]
            if opcode == Opcode.MESSAGE:
                if length < rec.MESSAGE_HEAD.size:
                    raise ValueError(f'the message at byte {offset} has no head')
                channel, _, log_ns, _ = rec.MESSAGE_HEAD.unpack_from(payload)
                place = log_ns, offset + rec.MESSAGE_PREFIX, length - rec.MESSAGE_HEAD.size
                loose.setdefault(channel, array('Q')).extend(place)
            elif opcode == Opcode.CHUNK:
                last = rec.unpack_chunk(data, offset, length)
                walk.chunks.append(last)
            elif opcode == Opcode.MESSAGE_INDEX and last is not None:
                _add_walked_index(walk, last, payload, offset)
            elif opcode == Opcode.METADATA:
                walk.metadata.append(rec.unpack(peer.Metadata, payload))
            elif opcode in (Opcode.DATA_END, Opcode.FOOTER):
                ended = True
                break
            else:
                walk.describe(opcode, payload)
            walk.end = offset + 9 + length
    except ValueError as error:
        walk.problem = str(error)
    if walk.chunks and not ended:  # the indexes of the last one may have been cut away in part
        walk.indexes.pop(walk.chunks[-1].offset, None)
    _settle(walk, view)
    for key, rows in loose.items():
        places = Places(*np.frombuffer(rows, dtype=np.int64).reshape(-1, 3).T.copy())
        walk.loose[key] = places.possible()
        walk.impossible += places.log_ns.size - walk.loose[key].log_ns.size
        walk.counts[key] += walk.loose[key].log_ns.size
    return walk


def _add_walked_index(walk: Walk, chunk: Chunk, payload: memoryview, offset: int) -> None:
    """Take the message index that stands behind its chunk."""
    if len(payload) < 6:
        raise ValueError(f'the message index at byte {offset} is damaged')
    channel = int.from_bytes(payload[:2], 'little')
    size = int.from_bytes(payload[2:6], 'little')
    if size != len(payload) - 6 or size % ENTRY_BYTES:
        raise ValueError(f'the message index at byte {offset} is damaged')
    if size:
        place = (offset + INDEX_HEAD, size // ENTRY_BYTES)
        walk.indexes.setdefault(chunk.offset, {})[channel] = place


def _settle(walk: Walk, view: memoryview) -> None:
    """Count the messages, and open the chunks that alone know their topics."""
    for chunk in walk.chunks:
        index = walk.indexes.get(chunk.offset)
        if index is None or not index.keys() <= walk.channels.keys():
            try:
                found = _look_inside(walk, view, chunk)
            except ValueError as error:
                # Reading it will say the same with its place; opening the file goes on.
                walk.problem = walk.problem or f'chunk at byte {chunk.offset}: {error}'
                continue
            if index is None:
                walk.counts.update(found)
                continue
        walk.counts.update({key: count for key, (_, count) in index.items()})


def _look_inside(walk: Walk, view: memoryview, chunk: Chunk) -> Counter[int]:
    """Take the descriptions in a chunk, and count its messages."""
    inner = memoryview(expand(view[chunk.data : chunk.end], chunk.compression, chunk.size))
    found: Counter[int] = Counter()
    for opcode, offset, length in rec.records(inner, 0, len(inner)):
        payload = inner[offset + 9 : offset + 9 + length]
        if opcode == Opcode.MESSAGE:
            found[int.from_bytes(payload[:2], 'little')] += 1
        else:
            walk.describe(opcode, payload)
    return found
