"""
A block: some megabytes of a recording as bytes, with the place of every message in it.

Every storage (MCAP, SQLite, compressed or not) hands out blocks, and everything
above works on blocks: the columns gather from them in numpy, the texts are cut
out of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag.compression import LARGEST_CHUNK, expand_zstd, is_compressed
from hunt_ros.errors import BagError


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

    def possible(self) -> Places:
        """Return those whose log time is one: from 2^63 ns on (negative here) it is not."""
        sound = self.log_ns >= 0
        return self if sound.all() else Places(*(part[sound] for part in self))


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


def within(places: Places, start_ns: int | None, end_ns: int | None) -> Places:
    """Return the places with start_ns <= log time < end_ns."""
    if start_ns is None and end_ns is None:
        return places
    inside = np.ones(places.log_ns.size, dtype=bool)
    if start_ns is not None:
        inside &= places.log_ns >= start_ns
    if end_ns is not None:
        inside &= places.log_ns < end_ns
    return places if inside.all() else Places(*(part[inside] for part in places))


def pack_messages(messages: dict[int, list[tuple[int, bytes]]]) -> Block:
    """Make a block of loose messages: (log time, bytes) by topic."""
    data: list[bytes] = []
    position = 0
    places: dict[int, Places] = {}
    for topic, rows in messages.items():
        lengths = np.fromiter((len(raw) for _, raw in rows), np.int64, len(rows))
        starts = position + np.cumsum(lengths) - lengths
        places[topic] = Places(
            np.fromiter((stamp for stamp, _ in rows), np.int64, len(rows)), starts, lengths
        )
        data.extend(raw for _, raw in rows)
        position += int(lengths.sum())
    return Block(np.frombuffer(b''.join(data), dtype=np.uint8), places)


def expand_messages(block: Block, topics: Mapping[int, Topic], path: str) -> Block:
    """
    Expand messages that were compressed one by one (rosbag2 compression mode MESSAGE).

    They say so themselves: a message in CDR does not begin as a zstd frame does.

    Parameters
    ----------
    block : Block
        As the file holds it.
    topics : mapping of int to Topic
        What the ids in the block mean.
    path : str
        Of the file, for messages.

    Raises
    ------
    BagError
        If a message cannot be expanded.
    """
    packed = {
        key
        for key, places in block.places.items()
        if places.starts.size and topics[key].encoding == 'cdr'
        if is_compressed(block.data[places.starts[0] : places.starts[0] + 4].tobytes())
    }
    if not packed:
        return block
    messages: dict[int, list[tuple[int, bytes]]] = {}
    budget = LARGEST_CHUNK
    for topic, places in block.places.items():
        rows: list[tuple[int, bytes]] = []
        for stamp, start, length in zip(*(part.tolist() for part in places), strict=True):
            raw = block.data[start : start + length].tobytes()
            if topic in packed:
                try:
                    raw = expand_zstd(raw, budget)
                except ValueError as error:
                    raise BagError(f'{path}: a message at {stamp} ns: {error}') from error
            budget -= len(raw)
            rows.append((stamp, raw))
        messages[topic] = rows
    return pack_messages(messages)


def strided(data: NDArray[np.uint8], kind: str, offset: int) -> NDArray[Any]:
    """
    View the bytes as overlapping numbers: element i is the number at byte i + offset.

    Indexing it with an array of positions gathers one field of many messages at once.
    """
    step = np.dtype(kind).itemsize
    count = max(0, data.size - offset - step + 1)
    view: NDArray[Any] = np.ndarray((count,), dtype=kind, buffer=data, offset=offset, strides=(1,))
    return view
