"""
One MCAP file, opened: its topics, its chunks, and its messages as blocks.

A file is walked from the front, record by record, over the heads of its chunks: everything
complete in it is there, also of one that was cut short (a recorder that was killed) or has no
index. The summary at its end is not needed: its heads and indexes are what a walk passes, and
reading it saves 0.3 s of an hour of a live rig. It says how many messages there should be, and
where a walk goes on behind damage.
"""

from __future__ import annotations

import itertools
import mmap
from array import array
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TypeAlias

import numpy as np
from mcap import records as peer
from mcap.opcode import Opcode
from numpy.typing import NDArray

from hunt_ros.bag.blocks import Block, Places, Problem, Stored, Topic, strided
from hunt_ros.bag.mcap import records as rec
from hunt_ros.bag.mcap.records import Chunk
from hunt_ros.errors import BagError
from hunt_ros.samples import counted

#: Chunks are gathered together up to this many expanded bytes, so that small ones cost little.
BLOCK_BYTES = 1 << 22
#: What to do about damage, behind it.
REPAIR = '; "hunt info BAG --repair OUT" saves what is sound'

#: Where the (log time, offset) pairs of a topic stand in the file, and how many they are.
IndexPlace: TypeAlias = tuple[int, int]
#: A chunk, expanded and checked, and where its messages lie in it.
_Opened: TypeAlias = tuple[Chunk, NDArray[np.uint8], dict[int, Places]]

#: Bytes of a message index in front of its entries, and of one entry.
INDEX_HEAD, ENTRY_BYTES = 15, 16
#: Opcodes from here on are those of programs, not of MCAP.
_PRIVATE = 0x80


