"""
The judge of clocks: which times can be, which come first, and what is said of those who told them.

A message has two times: when it was logged, by the clock of its recorder, and the stamp in its
header, by that of a sensor. Either may be damaged, and either clock may stand still, be set while
it runs, or not be set at all. Reading, inspection, repair, import and export ask here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bursts import bursts_of
from hunt_ros.errors import MessageError
from hunt_ros.samples import CLOCK_RESET_NS, NANOSECONDS, Series, counted, different

#: No recording lasts longer, ns: 30 days.
LONGEST_NS = 30 * 86_400 * NANOSECONDS
#: A time so much before the one before is that of a clock that was set, ns.
SET_BACK_NS = NANOSECONDS // 10
#: Of so many stamps of a channel it is told whether its clock is that of the others: a tenth of
#: fewer than the second is the hiccup of a start.
_LOOKED_AT, _FEWEST_STAMPS = 1000, 100
#: So many samples of one stamp are no mistake of a sender: nothing can be told of their motion.
_FEWEST_TIMES = 10


def possible(times_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """
    Return False for times that damage has made: further from the others than a recording lasts.

    They are one of a few, or one in a hundred at most: where there are more a clock was set.
    """
    all_are = np.ones(times_ns.size, dtype=bool)
    if not times_ns.size or int(times_ns.max()) - int(times_ns.min()) <= LONGEST_NS:
        return all_are
    middle = int(np.median(times_ns))
    near = (times_ns >= middle - LONGEST_NS) & (times_ns <= middle + LONGEST_NS)
    return near if 100 * np.count_nonzero(~near) <= max(100, times_ns.size) else all_are


def span_of(parts: Sequence[NDArray[np.int64]]) -> tuple[int, int] | None:
    """Return the first and the last of the times, ns, that are possible; None without any."""
    times = np.concatenate([np.zeros(0, np.int64), *parts])
    times = times[possible(times)]
    return (int(times.min()), int(times.max())) if times.size else None


def going_on(times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """
    Return times, in the order of their writing, that go on where their clock was set back.

    A clock is set once; a writer that shuffles goes back all the time.
    """
    steps = np.diff(times_ns, prepend=times_ns[:1])
    back = steps < -SET_BACK_NS
    if not back.any() or 100 * np.count_nonzero(back) >= back.size:
        return times_ns
    on: NDArray[np.int64] = times_ns - np.cumsum(np.where(back, steps - int(np.median(steps)), 0))
    return on


def set_back(columns: Mapping[str, Series]) -> str:
    """Say which clocks were set back, and how many samples that concerns; '' where none was."""
    behind = {
        name: np.maximum.accumulate(one.stamps_ns) - one.stamps_ns
        for name, one in columns.items()
        if np.diff(one.stamps_ns).min(initial=0) < -SET_BACK_NS
    }
    if not behind:
        return ''
    most_s = max(int(one.max()) for one in behind.values()) / NANOSECONDS
    count = sum(np.count_nonzero(one) for one in behind.values())
    return (
        f'a clock was set back by {most_s:.3f} s: {count} samples of {", ".join(behind)} are'
        ' stamped before earlier ones, and kept'
    )


def apart(columns: Mapping[str, Series], logged: Mapping[str, NDArray[np.int64]]) -> str:
    """
    Say which channels are stamped by another clock than most: far from theirs, or drifting.

    Parameters
    ----------
    columns : mapping of str to Series
        By their stamps.
    logged : mapping of str to ndarray of int64
        When the messages of each were logged, ns.
    """
    off_s: dict[str, Any] = {}
    others: tuple[NDArray[np.int64], NDArray[np.float64]] | None = None
    for name, one in columns.items():
        some = np.linspace(0, len(one) - 1, _LOOKED_AT).astype(np.int64)
        if len(one) < _FEWEST_STAMPS or (np.diff(logged[name][some]) < 0).any():
            continue
        log_ns, stamps = logged[name][some], one.stamps_ns[some].astype(np.float64)
        others = others or (log_ns, stamps)
        both = (log_ns >= others[0][0]) & (log_ns <= others[0][-1])
        if np.count_nonzero(both) >= _FEWEST_STAMPS:
            off = (stamps[both] - np.interp(log_ns[both], *others)) / NANOSECONDS
            # Of a replay that runs faster a delay on the way is so much more by its stamps.
            off /= max(1.0, np.median(np.diff(stamps)) / max(1.0, np.median(np.diff(log_ns))))
            off_s[name] = np.array([np.median(end) for end in np.array_split(off, 10)[::9]])
    usual = np.sort([*off_s.values()], axis=0)[len(off_s) // 2] if off_s else 0.0
    told = [
        f'{name} is off by {begin:.3f} s at the beginning and {end:.3f} s at the end'
        for name, (begin, end) in ((name, one - usual) for name, one in off_s.items())
        if max(abs(begin), abs(end)) > CLOCK_RESET_NS / NANOSECONDS
        or abs(end - begin) > SET_BACK_NS / NANOSECONDS
    ]
    return f'not all channels are stamped by one clock: {", ".join(told)}' if told else ''


def refuse_still(columns: Mapping[str, Series], where: str) -> None:
    """Raise MessageError for a clock that stands still."""
    for name, one in columns.items():
        times = different(one.stamps_ns)
        if _FEWEST_TIMES * times < len(one) and bursts_of(one.stamps_ns) is None:
            raise MessageError(
                f'{where}: {name}: {len(one)} samples at {counted(times, "different time")}:'
                ' its clock stands still'
            )


def refuse_years(
    columns: Mapping[str, Series], where: str, longest_ns: float = LONGEST_NS
) -> tuple[int, int]:
    """
    Return the first and the last stamp, ns, where no year lies between them; 0, 0 without any.

    Raises
    ------
    MessageError
        Naming where they come from, and the one that is the farthest from the others: nearly all
        of the record would be empty.
    """
    ends = {
        int(end): name
        for name, one in columns.items()
        if len(one)
        for end in (one.stamps_ns.min(), one.stamps_ns.max())
    }
    first, last = min(ends, default=0), max(ends, default=0)
    if last - first > longest_ns:
        middle = float(np.median(np.concatenate([one.stamps_ns for one in columns.values()])))
        odd = max(ends, key=lambda end: abs(end - middle))
        raise MessageError(
            f'{where}: {ends[odd]}: a stamp of {odd / NANOSECONDS:.10g} s,'
            f' {abs(odd - middle) / NANOSECONDS:.3g} s from the others:'
            ' its clock was not set, or the unit of its times is another one'
        )
    return first, last
