"""
The stamps of one channel: which of its samples count, how far its clock is away, what waits.

What comes out has been checked, and nobody behind the door checks it again: stamps of a channel
are whole nanoseconds that increase, each in one block alone.
"""

from __future__ import annotations

import itertools
from collections import Counter, deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.samples import CLOCK_OFFSET_NS, CLOCK_RESET_NS, NANOSECONDS

#: Bits that ride on the next accepted sample: what went wrong since the one before.
REPEATED, BACKWARD, AHEAD, LATE = 1, 2, 4, 8
#: The reasons to refuse a sample, as they are counted. 'clock': it waited when its clock was set.
_REASONS = {REPEATED: 'repeated', BACKWARD: 'backward', AHEAD: 'ahead', LATE: 'late', 0: 'clock'}

#: A stamp further ahead than this has leapt; one that goes on is off by no more.
_STAMP_JUMP_NS = NANOSECONDS
#: A leap counts once it has lasted for so long: one bad stamp would make all that follow too late.
_LASTS_NS = NANOSECONDS
#: A leap ahead is not taken back once the samples of the others further ahead than this are gone:
#: they leapt as well, or they are ahead because a replay feeds a stretch of each in turn.
_GONE_NS = 3 * NANOSECONDS
#: The least delay is taken over this time: longer than a network holds samples back while they
#: keep coming; in it clocks that drift by 100 ppm move by 0.2 ms.
_WINDOW_NS = 2 * NANOSECONDS
#: ... and over this many ticks at least: those of a machine that is too busy may all be late.
_LEAST = 10

Stamps = NDArray[np.int64]
Values = NDArray[np.float64]
Marks = NDArray[np.uint8]


class _Run:
    """
    Accepted samples of one channel: arrays that grow behind and shrink in front.

    Parameters
    ----------
    back : bool
        It began with a leap back.
    """

    def __init__(self, back: bool = False) -> None:
        self.back = back
        #: Stamps, values and marks.
        self._arrays: list[NDArray[Any]] = [
            np.empty(0, dtype) for dtype in (np.int64, np.float64, np.uint8)
        ]
        self._head = self._tail = 0
        self.newest_ns: int | None = None  # of all it was ever given
        self.first_ns = 0  # likewise, or behind its last leap ahead
        self.before_ns: int | None = None  # stamp before that leap

    def __len__(self) -> int:
        return self._tail - self._head

    @property
    def stamps(self) -> Stamps:
        """Stamps of the waiting samples, ns, shape (n,); valid until the next call."""
        return self._arrays[0][self._head : self._tail]

    @property
    def length_ns(self) -> int:
        """Time since `first_ns`."""
        return 0 if self.newest_ns is None else self.newest_ns - self.first_ns

    @property
    def lasts(self) -> bool:
        """True once it counts."""
        return self.length_ns >= _LASTS_NS

    def push(self, stamps_ns: Stamps, values: Values, marks: Marks) -> None:
        """Append samples, n > 0."""
        if self._tail + stamps_ns.size > self._arrays[0].size:
            waiting, size = len(self), max(256, 2 * (len(self) + stamps_ns.size))
            self._arrays = [
                np.concatenate([old[self._head : self._tail], np.empty(size - waiting, old.dtype)])
                for old in self._arrays
            ]
            self._head, self._tail = 0, waiting
        place, self._tail = self._tail, self._tail + stamps_ns.size
        for array, new in zip(self._arrays, (stamps_ns, values, marks), strict=True):
            array[place : self._tail] = new
        if self.newest_ns is None:
            self.first_ns = int(stamps_ns[0])
        self.newest_ns = int(stamps_ns[-1])

    def extend(self, later: _Run) -> None:
        """Append a run behind a leap ahead."""
        self.before_ns, self.first_ns = self.newest_ns, later.first_ns
        self.push(*(array[later._head : later._tail] for array in later._arrays))

    def take(self, until_ns: int) -> tuple[Stamps, Values, Marks, tuple[int, float] | None]:
        """Remove the samples with stamp <= until_ns, and look at the next one."""
        end = self._head + int(np.searchsorted(self.stamps, until_ns, side='right'))
        stamps, values, marks = (array[self._head : end].copy() for array in self._arrays)
        self._head = end
        following = (int(self.stamps[0]), float(self._arrays[1][end])) if len(self) else None
        return stamps, values, marks, following

    def drop(self, begin: int, end: int, mark: int) -> int:
        """Remove waiting samples; their marks go to the next one, or back where there is none."""
        if end <= begin:
            return 0
        first, after = self._head + begin, self._head + end
        marks = mark | int(np.bitwise_or.reduce(self._arrays[2][first:after]))
        if begin == 0:
            self._head = after
        else:
            for array in self._arrays:
                array[first : self._tail - (end - begin)] = array[after : self._tail]
            self._tail -= end - begin
            after = first
        if after == self._tail:
            return marks
        self._arrays[2][after] |= marks
        return 0


