"""
The stamps of one channel: which of its samples count, how far its clock is away, what waits.

What comes out has been checked, and nobody behind the door checks it again: stamps of a channel
are whole nanoseconds that increase, each in one block alone.
"""

from __future__ import annotations

from collections import Counter, deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.samples import CLOCK_OFFSET_NS, CLOCK_RESET_NS, NANOSECONDS

#: Bits that ride on the next accepted sample: what went wrong since the one before.
REPEATED, BACKWARD, AHEAD, LATE = 1, 2, 4, 8
#: The reasons to refuse a sample, as they are counted. 'clock': it waited when its clock was set.
_REASONS = {REPEATED: 'repeated', BACKWARD: 'backward', AHEAD: 'ahead', LATE: 'late', 0: 'clock'}

#: A stamp further ahead than this waits for the next one to confirm it: one bad stamp would make
#: all that follow come too late.
_STAMP_JUMP_NS = NANOSECONDS
#: The least delay is taken over this time: longer than a network holds samples back while they
#: keep coming; in it clocks that drift by 100 ppm move by 0.2 ms.
_WINDOW_NS = 2 * NANOSECONDS
#: ... and over this many ticks at least: those of a machine that is too busy may all be late.
_LEAST = 10

Stamps = NDArray[np.int64]
Values = NDArray[np.float64]
Marks = NDArray[np.uint8]


