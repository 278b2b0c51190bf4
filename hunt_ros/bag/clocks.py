"""
The judge of clocks: which times can be, which come first, and what is said of those who told them.

A message has two times: when it was logged, by the clock of its recorder, and the stamp in its
header, by that of a sensor. Either may be damaged, and either clock may stand still, be set while
it runs, or not be set at all. Reading, inspection, repair, import and export ask here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bursts import bursts_of
from hunt_ros.errors import MessageError
from hunt_ros.samples import CLOCK_RESET_NS, NANOSECONDS, Series, counted, different

#: No recording lasts longer, ns: 30 days.
LONGEST_NS = 30 * 86_400 * NANOSECONDS
#: A time so much before the one before is that of a clock that was set, ns.
SET_BACK_NS = NANOSECONDS // 10
#: At so many times it is looked whether the clock of a channel is that of the others: a tenth of
#: fewer stamps than the second is the hiccup of a start.
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
    some: dict[str, tuple[NDArray[np.int64], NDArray[np.int64]]] = {}
    for name, log_ns in logged.items():
        few = slice(None, None, 1 + log_ns.size // _LOOKED_AT)
        if log_ns.size >= _FEWEST_STAMPS and (np.diff(log_ns[few]) >= 0).all():
            some[name] = log_ns[few], columns[name].stamps_ns[few]
    begin = max((int(log_ns[0]) for log_ns, _ in some.values()), default=0)
    end = min((int(log_ns[-1]) for log_ns, _ in some.values()), default=0)
    if end - begin < SET_BACK_NS:
        return ''
    at = np.linspace(begin, end, _LOOKED_AT)
    stamps = np.array([np.interp(at, *one) for one in some.values()])
    usual = np.sort(stamps, axis=0)[len(some) // 2]
    # Of a replay that runs faster a delay on the way is so much more by its stamps.
    off_s = (stamps - usual) / NANOSECONDS / max(1.0, float(np.ptp(usual)) / (end - begin))
    ends = np.median(np.array_split(off_s, 10, axis=1)[::9], axis=2)
    told = [
        f'{name} is off by {first:.3f} s at the beginning and {last:.3f} s at the end'
        for name, first, last in zip(some, *ends, strict=True)
        if max(abs(first), abs(last)) > CLOCK_RESET_NS / NANOSECONDS
        or abs(last - first) > SET_BACK_NS / NANOSECONDS
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