class ChannelClock:
    """
    Follows the offset of a channel's clock.

    The delay of a sample is the time from its stamp to the tick after which it was there. A
    delay has a part that changes, the way through the network, and one that stays: how far the
    two clocks are apart. The least delay over some seconds is their offset, and what exceeds it
    is how late the channel is now. This is the minimum-delay filter of NTP (Mills, 1991, IEEE
    Transactions on Communications 39, 1482-1493).

    Attributes
    ----------
    shift_ns : int
        Added to the stamps of the channel as they arrive.
    offset_ns : int or None
        The detector's clock less that of the channel, ns; None before the first sample.
    late_ns : int
        By how much the newest sample was older than that at the last tick, ns, and at least the
        time in which none came: the detector's clock may be set back meanwhile.
    fresh : bool
        Samples had come since the tick before.
    """

    def __init__(self) -> None:
        self.shift_ns = 0
        self.offset_ns: int | None = None
        self.late_ns = 0
        self.fresh = False
        self._last_tick_ns: int | None = None
        self._silence_ns = 0
        self._newest_ns: int | None = None  # stamp as it came
        self._taken = False
        #: Ticks after which new samples were there, and the delay then.
        self._delays: deque[tuple[int, int]] = deque()

    def take(self, newest_ns: int) -> None:
        """Take in the newest accepted stamp, as the channel's own clock tells it."""
        self._newest_ns = newest_ns
        self._taken = True

    def begin_anew(self) -> None:
        """The channel's clock was set: what was known of it counts no more."""
        self._delays.clear()

    def look(self, now_ns: int) -> None:
        """Compare with the detector's clock; where that stands still it tells nothing."""
        if now_ns == self._last_tick_ns:
            return
        if self._delays and now_ns < self._delays[-1][0]:
            self._delays.clear()  # that one was set back
        self.fresh, self._taken = self._taken, False
        step = 0 if self._last_tick_ns is None else max(now_ns - self._last_tick_ns, 0)
        self._last_tick_ns = now_ns
        self._silence_ns = 0 if self.fresh else self._silence_ns + step
        self.late_ns = self._silence_ns
        if self._newest_ns is None:
            return
        delay = now_ns - self._newest_ns
        if self.fresh:
            self._delays.append((now_ns, delay))
            while len(self._delays) > _LEAST and self._delays[1][0] <= now_ns - _WINDOW_NS:
                self._delays.popleft()
            self.offset_ns = min(known for _, known in self._delays)
        if self.offset_ns is not None:
            self.late_ns = max(delay - self.offset_ns, self._silence_ns)

    @property
    def settled(self) -> bool:
        """True where the offset was seen over the whole window."""
        if len(self._delays) < _LEAST:
            return False
        return self._delays[-1][0] - self._delays[0][0] >= _WINDOW_NS

    @property
    def believed(self) -> bool:
        """False where the channel's clock is too far away."""
        return self.offset_ns is None or abs(self.offset_ns) <= CLOCK_OFFSET_NS


