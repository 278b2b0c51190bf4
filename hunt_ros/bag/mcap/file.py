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

from hunt_ros.bag.blocks import Block, Places, strided
from hunt_ros.bag.mcap import records as rec
from hunt_ros.bag.mcap.layout import ENTRY_BYTES, IMPOSSIBLE, IndexPlace, Layout, walked_places
from hunt_ros.errors import BagError

#: Chunks are gathered together up to this many expanded bytes, so that small ones cost little.
BLOCK_BYTES = 1 << 22
#: What to do about damage, behind it.
REPAIR = '; "hunt info BAG --repair OUT" saves what is sound'


#: A kind of what cannot be read: no CRC, and the index tells something else.
UNPROVEN = 'messages that are not those of their index'
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
    problems : list of str
        What is wrong with the file as far as opening it shows; empty for a sound file.
    remarks : list of (kind, text)
        What reading it has shown since, without harm to what was read.

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
        self.remarks: list[tuple[str, str]] = []
        try:
            self.layout = layout = Layout(self.view)
        except BaseException:
            self.close()
            raise
        self.topics = list(layout.topics.values())
        self.counts = dict(layout.counts)
        self.metadata = [(part.name, part.metadata) for part in layout.metadata]
        self.problems = [f'no usable summary: {layout.no_summary}'] if layout.no_summary else []
        self.problems += layout.problems
        if not self.problems and layout.claimed not in (None, +layout.counts):
            there, told = layout.counts.total(), sum((layout.claimed or {}).values())
            self.problems.append(f'{there} messages are in it, {told} by its summary')
        self.problems += [f'{count} {what}' for what, count in layout.left_out.items() if count]

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
                opened = self._opened(whole, chunk, topics)
            except BagError as error:
                if damaged is None:
                    raise
                damaged(error)
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

    def _opened(self, whole: NDArray[np.uint8], chunk: rec.Chunk, topics: set[int]) -> _Opened:
        """Expand a chunk, check its CRC, and find the messages in it."""
        try:
            data = np.frombuffer(rec.expand_chunk(whole.data, chunk), dtype=np.uint8)
            index = self.layout.indexes.get(chunk.offset)
            places, fits = _indexed_places(data, index or {}, whole, topics)
            if index is None or not fits:
                if index is not None:
                    _refuse_unproven(chunk)
                    said = f'chunk at byte {chunk.offset} has a message index that does not fit'
                    self.remarks.append(('bad_index', f'{said}: it was walked through'))
                places = walked_places(data.data)
                places = {key: places[key] for key in topics & places.keys()}
        except ValueError as error:
            where = f'{self.path}: chunk at byte {chunk.offset}'
            raise BagError(f'{where}: {error}{REPAIR}') from error
        possible = {key: found.possible() for key, found in places.items()}
        lost = sum(places[key].log_ns.size - found.log_ns.size for key, found in possible.items())
        if lost:
            text = f'chunk at byte {chunk.offset}: {lost} {IMPOSSIBLE}'
            self.remarks.append(('damaged_message', text))
        return chunk, data, possible


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


def proven_places(layout: Layout, chunk: rec.Chunk, data: NDArray[np.uint8]) -> dict[int, Places]:
    """
    Find the messages of a chunk; without a CRC those that its index tells as they are.

    What is left out is counted by the layout.

    Raises
    ------
    ValueError
        If it is no sequence of records, or compressed, with nothing that proves all of it.
    """
    index = layout.indexes.get(chunk.offset)
    if chunk.crc or not index:
        return walked_places(data.data)
    whole = np.frombuffer(layout.view, np.uint8)
    found, fits = _indexed_places(data, index, whole, index.keys())
    if not fits:
        _refuse_unproven(chunk)
    told = sum(count for _, count in index.values())
    layout.left_out[UNPROVEN] += told - sum(part.starts.size for part in found.values())
    return found


def _refuse_unproven(chunk: rec.Chunk) -> None:
    """Refuse what damage in front of the expansion may have harmed anywhere: nothing shows it."""
    if chunk.compression and not chunk.crc:
        raise ValueError('its messages are not those of its index, and it has no CRC')


def _indexed_places(
    data: NDArray[np.uint8],
    index: dict[int, IndexPlace],
    whole: NDArray[np.uint8],
    wanted: Collection[int],
) -> tuple[dict[int, Places], bool]:
    """Find messages of topics in a chunk by its indexes, and whether all are where these say."""
    found, fits = {}, True
    for channel in index.keys() & wanted:
        offset, count = index[channel]
        entries = whole[offset : offset + count * ENTRY_BYTES].view('<u8')
        found[channel] = _checked_places(data, entries[1::2], entries[::2], channel)
        fits &= found[channel].starts.size == count
    return found, fits


def _checked_places(
    data: NDArray[np.uint8],
    offsets: NDArray[np.uint64],
    times: NDArray[np.uint64],
    channel: int,
) -> Places:
    """Return the messages of a channel that are at these offsets and of these times."""
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
