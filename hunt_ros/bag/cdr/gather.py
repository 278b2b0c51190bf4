"""
Numbers out of a block: one field of many messages at once, in numpy.

All messages of one layout have a field at the same place. A few layouts are tried
one after the other (a frame_id that changed in length is a new layout); what is
left is walked message by message.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag.blocks import Block, Places, strided
from hunt_ros.bag.cdr.layout import FieldPath, FieldPlace, PathError, extent, locate
from hunt_ros.bag.cdr.message_types import Definitions

#: Layouts gathered as arrays before the rest is walked one by one.
MOST_LAYOUTS = 8

#: Some rows, or all of them.
_Rows: TypeAlias = NDArray[np.int64] | slice


class Wanted(NamedTuple):
    """
    Which field of which type, and where its stamp is (None: the log time).

    With a `joint`, `field` is that of a JointState ('position'), and its element the one
    that has the joint's name; messages without it are passed over: several publishers may
    share a topic. `alone` takes the only element, whatever its name.
    """

    definitions: Definitions
    type: str
    field: FieldPath
    stamp: FieldPath | None
    joint: str = ''
    alone: bool = False


class Gathered(NamedTuple):
    """
    Log times, header stamps (ns) and values, shape (n,), in the order of the places.

    `named` tells which of them have the name that is wanted, `joints` are the names of all that
    were taken, `others` those in messages of other joints; `passed` counts the messages that have
    no number where one is expected, by what is wrong with them.
    """

    log_ns: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    values: NDArray[np.float64]
    named: NDArray[np.bool_]
    joints: set[str]
    others: set[str]
    passed: Counter[str]

    def of_name(self) -> Gathered:
        """Return those of the name that is wanted alone."""
        log_ns, stamps = self.log_ns[self.named], self.stamps_ns[self.named]
        values, others = self.values[self.named], self.others | self.joints
        return self._replace(log_ns=log_ns, stamps_ns=stamps, values=values, others=others)


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
    PathError
        If the field is no number, whatever the message.
    """
    stamps, values = places.log_ns.copy(), np.empty(places.starts.size)
    kept, named = np.ones((2, places.starts.size), dtype=bool)
    joints: set[str] = set()
    others: set[str] = set()
    passed: Counter[str] = Counter()
    for rows, layout in _layouts(block, places, wanted):
        if layout.field is not None:
            joints.add(layout.joint)
            named[rows] = layout.joint == wanted.joint
            _take(block.data, places.starts[rows], layout, rows, stamps, values)
            continue
        kept[rows] = False
        if layout.why:
            passed[layout.why] += places.starts[rows].size
        else:
            others.add(layout.joint)
    log_ns = places.log_ns
    if not kept.all():
        log_ns, stamps, values, named = log_ns[kept], stamps[kept], values[kept], named[kept]
    return Gathered(log_ns, stamps, values, named, joints, others, passed)


def _layouts(block: Block, places: Places, wanted: Wanted) -> Iterator[tuple[_Rows, _Layout]]:
    """Yield the layouts of the messages, and the rows of those that have each."""

    def layout_of(row: int) -> _Layout:
        """Return the layout of the message of a row."""
        start, length = int(places.starts[row]), int(places.lengths[row])
        try:
            return _layout(block.data[start : start + length].tobytes(), wanted)
        except PathError:
            raise
        except ValueError as error:  # this one alone
            return _Layout(None, None, 0, [], why=f'cannot be read ({error})')

    # While every message has fitted, all are addressed as they are, without selecting.
    left: _Rows = slice(None)
    rows = np.arange(places.starts.size)
    for _ in range(MOST_LAYOUTS):
        if not rows.size:
            return
        layout = layout_of(int(rows[0]))
        if not layout.end:
            yield rows[:1], layout
            left = rows = rows[1:]
            continue
        fits = _fits(block.data, places.starts[left], places.lengths[left], layout)
        if fits is None:
            yield left, layout
            return
        yield rows[fits], layout
        left = rows = rows[~fits]
    for row in rows.tolist():
        yield np.array([row]), layout_of(row)


class _Layout(NamedTuple):
    """
    Where the field and the stamp lie, and the bytes that tell a message of this layout.

    Without the number that is wanted, `field` is None, and `why` says what is wrong; where another
    joint has one that is nothing, and `joint` names those there are. `end` is 0 where no other
    message is like it.
    """

    field: FieldPlace | None
    stamp: tuple[FieldPlace, FieldPlace] | None
    end: int
    checks: list[tuple[int, str, int]]
    joint: str = ''
    why: str = ''