class Channel:
    """
    One channel: its stamps judged in the order of their arrival, and what waits of it.

    The verdict on a stamp depends on the channel's own sequence alone, so it is the same
    however the samples of the channels are interleaved and cut into blocks.

    - Not newer than the last accepted one: refused, `REPEATED` or `BACKWARD`.
    - Further ahead than `_STAMP_JUMP_NS`, or behind by more than `CLOCK_RESET_NS`: a leap. What
      follows it waits in a *run* of its own until it lasts. Then a leap ahead is a gap, or a clock
      that was set; a leap back is a clock that was set back, and opens a new *epoch*, in which
      time starts again.
    - A leap is taken back by a stamp that goes on as if there had been none: all in between is
      refused, `AHEAD` or `BACKWARD`.

    Attributes
    ----------
    runs : list of _Run
        Accepted samples, the present epoch of the door first, then what waits behind leaps.
    refused : Counter of str
        Samples refused so far, by reason.
    refused_since : int
        Samples refused since the last accepted one.
    received, received_ns : int, int or None
        Number of samples that came, and the stamp of the last one as it came.
    silent : bool
        It was let go and is not back: what comes is too late.
    """

    def __init__(self, timeout_ns: int) -> None:
        self.timeout_ns = timeout_ns
        self.clock = ChannelClock()
        self.runs = [_Run()]
        self.refused = Counter(dict.fromkeys(_REASONS.values(), 0))
        self.refused_since = 0
        self.received = 0
        self.received_ns: int | None = None
        self.silent = False
        self._mark = 0
        self._old = 0  # so many of those that wait did so before the last call

    @property
    def newest_ns(self) -> int | None:
        """Newest stamp of the present epoch, also when that sample is gone, ns."""
        return self.runs[0].newest_ns

    @property
    def set_back(self) -> bool:
        """True where samples of the next epoch wait."""
        return any(run.back and run.lasts for run in self.runs[1:])

    @property
    def _sequence(self) -> tuple[_Run, int | None]:
        """The last run that counts, and the leap behind which it is."""
        run = next((run for run in self.runs[:0:-1] if run.lasts), self.runs[0])
        return run, run.before_ns

    def push(self, stamps_ns: Stamps, values: Values, position_ns: int | None = None) -> None:
        """
        Judge samples in the order given; arrays of shape (n,), n > 0.

        What lies behind the position, up to which all channels are given out, comes too late.
        """
        shift, before = self.clock.shift_ns, self._sequence
        newest_ns = before[0].newest_ns
        self._old = len(self.runs[0])
        self.received += stamps_ns.size
        self.received_ns = int(stamps_ns[-1])
        stamps, ends = stamps_ns + shift, [stamps_ns.size]
        if stamps.size > 1:
            steps = np.diff(stamps)
            ends[:0] = (np.flatnonzero((steps <= 0) | (steps > _STAMP_JUMP_NS)) + 1).tolist()
        for begin, end in itertools.pairwise([0, *ends]):
            self._take(stamps[begin:end], values[begin:end], position_ns)
        run, _ = after = self._sequence
        if after != before:
            self.clock.begin_anew()
        if run.newest_ns is not None and run.newest_ns != newest_ns:
            self.clock.take(run.newest_ns - shift)
        if self.silent:
            self.drop(self._old, len(self.runs[0]), LATE)
        elif position_ns is not None:
            self.drop(0, int(np.searchsorted(self.runs[0].stamps, position_ns, 'right')), LATE)

    def _take(self, stamps_ns: Stamps, values: Values, position_ns: int | None) -> None:
        """Take samples without a leap among them."""
        first_ns = int(stamps_ns[0])
        run, old = self._run_of(first_ns, position_ns), 0
        if run.newest_ns is not None and first_ns <= run.newest_ns:
            old = int(np.searchsorted(stamps_ns, run.newest_ns, side='right'))
        if old:
            repeated = int(stamps_ns[old - 1] == run.newest_ns)
            self._refuse(REPEATED, repeated)
            self._refuse(BACKWARD, old - repeated)
        if old < stamps_ns.size:
            marks = np.zeros(stamps_ns.size - old, dtype=np.uint8)
            marks[0] = self._mark
            run.push(stamps_ns[old:], values[old:], marks)
            self._mark = self.refused_since = 0
            if run.lasts and not run.back:
                self._join()

    def _run_of(self, stamp_ns: int, position_ns: int | None) -> _Run:
        """Return the run that a stamp belongs to; leaps that it takes back are gone then."""
        run, present = self.runs[-1], self.runs[0]
        if run.newest_ns is None or 0 < stamp_ns - run.newest_ns <= _STAMP_JUMP_NS:
            return run
        away_ns = 0
        for place in range(len(self.runs) - 1, 0, -1):
            away_ns += self.runs[place].length_ns
            if _goes_on(stamp_ns, self.runs[place - 1].newest_ns, away_ns):
                self._leave(place)
                return self.runs[-1]
        gone = position_ns is not None and position_ns - stamp_ns > _GONE_NS
        if not gone and _goes_on(stamp_ns, present.before_ns, away_ns + present.length_ns):
            self._leave(1)
            self._mark |= AHEAD
            begin = int(np.searchsorted(present.stamps, present.first_ns))
            self.drop(begin, len(present), AHEAD)
            self._old = min(self._old, begin)
            present.newest_ns, present.before_ns = present.before_ns, None
            return present
        step, waits = stamp_ns - run.newest_ns, len(self.runs) > 1
        if -CLOCK_RESET_NS <= step <= 0:
            return run
        if waits:
            beyond = run.back and stamp_ns > (self.runs[-2].newest_ns or 0)
            if step > 0 and (run.lasts or not beyond):
                return run
            if not run.lasts:
                self._leave(len(self.runs) - 1)
                return self._run_of(stamp_ns, position_ns)
        if step < 0:
            self._mark |= BACKWARD
        self.runs.append(_Run(back=step < 0))
        return self.runs[-1]

    def _join(self) -> None:
        """Go on behind the leap ahead, if there is one."""
        if len(self.runs) > 1 and not self.runs[1].back:
            self.runs[0].extend(self.runs.pop(1))

    def _leave(self, place: int) -> None:
        """Refuse the runs from a place on."""
        for run in self.runs[place:]:
            self._refuse(BACKWARD if run.back else AHEAD, len(run))
        del self.runs[place:]

    def _refuse(self, reason: int, count: int) -> None:
        if count:
            self.refused[_REASONS[reason]] += count
            self.refused_since += count
            self._mark |= reason

    def drop(self, begin: int, end: int, reason: int) -> None:
        """Refuse samples begin..end of the present epoch that wait already."""
        self.refused[_REASONS[reason]] += end - begin
        marks = self.runs[0].drop(begin, end, reason)
        if marks:  # nothing waits that could carry them
            self.refused_since += end - begin
            self._mark |= marks

    def next_epoch(self) -> None:
        """Go on behind the leap back, or without one with what comes."""
        back = next((place for place, run in enumerate(self.runs) if place and run.back), None)
        self.runs = [_Run()] if back is None else self.runs[back:]
        self.silent = False

    def go_on_from(self, position_ns: int | None, shift_ns: int) -> None:
        """Go on after a position with stamps of another offset; drop what waits."""
        self.refused['clock'] += sum(len(run) for run in self.runs)
        self.runs = [_Run()]
        self.runs[0].newest_ns = position_ns
        self.clock.shift_ns = shift_ns

    def finish(self) -> None:
        """End of the record: a leap ahead counts, one back that did not last does not."""
        self._join()
        if len(self.runs) > 1 and not self.runs[-1].lasts:
            self._leave(len(self.runs) - 1)


def _goes_on(stamp_ns: int, end_ns: int | None, away_ns: int) -> bool:
    """Return True for a stamp that goes on from an end as if there had been no leap since."""
    if end_ns is None or stamp_ns <= end_ns:
        return False
    return abs(stamp_ns - end_ns - away_ns) <= _STAMP_JUMP_NS
