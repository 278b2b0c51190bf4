"""
Where everything is in an MCAP file: by its summary, or record by record from the front.

Functions on the bytes of a file; what does not fit raises `ValueError`.
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from mcap import records as peer
from mcap.opcode import Opcode

from hunt_ros.bag.blocks import Places, Topic, strided
from hunt_ros.bag.mcap import records as rec
from hunt_ros.bag.mcap.records import Chunk

#: Where the (log time, offset) pairs of a topic stand in the file, and how many they are.
IndexPlace: TypeAlias = tuple[int, int]

#: Bytes of a message index in front of its entries, and of one entry.
INDEX_HEAD, ENTRY_BYTES = 15, 16
#: Opcodes from here on are those of programs, not of MCAP.
_PRIVATE = 0x80
#: A kind of what cannot be read: no clock says so.
IMPOSSIBLE = 'messages of an impossible time'


@dataclass
class Layout:
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
    beside : list of (int, int)
        Offset and length of each metadata, attachment and private record; of a walk only.
    counts : Counter of int
        Messages by topic id, also of a topic that nothing describes.
    claimed : dict of int to int, or None
        Messages by topic id as the statistics have it; None without such.
    chunk_count : int
        Of the statistics.
    left_out : Counter of str
        What cannot be read, by kind.
    problems : list of str
        Where a walk met damage, and why.
    lost_bytes : int
        Bytes in damaged places.
    ended : bool
        Whether a walk has seen the end of the recording.
    """

    schemas: dict[int, peer.Schema] = field(default_factory=dict)
    channels: dict[int, peer.Channel] = field(default_factory=dict)
    chunks: list[Chunk] = field(default_factory=list)
    indexes: dict[int, dict[int, IndexPlace]] = field(default_factory=dict)
    loose: dict[int, Places] = field(default_factory=dict)
    metadata: list[peer.Metadata] = field(default_factory=list)
    beside: list[tuple[int, int]] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    claimed: dict[int, int] | None = None
    chunk_count: int = 0
    left_out: Counter[str] = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)
    lost_bytes: int = 0
    ended: bool = False

    @property
    def topics(self) -> list[Topic]:
        """The channels with their schemas."""
        none = peer.Schema(0, b'', '', '')
        result = []
        for channel in self.channels.values():
            schema = self.schemas.get(channel.schema_id, none)
            result.append(
                Topic(
                    channel.id, channel.topic, schema.name, channel.message_encoding,
                    schema.encoding, schema.data.decode('utf-8', 'replace'),
                    channel.metadata.get('offered_qos_profiles', ''),
                    channel.metadata.get('topic_type_hash', ''),
                )
            )  # fmt: skip
        return result

    @property
    def is_complete(self) -> bool:
        """Whether every chunk, message and topic of the statistics is here, with its index."""
        return (
            self.claimed == {key: count for key, count in self.counts.items() if count}
            and self.chunk_count == len(self.chunks)
            and self.claimed.keys() <= self.channels.keys()
        )

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
            schema = rec.unpack(peer.Schema, payload)
            schema.data = bytes(schema.data)  # outlives the file
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = rec.unpack(peer.Channel, payload)
            self.channels[channel.id] = channel


def read_summary(data: memoryview) -> Layout:
    """
    Read the summary section, and check that it agrees with the chunks it names.

    MCAP lets a recorder leave out any part: see `Layout.is_complete`.

    Raises
    ------
    ValueError
        If it is damaged.
    """
    layout = Layout()
    named: list[tuple[int, int, int]] = []
    for opcode, payload in rec.summary_records(data):
        if opcode == Opcode.STATISTICS:
            told = rec.unpack(peer.Statistics, payload)
            layout.chunk_count = told.chunk_count
            layout.claimed = {key: n for key, n in told.channel_message_counts.items() if n}
        elif opcode == Opcode.CHUNK_INDEX:
            chunk, offsets = _indexed_chunk(data, rec.unpack(peer.ChunkIndex, payload))
            layout.chunks.append(chunk)
            layout.indexes[chunk.offset] = {}
            named += ((chunk.offset, key, offset) for key, offset in offsets.items())
        elif opcode == Opcode.METADATA_INDEX:
            offset = rec.unpack(peer.MetadataIndex, payload).offset
            if offset + rec.RECORD.size > len(data):
                raise ValueError(f'metadata is said to be at byte {offset}, behind the end')
            _, length = rec.RECORD.unpack_from(data, offset)
            body = data[offset + rec.RECORD.size :][:length]
            layout.metadata.append(rec.unpack(peer.Metadata, body))
        else:
            layout.describe(opcode, payload)
    _add_indexes(layout, data, named)
    layout.chunks.sort(key=lambda chunk: chunk.offset)
    return layout


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


def _add_indexes(layout: Layout, data: memoryview, named: list[tuple[int, int, int]]) -> None:
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
        layout.indexes[chunk][channel] = (offset + INDEX_HEAD, count)
        layout.counts[channel] += count


