"""
One MCAP file, opened: its topics, its chunks, and its messages as blocks.

A file is walked from the front, record by record, over the heads of its chunks: everything
complete in it is there, also of one that was cut short (a recorder that was killed) or has no
index.
"""

from __future__ import annotations

import itertools
import mmap
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag.blocks import Block, Places, Problem, strided
from hunt_ros.bag.mcap import records as rec
from hunt_ros.bag.mcap.layout import IndexPlace, Layout, walked_places
from hunt_ros.errors import BagError
from hunt_ros.samples import counted

#: Chunks are gathered together up to this many expanded bytes, so that small ones cost little.
BLOCK_BYTES = 1 << 22
#: What to do about damage, behind it.
REPAIR = '; "hunt info BAG --repair OUT" saves what is sound'

#: A chunk, expanded and checked, and where its messages lie in it.
_Opened: TypeAlias = tuple[rec.Chunk, NDArray[np.uint8], dict[int, Places]]


class McapFile:
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
    layout : Layout
        Where everything is in it.
    topics : list of Topic
    counts : dict of int to int
        Messages by topic id.
    metadata : list of (name, strings)
    problems : list of Problem

    Raises
    ------
    BagError
        If it cannot be opened, is no MCAP file, or is empty.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = str(path)
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
        try:
            self.layout = layout = Layout(self.view)
        except BaseException:
            self.close()
            raise
        self.topics = list(layout.topics.values())
        self.counts = dict(layout.counts)
        self.metadata = [(part.name, part.metadata) for part in layout.metadata]
        self._found: list[Problem] = []
        if layout.no_summary:
            closed = self.view[-len(rec.MAGIC) :] == rec.MAGIC
            text = f'no usable summary: {layout.no_summary}'
            self._found.append(Problem('damaged_file' if closed else 'not_closed', text))
        texts = list(layout.problems)
        if not self._found and not texts and layout.claimed not in (None, +layout.counts):
            there, told = layout.counts.total(), sum((layout.claimed or {}).values())
            texts.append(f'{there} messages are in it, {told} by its summary')
        if layout.homeless:
            texts.append(f'{layout.homeless} messages of topics described nowhere')
        self._found += [Problem('damaged_file', text) for text in texts]
        #: Chunks whose index does not fit, with how many messages are lost: there is no CRC.
        self._misfits: dict[int, int] = {}

    @property
    def problems(self) -> list[Problem]:
        """What is wrong with the file, as far as opening and reading it have shown."""
        found = list(self._found)
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
        """First and last log time, ns; None for a file with no message."""
        return self.layout.span_ns

    def close(self) -> None:
        """Let go of the file; blocks still held keep the map open until they are gone."""
        # An array may still look into the map: it then closes with the last of them.
        with suppress(BufferError):
            self.view.release()
            self._map.close()

    def blocks(
        self, wanted: Collection[int], damaged: Callable[[BagError], None] | None = None
    ) -> Iterator[Block]:
        """
        Yield the messages of these topics.

        `damaged` is told of each damaged chunk, which is passed over.

        Raises
        ------
        BagError
            If a chunk is damaged, with its place in the file.
        """
        whole = np.frombuffer(self._map, dtype=np.uint8)
        topics = set(wanted)
        group: list[_Opened] = []
        size = 0
        for chunk in self.layout.chunks:
            if topics.isdisjoint(self.layout.indexes.get(chunk.offset, topics)):
                continue
            try:
                opened = (chunk, *self.opened(chunk, topics))
            except ValueError as error:
                where = f'{self.path}: chunk at byte {chunk.offset}'
                failed = BagError(f'{where}: {error}{REPAIR}')
                if damaged is None:
                    raise failed from error
                damaged(failed)
                continue
            if group and size + chunk.size > BLOCK_BYTES:
                yield _block(whole, group)
                group, size = [], 0
            group.append(opened)
            size += chunk.size
        if group:
            yield _block(whole, group)
        loose = {key: places for key, places in self.layout.loose.items() if key in topics}
        if loose:
            yield Block(whole, loose)

    def opened(
        self, chunk: rec.Chunk, wanted: Collection[int] | None = None
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
        index = self.layout.indexes.get(chunk.offset)
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