class McapFile(Stored):
    """
    An MCAP file opened for reading.

    Parameters
    ----------
    path : str or Path
        The file.

    Attributes
    ----------
    view : memoryview
        Its bytes.
    schemas, channels : dict of int to Schema, to Channel
    topics : dict of int to Topic
        The channels with their schemas, by id.
    chunks : list of Chunk
        In the order of the file.
    indexes : dict
        By chunk offset: topic id -> IndexPlace. A chunk missing here has no index and
        is walked when it is read.
    loose : dict of int to Places
        Messages that stand outside of chunks, by topic id.
    metadata : list of (name, strings)
    beside : list of (int, int)
        Offset and length of each metadata, attachment and private record.
    counts : Counter of int
        Messages by topic id, also of a topic that nothing describes.
    claimed : dict of int to int, or None
        The same by the statistics of the summary; None without such.
    lost_bytes : int
        Bytes in damaged places.
    ended : bool
        Whether the walk has seen the end of the recording.
    problems : list of Problem
    unproven : int
        Messages without a CRC, left out as they are not those of their index.

    Raises
    ------
    BagError
        If it cannot be opened, is no MCAP file, or is empty.
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        try:
            with open(path, 'rb') as file:
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except ValueError as error:  # mmap refuses an empty file
            raise BagError(f'{path}: the file is empty, expected an MCAP recording') from error
        except OSError as error:
            raise BagError(f'{path}: cannot open it ({error.strerror})') from error
        if rec.MAGIC not in (self._map[: len(rec.MAGIC)], self._map[-len(rec.MAGIC) :]):
            self._map.close()
            raise BagError(f'{path}: not an MCAP file, it does not begin with its magic bytes')
        self.view = memoryview(self._map)
        self.schemas: dict[int, peer.Schema] = {}
        self.channels: dict[int, peer.Channel] = {}
        self.chunks: list[Chunk] = []
        self.indexes: dict[int, dict[int, IndexPlace]] = {}
        self.metadata: list[tuple[str, dict[str, str]]] = []
        self.beside: list[tuple[int, int]] = []
        self.counts: Counter[int] = Counter()
        self.claimed: dict[int, int] | None = None
        self.lost_bytes, self.ended = 0, False
        #: Chunks whose index does not fit, with how many messages are lost: there is no CRC.
        self._misfits: dict[int, int] = {}
        try:
            self._walk(self._read_summary())
        except BaseException:
            self.close()
            raise
        self._settle()

    @property
    def problems(self) -> list[Problem]:
        """What is wrong with the file, as far as opening and reading it have shown."""
        found = super().problems
        if walked := sum(not count for count in self._misfits.values()):
            text = f'the message index of {counted(walked, "chunk")} does not fit: walked through'
            found.append(Problem('bad_index', text))
        if self.unproven:
            text = f'{self.unproven} messages that are not those of their index are left out'
            found.append(Problem('damaged_message', text))
        return found

    @property
    def unproven(self) -> int:
        """Messages without a CRC, left out as they are not those of their index."""
        return sum(self._misfits.values())

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """First and last log time over chunks and loose messages, ns."""
        # A chunk without a message says 0.
        times = [
            time_ns
            for chunk in self.chunks
            if chunk.size and (chunk.first_ns or chunk.last_ns)
            for time_ns in (chunk.first_ns, chunk.last_ns)
        ]
        for places in self.loose.values():
            if places.log_ns.size:
                times += [int(places.log_ns.min()), int(places.log_ns.max())]
        return (min(times), max(times)) if times and sum(self.counts.values()) else None

    def _read_summary(self) -> list[int]:
        """Take the topics and counts of a sound summary; return where it says that chunks are."""
        # Many writers describe a topic in its first chunk alone, which may be damaged.
        found = []
        try:
            for opcode, payload in rec.summary_records(self.view):
                if opcode == Opcode.CHUNK_INDEX:
                    found.append(rec.unpack(peer.ChunkIndex, payload).chunk_start_offset)
                elif opcode == Opcode.STATISTICS:
                    counts = rec.unpack(peer.Statistics, payload).channel_message_counts
                    self.claimed = {key: count for key, count in counts.items() if count}
                self._describe(opcode, payload)
        except ValueError as error:
            closed = self.view[-len(rec.MAGIC) :] == rec.MAGIC
            kind = 'damaged_file' if closed else 'not_closed'
            self.note(kind, f'no usable summary: {error}')
        return sorted(found)

    def _walk(self, chunks: list[int]) -> None:
        """Find every record; behind damage, go on at the next chunk that the summary names."""
        position, end = len(rec.MAGIC), len(self.view)
        loose: dict[int, array[int]] = {}
        if self.view[:position] != rec.MAGIC:
            self.note('damaged_file', f'bytes 0 to {position}: no magic bytes')
            self.lost_bytes += position
        while position < end and not self.ended:
            try:
                for opcode, offset, length in rec.records(self.view, position, end):
                    behind = offset + rec.RECORD.size + length
                    following = bisect_right(chunks, offset)
                    if any(at < behind for at in chunks[following : following + 1]):
                        raise ValueError(f'the record at byte {offset} reaches into a chunk')
                    if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                        self.ended = True
                        break
                    self._take(opcode, offset, length, loose)
                    position = behind
                else:
                    break
            except ValueError as error:
                following = bisect_right(chunks, position)
                after = chunks[following] if following < len(chunks) else end
                self.note('damaged_file', f'bytes {position} to {after}: {error}')
                self.lost_bytes += after - position
                position = after
                self._distrust()
        if not self.ended:  # the indexes of the last chunk may have been cut away in part
            self._distrust()
        self.loose = _places(loose)

    def _distrust(self) -> None:
        if self.chunks:
            self.indexes.pop(self.chunks[-1].offset, None)

    def _describe(self, opcode: int, payload: bytes | memoryview) -> None:
        """Take a schema or a channel; another record is passed over."""
        if opcode == Opcode.SCHEMA:
            schema = rec.unpack(peer.Schema, payload)
            schema.data = bytes(schema.data)  # outlives the file
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = rec.unpack(peer.Channel, payload)
            self.channels[channel.id] = channel

    def _take(self, opcode: int, offset: int, length: int, loose: dict[int, array[int]]) -> None:
        payload = self.view[offset + 9 : offset + 9 + length]
        if opcode == Opcode.MESSAGE:
            _add_message(loose, self.view, offset, length)
        elif opcode == Opcode.CHUNK:
            self.chunks.append(rec.unpack_chunk(self.view, offset, length))
        elif opcode == Opcode.MESSAGE_INDEX and self.chunks:
            channel, size = int.from_bytes(payload[:2], 'little'), length - 6
            if size < 0 or size % ENTRY_BYTES or size != int.from_bytes(payload[2:6], 'little'):
                raise ValueError(f'the message index at byte {offset} is damaged')
            if size:
                index = self.indexes.setdefault(self.chunks[-1].offset, {})
                index[channel] = (offset + INDEX_HEAD, size // ENTRY_BYTES)
        elif opcode in (Opcode.METADATA, Opcode.ATTACHMENT) or opcode >= _PRIVATE:
            if opcode == Opcode.METADATA:
                one = rec.unpack(peer.Metadata, payload)
                self.metadata.append((one.name, one.metadata))
            self.beside.append((offset, length + 9))
        elif opcode > Opcode.DATA_END or not opcode:
            raise ValueError(f'the record at byte {offset} is of no known kind')
        else:
            self._describe(opcode, payload)

    def _settle(self) -> None:
        """Count the messages, open the chunks that alone know their topics, and describe these."""
        for chunk in self.chunks:
            index = self.indexes.get(chunk.offset)
            found = {key: count for key, (_, count) in (index or {}).items()}
            if index is None or not index.keys() <= self.channels.keys():
                with suppress(ValueError):  # damaged: reading it says so
                    inside = walked_places(rec.expand_chunk(self.view, chunk), self._describe)
                    found = {key: places.log_ns.size for key, places in inside.items()}
            self.counts.update(found)
        self.counts.update({key: places.log_ns.size for key, places in self.loose.items()})
        none = peer.Schema(0, b'', '', '')
        self.topics = {}
        for key, channel in self.channels.items():
            schema = self.schemas.get(channel.schema_id, none)
            self.topics[key] = Topic(
                key, channel.topic, schema.name, channel.message_encoding,
                schema.encoding, schema.data.decode('utf-8', 'replace'),
                channel.metadata.get('offered_qos_profiles', ''),
                channel.metadata.get('topic_type_hash', ''),
            )  # fmt: skip
        if not self._found and self.claimed not in (None, +self.counts):
            there, told = self.counts.total(), sum((self.claimed or {}).values())
            self.note('damaged_file', f'{there} messages are in it, {told} by its summary')
        if homeless := sum(n for key, n in self.counts.items() if key not in self.channels):
            self.note('damaged_file', f'{homeless} messages of topics described nowhere')

    def close(self) -> None:
        """Let go of the file; blocks still held keep the map open until they are gone."""
        # An array may still look into the map: it then closes with the last of them.
        with suppress(BufferError):
            self.view.release()
            self._map.close()

    def blocks(self, wanted: Collection[int]) -> Iterator[Block]:
        """
        Yield the messages of these topics.

        Raises
        ------
        BagError
            If a chunk is damaged, with its place in the file.
        """
        whole = np.frombuffer(self._map, dtype=np.uint8)
        topics = set(wanted)
        group: list[_Opened] = []
        size = 0
        for chunk in self.chunks:
            if topics.isdisjoint(self.indexes.get(chunk.offset, topics)):
                continue
            try:
                opened = (chunk, *self.opened(chunk, topics))
            except ValueError as error:
                self.fail(f'chunk at byte {chunk.offset}: {error}{REPAIR}', error)
                continue
            if group and size + chunk.size > BLOCK_BYTES:
                yield _block(whole, group)
                group, size = [], 0
            group.append(opened)
            size += chunk.size
        if group:
            yield _block(whole, group)
        loose = {key: places for key, places in self.loose.items() if key in topics}
        if loose:
            yield Block(whole, loose)

    def opened(
        self, chunk: Chunk, wanted: Collection[int] | None = None
    ) -> tuple[NDArray[np.uint8], dict[int, Places]]:
        """
        Expand a chunk, check its CRC, and find the messages in it: of topics, or all.

        Without a CRC they are those that the index tells as they are.

        Raises
        ------
        ValueError
            If it is no sequence of records, or compressed, with nothing that proves all of it.
        """
        data = np.frombuffer(rec.expand_chunk(self.view, chunk), dtype=np.uint8)
        index = self.indexes.get(chunk.offset)
        if index is not None and not (chunk.crc and wanted is None):  # what has to be all of it
            asked = index.keys() if wanted is None else index.keys() & wanted
            found = {key: self._indexed(data, index[key], key) for key in asked}
            lost = sum(index[key][1] - places.starts.size for key, places in found.items())
            if not lost:
                return data, found
            # Damage in front of the expansion may have harmed anything: nothing shows it.
            if chunk.compression and not chunk.crc:
                raise ValueError('its messages are not those of its index, and it has no CRC')
            self._misfits[chunk.offset] = 0 if chunk.crc else lost
            if not chunk.crc:
                return data, found
        places = walked_places(data.data)
        return data, {key: one for key, one in places.items() if wanted is None or key in wanted}

    def _indexed(self, data: NDArray[np.uint8], place: IndexPlace, channel: int) -> Places:
        """Return the messages of a channel that are where their index says, and of its times."""
        offset, count = place
        entries = np.frombuffer(self.view, '<u8', 2 * count, offset)
        times, offsets = entries[::2], entries[1::2]
        inside = offsets < max(0, data.size - rec.MESSAGE_PREFIX + 1)
        if not inside.all():
            offsets, times = offsets[inside], times[inside]
        places = offsets.astype(np.int64)
        # Opcode and the low bytes of the length; the rest of it, and the channel.
        head = strided(data, '<u8', 0)[places]
        rest = strided(data, '<u4', 8)[places]
        lengths = (head >> np.uint64(8)).view(np.int64) - rec.MESSAGE_HEAD.size
        starts = places + rec.MESSAGE_PREFIX
        log_ns = strided(data, '<u8', 15)[places]
        sound = (
            ((head & np.uint64(0xFF)) == rec.MESSAGE)
            & ((rest & np.uint32(0xFFFFFF)) == channel << 8)
            & (lengths >= 0)
            & (lengths <= data.size - starts)
            & (log_ns == times)
        )
        found = Places(log_ns.view(np.int64), starts, lengths)
        return found if sound.all() else Places(*(part[sound] for part in found))


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


def _block(whole: NDArray[np.uint8], group: list[_Opened]) -> Block:
    """Put opened chunks together."""
    chunks, parts, places_of = zip(*group, strict=True)
    if not any(chunk.compression for chunk in chunks):
        # The file itself is the buffer: nothing is copied.
        begin = chunks[0].data
        data = whole[begin : chunks[-1].end]
        bases = [chunk.data - begin for chunk in chunks]
    else:
        data = np.concatenate(parts)
        bases = [0, *itertools.accumulate(part.size for part in parts[:-1])]
    found: dict[int, list[Places]] = {}
    for several, base in zip(places_of, bases, strict=True):
        for key, places in several.items():
            moved = Places(places.log_ns, places.starts + base, places.lengths)
            found.setdefault(key, []).append(moved)
    joined = {
        key: several[0]
        if len(several) == 1
        else Places(*map(np.concatenate, zip(*several, strict=True)))
        for key, several in found.items()
    }
    return Block(data, joined)