class _Queue:
    """Accepted samples of one channel and epoch: arrays that grow behind and shrink in front."""

    def __init__(self) -> None:
        #: Stamps, values and marks.
        self._arrays: list[NDArray[Any]] = [
            np.empty(0, dtype) for dtype in (np.int64, np.float64, np.uint8)
        ]
        self._head = self._tail = 0
        self.newest_ns: int | None = None  # of all it was ever given
        #: The present run without a leap: its first stamp, and the one before the leap.
        self.run_ns: int | None = None
        self.before_run_ns: int | None = None

    def __len__(self) -> int:
        return self._tail - self._head

    @property
    def stamps(self) -> Stamps:
        """Stamps of the waiting samples, ns, shape (n,); valid until the next call."""
        return self._arrays[0][self._head : self._tail]

    def leapt_beyond(self, stamp_ns: int) -> bool:
        """Return True if the present run began with a leap over a stamp."""
        if self.run_ns is None or self.before_run_ns is None:
            return False
        return self.before_run_ns < stamp_ns < self.run_ns

    def _room(self, count: int) -> int:
        """Make room for more samples; return the place of the first."""
        if self._tail + count > self._arrays[0].size:
            waiting, size = len(self), max(256, 2 * (len(self) + count))
            self._arrays = [
                np.concatenate([old[self._head : self._tail], np.empty(size - waiting, old.dtype)])
                for old in self._arrays
            ]
            self._head, self._tail = 0, waiting
        self._tail += count
        return self._tail - count

    def push(
        self, stamps_ns: Stamps | int, values: Values | float, marks: Marks | int = 0
    ) -> None:
        """Append samples, n > 0, or one, without a leap but for the first: it begins a run."""
        stamps = np.atleast_1d(stamps_ns)
        place, first = self._room(stamps.size), int(stamps[0])
        for array, new in zip(self._arrays, (stamps, values, marks), strict=True):
            array[place : self._tail] = new
        if self.newest_ns is None or first - self.newest_ns > _STAMP_JUMP_NS:
            self.run_ns, self.before_run_ns = first, self.newest_ns
        self.newest_ns = int(stamps[-1])

    def extend(self, later: _Queue) -> None:
        """Append all that waits in another queue, at least one; its runs go on here."""
        stamps, values, marks = (array[later._head : later._tail] for array in later._arrays)
        self.push(stamps, values, marks)
        self.newest_ns = later.newest_ns
        self.run_ns, self.before_run_ns = later.run_ns, later.before_run_ns

    def take(self, until_ns: int) -> tuple[Stamps, Values, Marks, tuple[int, float] | None]:
        """Remove the samples with stamp <= until_ns, and look at the next one."""
        end = self._head + int(np.searchsorted(self.stamps, until_ns, side='right'))
        stamps, values, marks = (array[self._head : end].copy() for array in self._arrays)
        self._head = end
        following = (int(self.stamps[0]), float(self._arrays[1][end])) if len(self) else None
        return stamps, values, marks, following

    def mark_first(self, mark: int) -> None:
        """Add a mark to the sample that waits longest."""
        self._arrays[2][self._head] |= mark

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
    - Stamps that stay behind by more than `CLOCK_RESET_NS`, in order, for that long:
      the clock was set back. They open a new *epoch*, in which time starts again.
    - Further ahead than `_STAMP_JUMP_NS`: held back until the next sample confirms it
      by being newer still; refused as `AHEAD` when the next one falls back behind it.

    Attributes
    ----------
    queues : list of _Queue
        Accepted samples, one queue an epoch, the present epoch of the door first.
    refused : Counter of str
        Samples refused so far, by reason.
    refused_since : int
        Samples refused since the last accepted one.
    received, received_ns : int, int or None
        Number of samples that came, and the stamp of the last one as it came.
    silent : bool
        It was let go and is not back.
    """

    def __init__(self, timeout_ns: int) -> None:
        self.timeout_ns = timeout_ns
        self.clock = ChannelClock()
        self.queues = [_Queue()]
        self.refused = Counter(dict.fromkeys(_REASONS.values(), 0))
        self.refused_since = 0
        self.received = 0
        self.received_ns: int | None = None
        self.silent = False
        self._held: tuple[int, float] | None = None
        self._behind: list[tuple[int, float]] = []
        self._mark = 0

    @property
    def newest_ns(self) -> int | None:
        """Newest stamp of the present epoch, also when that sample is gone, ns."""
        return self.queues[0].newest_ns

    def push(self, stamps_ns: Stamps, values: Values) -> None:
        """Judge samples in the order given; arrays of shape (n,), n > 0."""
        shift, queue = self.clock.shift_ns, self.queues[-1]
        newest, run = queue.newest_ns, queue.run_ns
        self.received += stamps_ns.size
        self.received_ns = int(stamps_ns[-1])
        if stamps_ns.size == 1:
            self._push_one(int(stamps_ns[0]) + shift, float(values[0]))
        else:
            self._push_all(stamps_ns + shift, values)
        if self.queues[-1] is not queue or self.queues[-1].run_ns != run:
            self.clock.begin_anew()
        last = self.queues[-1].newest_ns
        if last is not None and last != newest:
            self.clock.take(last - shift)

    def _push_all(self, stamps_ns: Stamps, values: Values) -> None:
        steps = np.diff(stamps_ns)
        odd = np.flatnonzero((steps <= 0) | (steps > _STAMP_JUMP_NS)) + 1
        begin = 0
        while begin < stamps_ns.size:
            first, last = int(stamps_ns[begin]), self.queues[-1].newest_ns
            end = begin + 1
            if self._held is None and last is not None and 0 < first - last <= _STAMP_JUMP_NS:
                self._accept(first, float(values[begin]))
                place = int(np.searchsorted(odd, begin, side='right'))
                end = int(odd[place]) if place < odd.size else stamps_ns.size
                if end > begin + 1:
                    self.queues[-1].push(stamps_ns[begin + 1 : end], values[begin + 1 : end])
            else:
                self._push_one(first, float(values[begin]))
            begin = end

    def _push_one(self, stamp_ns: int, value: float) -> None:
        if self._held is not None:
            held, self._held = self._held, None
            if stamp_ns > held[0]:
                self._accept(*held)
            else:
                self._refuse(AHEAD)
        last = self.queues[-1].newest_ns
        if last is not None and last - stamp_ns > CLOCK_RESET_NS:
            self._step_back(stamp_ns, value)
        elif last is not None and stamp_ns <= last:
            self._drop_behind()
            self._refuse(REPEATED if stamp_ns == last else BACKWARD)
        elif last is not None and stamp_ns - last > _STAMP_JUMP_NS:
            self._drop_behind()
            self._held = (stamp_ns, value)
        else:
            self._accept(stamp_ns, value)

    def _step_back(self, stamp_ns: int, value: float) -> None:
        """Keep a stamp that is far behind; where such ones last, the clock was set back."""
        if self._behind and not 0 < stamp_ns - self._behind[-1][0] <= _STAMP_JUMP_NS:
            self._drop_behind()
        self._behind.append((stamp_ns, value))
        self.refused_since += 1
        if stamp_ns - self._behind[0][0] >= CLOCK_RESET_NS:
            behind, self._behind = self._behind, []
            self.queues.append(_Queue())
            self._mark |= BACKWARD
            for one in behind:
                self._accept(*one)

    def _accept(self, stamp_ns: int, value: float) -> None:
        self._drop_behind()
        self.queues[-1].push(stamp_ns, value, self._mark)
        self._mark = self.refused_since = 0

    def _refuse(self, reason: int) -> None:
        self.refused[_REASONS[reason]] += 1
        self.refused_since += 1
        self._mark |= reason

    def _drop_behind(self) -> None:
        """Refuse those that stayed behind: the clock was not set back."""
        self.refused_since -= len(self._behind)  # they were counted there when they came
        for _ in self._behind:
            self._refuse(BACKWARD)
        self._behind.clear()

    def drop(self, begin: int, end: int, reason: int, epoch: int = 0) -> None:
        """Refuse samples begin..end that wait already."""
        self.refused[_REASONS[reason]] += end - begin
        marks = self.queues[epoch].drop(begin, end, reason)
        if marks:  # nothing waits that could carry them
            self.refused_since += end - begin
            self._mark |= marks

    def returned_ns(self) -> int | None:
        """
        Stamp at which a clock that had leapt is back where it would have been; None if not.

        The leap, ahead or back, must have lasted as long as the stamps say it did. A set
        clock, or a channel that was off for a while, does not do that.
        """
        if len(self.queues) < 2:
            return None
        old, new = self.queues[:2]
        newest = old.newest_ns
        if not len(new) or newest is None:
            return None
        first = int(new.stamps[0])
        if old.leapt_beyond(first):
            away, since = newest - (old.run_ns or 0), first - (old.before_run_ns or 0)
            return first if abs(away - since) <= _STAMP_JUMP_NS else None
        place = int(np.searchsorted(new.stamps, newest, side='right'))
        if not 0 < place < len(new):
            return None
        back, end = int(new.stamps[place]), int(new.stamps[place - 1])
        away, since = end - first, back - newest
        leapt = back - end > _STAMP_JUMP_NS
        return back if leapt and abs(away - since) <= _STAMP_JUMP_NS else None

    def rejoin(self) -> None:
        """Go on in the present epoch after a leap, without the samples taken in it."""
        old, new = self.queues[:2]
        first, newest = int(new.stamps[0]), old.newest_ns
        if old.leapt_beyond(first):
            count = len(old) - int(np.searchsorted(old.stamps, first))
            self.refused['ahead'] += count
            new.mark_first(old.drop(len(old) - count, len(old), AHEAD))
        elif newest is not None:
            self.drop(0, int(np.searchsorted(new.stamps, newest, side='right')), BACKWARD, 1)
        old.extend(self.queues.pop(1))

    def go_on_from(self, position_ns: int | None, shift_ns: int) -> None:
        """Go on after a position with stamps of another offset; drop what waits."""
        self.refused['clock'] += sum(len(queue) for queue in self.queues)
        self.refused['clock'] += len(self._behind) + (self._held is not None)
        self.start_again()
        self.queues[0].newest_ns = position_ns
        self.clock.shift_ns = shift_ns

    def start_again(self) -> None:
        """Forget what waits and the newest stamp: the clock starts anew."""
        self.queues = [_Queue()]
        self._held = None
        self._behind.clear()

    def finish(self) -> None:
        """End of the record: accept a sample still held back, refuse those still behind."""
        if self._held is not None:
            held, self._held = self._held, None
            self._accept(*held)
        self._drop_behind()