class _Walk:
    """Goes through a file once, from the front to the end."""

    def __init__(self, view: memoryview) -> None:
        self.view = view
        self.layout = Layout()
        self._loose: dict[int, array[int]] = {}

    def run(self) -> Layout:
        """Find every record; behind damage, go on at the next chunk that the summary names."""
        chunks = _named_chunks(self.view)
        position, end = len(rec.MAGIC), len(self.view)
        while position < end and not self.layout.ended:
            following = bisect_right(chunks, position)
            try:
                for opcode, offset, length in rec.records(self.view, position, end):
                    behind = offset + rec.RECORD.size + length
                    following = bisect_right(chunks, offset)
                    if any(at < behind for at in chunks[following : following + 1]):
                        raise ValueError(f'the record at byte {offset} reaches into a chunk')
                    if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                        self.layout.ended = True
                        break
                    self._take(opcode, offset, length)
                    position = behind
                else:
                    break
            except ValueError as error:
                after = chunks[following] if following < len(chunks) else end
                self.layout.problems.append(f'bytes {position} to {after}: {error}')
                self.layout.lost_bytes += after - position
                position = after
                self._distrust()
        if not self.layout.ended:  # the indexes of the last chunk may have been cut away in part
            self._distrust()
        self._settle()
        return self.layout

    def _distrust(self) -> None:
        if self.layout.chunks:
            self.layout.indexes.pop(self.layout.chunks[-1].offset, None)

    def _take(self, opcode: int, offset: int, length: int) -> None:
        layout = self.layout
        payload = self.view[offset + 9 : offset + 9 + length]
        if opcode == Opcode.MESSAGE:
            _add_message(self._loose, self.view, offset, length)
        elif opcode == Opcode.CHUNK:
            layout.chunks.append(rec.unpack_chunk(self.view, offset, length))
        elif opcode == Opcode.MESSAGE_INDEX and layout.chunks:
            channel, size = int.from_bytes(payload[:2], 'little'), length - 6
            if size < 0 or size % ENTRY_BYTES or size != int.from_bytes(payload[2:6], 'little'):
                raise ValueError(f'the message index at byte {offset} is damaged')
            if size:
                index = layout.indexes.setdefault(layout.chunks[-1].offset, {})
                index[channel] = (offset + INDEX_HEAD, size // ENTRY_BYTES)
        elif opcode in (Opcode.METADATA, Opcode.ATTACHMENT) or opcode >= _PRIVATE:
            if opcode == Opcode.METADATA:
                layout.metadata.append(rec.unpack(peer.Metadata, payload))
            layout.beside.append((offset, length + 9))
        elif opcode > Opcode.DATA_END or not opcode:
            raise ValueError(f'the record at byte {offset} is of no known kind')
        else:
            layout.describe(opcode, payload)

    def _settle(self) -> None:
        """Count the messages, and open the chunks that alone know their topics."""
        layout = self.layout
        for chunk in layout.chunks:
            index = layout.indexes.get(chunk.offset)
            found = {key: count for key, (_, count) in (index or {}).items()}
            if index is None or not index.keys() <= layout.channels.keys():
                with suppress(ValueError):  # damaged: reading it says so
                    inside = walked_places(rec.expand_chunk(self.view, chunk), layout.describe)
                    found = {key: places.log_ns.size for key, places in inside.items()}
            layout.counts.update(found)
        for key, places in _places(self._loose).items():
            layout.loose[key] = places.possible()
            layout.counts[key] += layout.loose[key].log_ns.size
            layout.left_out[IMPOSSIBLE] += places.log_ns.size - layout.loose[key].log_ns.size
        unknown = (count for key, count in layout.counts.items() if key not in layout.channels)
        layout.left_out['messages of topics described nowhere'] += sum(unknown)


def walk_file(data: bytes | memoryview) -> Layout:
    """
    Walk a file from the front, over every record of it.

    Chunks are opened only where their topics are not known from elsewhere.
    """
    return _Walk(memoryview(data)).run()


def walked_places(
    raw: bytes | memoryview, describe: Callable[[int, memoryview], None] | None = None
) -> dict[int, Places]:
    """
    Find the messages of a chunk record by record.

    Parameters
    ----------
    raw : bytes
        The expanded chunk.
    describe : callable, optional
        Told of every other record: its opcode and its payload.

    Raises
    ------
    ValueError
        If it is no sequence of records, or a message has no head.
    """
    view = memoryview(raw)
    rows: dict[int, array[int]] = {}
    for opcode, offset, length in rec.records(view, 0, len(view)):
        if opcode == rec.MESSAGE:
            _add_message(rows, view, offset, length)
        elif describe is not None:
            describe(opcode, view[offset + 9 : offset + 9 + length])
    return _places(rows)


def _add_message(rows: dict[int, array[int]], view: memoryview, offset: int, length: int) -> None:
    if length < rec.MESSAGE_HEAD.size:
        raise ValueError(f'the message at byte {offset} has no head')
    channel, _, log_ns, _ = rec.MESSAGE_HEAD.unpack_from(view, offset + rec.RECORD.size)
    place = log_ns, offset + rec.MESSAGE_PREFIX, length - rec.MESSAGE_HEAD.size
    rows.setdefault(channel, array('Q')).extend(place)


def _places(rows: dict[int, array[int]]) -> dict[int, Places]:
    return {
        key: Places(*np.frombuffer(several, dtype=np.int64).reshape(-1, 3).T.copy())
        for key, several in rows.items()
    }


def _named_chunks(view: memoryview) -> list[int]:
    """Return where chunks are by the summary, if there is a sound one."""
    with suppress(ValueError):
        return sorted(
            rec.unpack(peer.ChunkIndex, payload).chunk_start_offset
            for opcode, payload in rec.summary_records(view)
            if opcode == Opcode.CHUNK_INDEX
        )
    return []
