"""
Numbers out of a block: one field of many messages at once, in numpy.

All messages of one layout have a field at the same place. A few layouts are tried
one after the other (a frame_id that changed in length is a new layout); what is
left is walked message by message.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag.blocks import Block, Places
from hunt_ros.bag.cdr_layout import locate, locate_texts
from hunt_ros.bag.cdr_walker import FieldPath, FieldPlace
from hunt_ros.bag.mcap_places import strided
from hunt_ros.bag.message_types import Definitions

#: Layouts gathered as arrays before the rest is walked one by one.
MOST_LAYOUTS = 8


class Wanted(NamedTuple):
    """
    Which field of which type, and where its stamp is (None: the log time).

    With a `joint`, `field` is that of a JointState ('position'), and its element the one
    that has the joint's name in each message; `alone` takes the only element, whatever
    its name.
    """

    definitions: Definitions
    type: str
    field: FieldPath
    stamp: FieldPath | None
    joint: str = ''
    alone: bool = False


class Gathered(NamedTuple):
    """Header stamps (ns) and values, shape (n,), in the order of the places."""

    stamps_ns: NDArray[np.int64]
    values: NDArray[np.float64]


def gather(block: Block, places: Places, wanted: Wanted) -> Gathered:
    """
    Gather a field of every message at `places`.

    Parameters
    ----------
    block : Block
        Holds the messages.
    places : Places
        Of one topic.
    wanted : Wanted
        Checked before: the field is a number.

    Raises
    ------
    ValueError
        If a message has no such element, or is no message of its type.
    """
    count = places.starts.size
    stamps = places.log_ns.copy()
    values = np.empty(count)
    # While every message has fitted, all are addressed as they are, without selecting.
    left: NDArray[np.int64] | None = None
    for _ in range(MOST_LAYOUTS):
        starts = places.starts if left is None else places.starts[left]
        lengths = places.lengths if left is None else places.lengths[left]
        if not starts.size:
            return Gathered(stamps, values)
        layout = _layout(_message(block, int(starts[0]), int(lengths[0])), wanted)
        fits = _fits(block.data, starts, lengths, layout)
        if fits is None:
            rows: NDArray[np.int64] | slice = slice(None) if left is None else left
            _take(block.data, starts, layout, rows, stamps, values)
            return Gathered(stamps, values)
        rows = np.flatnonzero(fits) if left is None else left[fits]
        _take(block.data, starts[fits], layout, rows, stamps, values)
        left = np.flatnonzero(~fits) if left is None else left[~fits]
    assert left is not None
    for row in left.tolist():
        start, length = int(places.starts[row]), int(places.lengths[row])
        layout = _layout(_message(block, start, length), wanted)
        one = np.array([row], dtype=np.int64)
        _take(block.data, places.starts[one], layout, one, stamps, values)
    return Gathered(stamps, values)


class _Layout(NamedTuple):
    field: FieldPlace
    stamp: tuple[FieldPlace, FieldPlace] | None
    encapsulation: int
    lengths: tuple[tuple[int, int], ...]
    end: int
    name: tuple[int, bytes] | None


def _message(block: Block, start: int, length: int) -> bytes:
    return block.data[start : start + length].tobytes()


def _layout(message: bytes, wanted: Wanted) -> _Layout:
    name, path = None, wanted.field
    if wanted.joint:
        index, name = _joint(message, wanted)
        path = (*path, index)
    field = locate(wanted.definitions, wanted.type, message, path)
    lengths, end = field.lengths, field.offset + field.size
    stamp = None
    if wanted.stamp is not None:
        seconds = locate(wanted.definitions, wanted.type, message, (*wanted.stamp, 'sec'))
        rest = locate(wanted.definitions, wanted.type, message, (*wanted.stamp, 'nanosec'))
        stamp = (seconds, rest)
        lengths = tuple(sorted({*lengths, *rest.lengths}))
        end = max(end, rest.offset + rest.size)
    return _Layout(field, stamp, message[1], lengths, end, name)


def _joint(message: bytes, wanted: Wanted) -> tuple[int, tuple[int, bytes] | None]:
    """Find the element that has the joint's name, and where the name stands."""
    names = locate_texts(wanted.definitions, wanted.type, message, 'name')
    for index, (offset, text) in enumerate(names):
        if text == wanted.joint.encode() + b'\0':
            return index, (offset, text)
    if wanted.alone and len(names) < 2:
        return 0, None
    shown = ', '.join(text.rstrip(b'\0').decode('utf-8', 'replace') for _, text in names[:12])
    raise ValueError(f'there is no joint {wanted.joint!r}, it has {shown or "none"}')


def _fits(
    data: NDArray[np.uint8],
    starts: NDArray[np.int64],
    lengths: NDArray[np.int64],
    layout: _Layout,
) -> NDArray[np.bool_] | None:
    """Which messages have the layout; None where all have."""
    whole = lengths >= layout.end
    # Names stand before the field, so the end of the field is the end of what is looked at.
    safe = starts if whole.all() else np.where(whole, starts, starts[0])
    # The two bytes that say "CDR" and the byte order.
    fits = whole & (strided(data, '<u2', 0)[safe] == layout.encapsulation << 8)
    order = '<' if layout.encapsulation else '>'
    for offset, value in layout.lengths:
        fits &= strided(data, f'{order}u4', offset)[safe] == value
    if layout.name is not None:
        offset, text = layout.name
        fits &= strided(data, f'S{len(text)}', offset)[safe] == text.rstrip(b'\0')
    return None if fits.all() else fits


def _take(
    data: NDArray[np.uint8],
    starts: NDArray[np.int64],
    layout: _Layout,
    rows: NDArray[np.int64] | slice,
    stamps: NDArray[np.int64],
    values: NDArray[np.float64],
) -> None:
    values[rows] = strided(data, layout.field.kind, layout.field.offset)[starts]
    if layout.stamp is not None:
        seconds, rest = layout.stamp
        whole = strided(data, seconds.kind, seconds.offset)[starts].astype(np.int64)
        whole *= 1_000_000_000
        whole += strided(data, rest.kind, rest.offset)[starts]
        stamps[rows] = whole