def _layout(message: bytes, wanted: Wanted) -> _Layout:
    """Find the wanted field in one message, and what a message has to begin with to be like it."""
    path, joint = wanted.field, ''
    # "CDR" and its byte order, and every length on the way: what fixes the field's place.
    expected = {0: message[:2]}
    if wanted.joint:
        names, count, lengths = _joints(message, wanted)
        # The names too; not what pads them, where a publisher leaves what its memory held.
        named = lengths[2 : 2 + len(names)]  # behind that of the frame, and how many names
        expected |= {at + 4: message[at + 4 : at + 4 + size] for at, size in named}
        expected |= {at: message[at : at + 4] for at, _ in lengths}
        alone = wanted.alone and len(names) < 2
        there = alone or wanted.joint in names
        element = names.index(wanted.joint) if there and not alone else 0
        if not there or element >= count:
            more = f' and {len(names) - 12} more' if len(names) > 12 else ''
            shown = f'{", ".join(names[:12]) or "none"}{more}'
            end = max(at + len(raw) for at, raw in expected.items())
            why = f'hold no {path[0]} of {wanted.joint!r}' if there or not names else ''
            return _Layout(None, None, end, _checks(expected), shown, why)
        path = (*path, element)
        joint = wanted.joint if not alone else ''.join(names)
    field = locate(wanted.definitions, wanted.type, message, path)
    places, stamp = [field], None
    if wanted.stamp is not None:
        seconds = locate(wanted.definitions, wanted.type, message, (*wanted.stamp, 'sec'))
        rest = locate(wanted.definitions, wanted.type, message, (*wanted.stamp, 'nanosec'))
        stamp = (seconds, rest)
        places.append(rest)
    for place in places:
        expected |= {at: message[at : at + 4] for at, _ in place.lengths}
    end = max(place.offset + place.size for place in places)
    return _Layout(field, stamp, end, _checks(expected), joint)


def _joints(message: bytes, wanted: Wanted) -> tuple[list[str], int, list[tuple[int, int]]]:
    """
    Return the joints in a message, how many numbers it has, and the lengths up to these.

    A message of velocities alone has no position.
    """
    try:
        _, lengths = extent(wanted.definitions, wanted.type, message)
        # Of the frame, of the names, of each name; of positions, velocities and efforts.
        first = 2 + lengths[1][1]
        names = [message[at + 4 : at + 3 + size].decode('utf-8') for at, size in lengths[2:first]]
        field = first + ('position', 'velocity', 'effort').index(str(wanted.field[0]))
        return names, lengths[field][1], lengths[: field + 1]
    except Exception as error:  # whatever the walk meets in damaged bytes
        raise ValueError('the message is not as its type says') from error


def _checks(expected: dict[int, bytes]) -> list[tuple[int, str, int]]:
    """Cut expected bytes into (offset, kind, value) of few numbers: each costs a gather."""
    checks = []
    for offset, raw in expected.items():
        while raw:
            size = next(size for size in (8, 4, 2, 1) if size <= len(raw))
            checks.append((offset, f'<u{size}', int.from_bytes(raw[:size], 'little')))
            offset, raw = offset + size, raw[size:]
    return checks


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
    fits = whole
    for offset, kind, value in layout.checks:
        fits &= strided(data, kind, offset)[safe] == np.array(value, dtype=kind)
    return None if fits.all() else fits


def _take(
    data: NDArray[np.uint8],
    starts: NDArray[np.int64],
    layout: _Layout,
    rows: _Rows,
    stamps: NDArray[np.int64],
    values: NDArray[np.float64],
) -> None:
    """Copy the field, and the stamp, of messages of one layout into their rows."""
    assert layout.field is not None
    values[rows] = strided(data, layout.field.kind, layout.field.offset)[starts]
    if layout.stamp is not None:
        seconds, rest = layout.stamp
        # The two stand side by side: one gather for both.
        both = strided(data, '<u8', seconds.offset)[starts].view(np.uint8).reshape(-1, 8)
        whole = both[:, :4].view(seconds.kind)[:, 0].astype(np.int64)
        whole *= 1_000_000_000
        whole += both[:, 4:].view(rest.kind)[:, 0]
        stamps[rows] = whole
