"""
A block: some megabytes of a recording as bytes, with the place of every message in it.

Every storage (MCAP, SQLite, compressed or not) hands out blocks, and everything
above works on blocks: the columns gather from them in numpy, the texts are cut
out of them.

Compressed bytes are expanded within a bound: a damaged or hostile bag may claim any size, and
nothing is allocated before the claim has been compared with what is there. The Reader of rosbags
has no such bound: for one message of 98 kB it asks for 3 GiB.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from numpy.typing import NDArray

from hunt_ros.errors import BagError

#: No chunk and no message may be larger than this when expanded (bytes).
LARGEST_CHUNK = 1 << 30


@dataclass(frozen=True)
class Problem:
    """
    One thing that is wrong with a recording.

    `kind` is one of: not_closed, damaged_file, damaged_chunk, damaged_message, bad_index,
    gap, stopped, clock_jump, missing_channel, wrong_unit, bursts. `time_s` counts from the
    recording's first stamp, or is None where the problem has no place in time.
    """

    kind: str
    text: str
    time_s: float | None = None

    def __str__(self) -> str:
        return self.text


class Stored:
    """
    A recording, or a file of one: what is wrong with it, and whether that ends its reading.

    Attributes
    ----------
    path : Path
    tolerant : bool
        What is damaged is noted and passed over; else it ends the reading.
    """

    tolerant = False

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._found: list[Problem] = []

    @property
    def problems(self) -> list[Problem]:
        """What is wrong with it, as far as opening and reading it have shown; each once."""
        return list(dict.fromkeys(self._found))

    def note(self, kind: str, text: str) -> None:
        """Keep what is wrong with it."""
        self._found.append(Problem(kind, text))

    def fail(self, text: str, cause: Exception) -> None:
        """Note a part that is damaged; raise BagError unless it is passed over."""
        if not self.tolerant:
            raise BagError(f'{self.path}: {text}') from cause
        self.note('damaged_chunk', text)


class Topic(NamedTuple):
    """
    One topic in one file.

    `encoding` is that of the messages ('cdr'), `definition` the text of the message
    type in `definition_encoding` ('ros2msg', 'ros2idl' or '' for none), `qos` what its
    publisher offered and `type_hash` that of the type, as the recorder wrote them.
    """

    id: int
    name: str
    type: str
    encoding: str
    definition_encoding: str
    definition: str
    qos: str = ''
    type_hash: str = ''


class Places(NamedTuple):
    """Where the messages of one topic lie in a block: arrays of shape (n,)."""

    log_ns: NDArray[np.int64]
    starts: NDArray[np.int64]
    lengths: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Block:
    """
    Bytes, and where the messages of each topic lie in them.

    Parameters
    ----------
    data : ndarray of uint8, shape (bytes,)
    places : dict of int to Places
        By topic id; in the order in which the messages were written. Every place
        lies within `data`.
    """

    data: NDArray[np.uint8]
    places: dict[int, Places]


def pack_messages(rows: Sequence[tuple[int, int, bytes]]) -> Block:
    """Make a block of loose messages, (topic id, log time, bytes), in their order."""
    lengths = np.fromiter((len(raw) for _, _, raw in rows), np.int64, len(rows))
    starts = np.cumsum(lengths) - lengths
    log_ns = np.fromiter((stamp for _, stamp, _ in rows), np.int64, len(rows))
    keys = np.fromiter((key for key, _, _ in rows), np.int64, len(rows))
    places = {}
    for key in np.unique(keys).tolist():
        own = keys == key
        places[key] = Places(log_ns[own], starts[own], lengths[own])
    return Block(np.frombuffer(b''.join(raw for _, _, raw in rows), dtype=np.uint8), places)


def in_order(places: Mapping[int, Places]) -> list[tuple[int, int, int, int]]:
    """Return (start, length, log time, topic id) of messages as they were written."""
    return sorted(
        (start, length, log_ns, key)
        for key, part in places.items()
        for log_ns, start, length in zip(*(one.tolist() for one in part), strict=True)
    )


def by_topic(
    described: Mapping[int, Topic], found: Mapping[int, Places]
) -> Iterator[tuple[Topic, Places]]:
    """Yield topics and their messages as they were written: each publisher may have an id."""
    several: dict[Topic, list[Places]] = {}
    for key, places in found.items():
        same = described[key]._replace(id=0, qos='', type_hash='')
        several.setdefault(same, []).append(places)
    for topic, parts in several.items():
        joined = parts[0]
        if len(parts) > 1:
            order = np.argsort(np.concatenate([part.starts for part in parts]))
            joined = Places(*(np.concatenate(one)[order] for one in zip(*parts, strict=True)))
        yield topic, joined


def packed_topics(block: Block, topics: Mapping[int, Topic]) -> set[int]:
    """
    Return the topics, of those known, whose messages were compressed one by one.

    They say so themselves: a message in CDR does not begin as a zstd frame does (RFC 8878, 3.1.1).
    """
    return {
        key
        for key, places in block.places.items()
        if places.starts.size and key in topics and topics[key].encoding == 'cdr'
        if block.data[places.starts[0] :][:4].tobytes() == zstandard.FRAME_HEADER
    }


def expand_messages(block: Block, topics: Mapping[int, Topic], file: Stored) -> Block:
    """
    Expand messages that were compressed one by one (rosbag2 compression mode MESSAGE).

    Parameters
    ----------
    block : Block
        As the file holds it.
    topics : mapping of int to Topic
        What the ids in the block mean.
    file : Stored
        Where it is noted that a message cannot be expanded.

    Raises
    ------
    BagError
        If a message cannot be expanded.
    """
    packed = packed_topics(block, topics)
    if not packed:
        return block
    budget = LARGEST_CHUNK
    machine = zstandard.ZstdDecompressor()  # one for all: to make it takes 16 times a message
    rows = []
    for start, length, stamp, topic in in_order(block.places):
        raw = block.data[start : start + length].tobytes()
        try:
            raw = expand_zstd(raw, budget, machine) if topic in packed else raw
        except ValueError as error:
            file.fail(f'a message at {stamp} ns: {error}', error)
            continue
        budget -= len(raw)
        rows.append((topic, stamp, raw))
    return pack_messages(rows)


def strided(data: NDArray[np.uint8], kind: str, offset: int) -> NDArray[Any]:
    """
    View the bytes as overlapping numbers: element i is the number at byte i + offset.

    Indexing it with an array of positions gathers one field of many messages at once.
    """
    count = max(0, data.size - offset - np.dtype(kind).itemsize + 1)
    offset = min(offset, data.size)  # no number is there, nor a place
    view: NDArray[Any] = np.ndarray((count,), dtype=kind, buffer=data, offset=offset, strides=(1,))
    return view


def expand(data: bytes | memoryview, compression: str, size: int) -> bytes | memoryview:
    """
    Decompress a chunk that claims to hold `size` bytes.

    Raises
    ------
    ValueError
        If the compression is unknown, the claim is impossible, or it is not kept.
    """
    if size > LARGEST_CHUNK:
        raise ValueError(f'it claims to hold {size} bytes, at most {LARGEST_CHUNK} are accepted')
    if compression == '':
        expanded: bytes | memoryview = data
    elif compression == 'zstd':
        expanded = expand_zstd(data, size)
    elif compression == 'lz4':
        expanded = _expand_lz4(data, size)
    else:
        raise ValueError(f'compression {compression!r} is unknown, expected lz4 or zstd')
    if len(expanded) != size:
        raise ValueError(f'it claims to hold {size} bytes and holds {len(expanded)}')
    return expanded


def expand_zstd(
    data: bytes | memoryview,
    limit: int = LARGEST_CHUNK,
    machine: zstandard.ZstdDecompressor | None = None,
) -> bytes:
    """
    Decompress one zstd frame of at most `limit` bytes, by a machine that is there, or a new one.

    Raises
    ------
    ValueError
        If it is not a zstd frame, or expands beyond the limit.
    """
    try:
        claimed = zstandard.frame_content_size(data)
        if claimed > limit:
            raise ValueError(f'a zstd frame claims {claimed} bytes, expected at most {limit}')
        # With an unknown content size (-1) the library needs the bound; 0 means none to it.
        bound = limit if claimed < 0 else claimed
        machine = machine or zstandard.ZstdDecompressor()
        return machine.decompress(data, max_output_size=max(bound, 1))
    except (zstandard.ZstdError, MemoryError) as error:
        raise ValueError(f'zstd cannot expand it ({error})') from error


def _expand_lz4(data: bytes | memoryview, size: int) -> bytes:
    try:
        machine = lz4.frame.LZ4FrameDecompressor()
        expanded: bytes = machine.decompress(bytes(data), max_length=size + 1)
        return expanded
    except (RuntimeError, MemoryError, EOFError, ValueError) as error:
        raise ValueError(f'lz4 cannot expand it ({error})') from error
