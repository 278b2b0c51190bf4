"""
The stamps of one channel: which of its samples count, how far its clock is away, what waits.

What comes out has been checked, and nobody behind the door checks it again: stamps of a channel
are whole nanoseconds that increase, each in one block alone.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right
from collections import Counter, deque

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
    """
    Accepted samples of one channel and epoch that wait.

    Attributes
    ----------
    stamps, values, marks : array
        Of the samples.
    newest_ns : int or None
        Of all it was ever given.
    run_ns, before_run_ns : int or None
        The present run without a leap: its first stamp, and the one before the leap.
    """

    def __init__(self) -> None:
        self.stamps, self.values, self.marks = array('q'), array('d'), array('B')
        self.newest_ns: int | None = None
        self.run_ns: int | None = None
        self.before_run_ns: int | None = None

    def push(self, stamps_ns: Stamps, values: Values, mark: int) -> None:
        """Append samples, n > 0, the first with a mark; if it leaps, it begins a run."""
        first = int(stamps_ns[0])
        self.stamps.frombytes(stamps_ns.tobytes())
        self.values.frombytes(values.tobytes())
        self.marks.frombytes(bytes([mark]) + bytes(stamps_ns.size - 1))
        if self.newest_ns is None or first - self.newest_ns > _STAMP_JUMP_NS:
            self.run_ns, self.before_run_ns = first, self.newest_ns
        self.newest_ns = int(stamps_ns[-1])

    def extend(self, later: _Queue) -> None:
        """Append all that waits in another queue; its runs go on here."""
        self.stamps += later.stamps
        self.values += later.values
        self.marks += later.marks
        self.newest_ns = later.newest_ns
        self.run_ns, self.before_run_ns = later.run_ns, later.before_run_ns

    def split(self, until_ns: int) -> _Queue:
        """Move what waits with later stamps into a queue of its own."""
        later, place = _Queue(), bisect_right(self.stamps, until_ns)
        later.extend(self)
        later._remove(slice(place))
        self._remove(slice(place, None))
        return later

    def take(self, until_ns: int) -> tuple[Stamps, Values, Marks, tuple[int, float] | None]:
        """Remove the samples with stamp <= until_ns, and look at the next one."""
        end = bisect_right(self.stamps, until_ns)
        found = (
            np.array(self.stamps[:end]),
            np.array(self.values[:end]),
            np.array(self.marks[:end]),
        )
        self._remove(slice(0, end))
        return *found, (self.stamps[0], self.values[0]) if self.stamps else None

    def drop(self, begin: int, end: int, mark: int) -> int:
        """Remove waiting samples; their marks go to the next one, or back where there is none."""
        marks = mark | int(np.bitwise_or.reduce(np.array(self.marks[begin:end])))
        self._remove(slice(begin, end))
        if begin == len(self.marks):
            return marks
        self.marks[begin] |= marks
        return 0

    def _remove(self, part: slice) -> None:
        del self.stamps[part], self.values[part], self.marks[part]


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
        self.refused = Counter(dict.fromkeys(_REASONS.values(), 0))
        self.refused_since = 0
        self.received = 0
        self.received_ns: int | None = None
        self.silent = False
        self._mark = 0
        self.start_again()

    def start_again(self) -> None:
        """Forget what waits and the newest stamp: the clock starts anew."""
        self.queues = [_Queue()]
        #: What stands apart: a sample far ahead until the next one confirms it, or those that
        #: stay far behind until they have lasted.
        self._apart = _Queue()

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
        stamps_ns = stamps_ns + shift
        steps = np.diff(stamps_ns)
        odd = np.flatnonzero((steps <= 0) | (steps > _STAMP_JUMP_NS)) + 1
        ends = np.append(odd, stamps_ns.size)
        begin = 0
        while begin < stamps_ns.size:
            first, last, end = int(stamps_ns[begin]), self.queues[-1].newest_ns, begin + 1
            usual = last is not None and 0 < first - last <= _STAMP_JUMP_NS
            if usual and not self._apart.stamps:  # so are all up to the next odd one
                end = int(ends[np.searchsorted(ends, begin, 'right')])
                self._accept(stamps_ns[begin:end], values[begin:end])
            else:
                self._judge(stamps_ns[begin:end], values[begin:end])
            begin = end
        if self.queues[-1] is not queue or self.queues[-1].run_ns != run:
            self.clock.begin_anew()
        last = self.queues[-1].newest_ns
        if last is not None and last != newest:
            self.clock.take(last - shift)

    def _judge(self, stamp: Stamps, value: Values) -> None:
        """Judge one sample, of shape (1,)."""
        stamp_ns, before, last = int(stamp[0]), self._apart.newest_ns, self.queues[-1].newest_ns
        if before is not None and last is not None:
            goes_on = 0 < stamp_ns - before <= _STAMP_JUMP_NS and last - stamp_ns > CLOCK_RESET_NS
            if self._is_ahead:
                self._settle(stamp_ns > before)
            elif not goes_on:
                self._settle(False)
            last = self.queues[-1].newest_ns
        if last is None or 0 < stamp_ns - last <= _STAMP_JUMP_NS:
            self._accept(stamp, value)
        elif stamp_ns > last:
            self._apart.push(stamp, value, 0)
        elif last - stamp_ns > CLOCK_RESET_NS:
            self._apart.push(stamp, value, 0)
            self.refused_since += 1
            if stamp_ns - self._apart.stamps[0] >= CLOCK_RESET_NS:  # the clock was set back
                self._apart.marks[0] = self._mark | BACKWARD
                self.queues.append(self._apart)
                self._apart = _Queue()
                self._mark = self.refused_since = 0
        else:
            self._refuse(REPEATED if stamp_ns == last else BACKWARD)

    @property
    def _is_ahead(self) -> bool:
        """Whether what stands apart is ahead, not behind."""
        return bool(self._apart.stamps) and self._apart.stamps[0] > (
            self.queues[-1].newest_ns or 0
        )

    def _settle(self, confirmed: bool) -> None:
        """Accept or refuse what stands apart."""
        apart, ahead = self._apart, self._is_ahead
        self._apart = _Queue()
        if confirmed:
            self._accept(np.array(apart.stamps), np.array(apart.values))
            return
        if not ahead:  # they were counted when they came
            self.refused_since -= len(apart.stamps)
        self._refuse(AHEAD if ahead else BACKWARD, len(apart.stamps))

    def _accept(self, stamps: Stamps, values: Values) -> None:
        self.queues[-1].push(stamps, values, self._mark)
        self._mark = self.refused_since = 0

    def _refuse(self, reason: int, count: int = 1) -> None:
        self.refused[_REASONS[reason]] += count
        self.refused_since += count
        self._mark |= reason

    def drop(self, begin: int, end: int, reason: int) -> None:
        """Refuse samples begin..end of the present epoch that wait already."""
        if end <= begin:
            return
        self.refused[_REASONS[reason]] += end - begin
        marks = self.queues[0].drop(begin, end, reason)
        if marks:  # nothing waits that could carry them
            self.refused_since += end - begin
            self._mark |= marks

    def returned_ns(self) -> int | None:
        """
        Stamp at which a clock that had leapt is back where it would have been; None if not.

        The leap, ahead or back, must have lasted as long as the stamps say it did. A set
        clock, or a channel that was off for a while, does not do that.
        """
        leap = self._leap()
        if leap is None:
            return None
        before, first, last, after = leap
        lasted = abs((last - first) - (after - before)) <= _STAMP_JUMP_NS
        return after if lasted and abs(after - last) > _STAMP_JUMP_NS else None

    def _leap(self) -> tuple[int, int, int, int] | None:
        """Return the stamps before, first and last in, and after what may be a leap; ns."""
        old, new = self.queues[0], self.queues[1] if len(self.queues) > 1 else _Queue()
        before, first, newest = old.before_run_ns, old.run_ns, old.newest_ns
        if not new.stamps or newest is None:
            return None
        if before is not None and first is not None and before < new.stamps[0] < first:
            return before, first, newest, new.stamps[0]  # one ahead
        place = bisect_right(new.stamps, newest)
        if not 0 < place < len(new.stamps):
            return None
        return newest, new.stamps[0], new.stamps[place - 1], new.stamps[place]

    def rejoin(self) -> int:
        """
        Go on in the present epoch after a leap, without the samples taken in it.

        Returns how many wait that came before it.
        """
        leap = self._leap()
        if leap is None:
            return len(self.queues[0].stamps)
        before, _, last, after = leap
        (old, new), ahead = self.queues[:2], last > after
        begin = end = len(old.stamps)
        if ahead:
            begin = bisect_left(old.stamps, after)
        else:
            end += bisect_right(new.stamps, before)
        old.extend(self.queues.pop(1))
        self.drop(begin, end, AHEAD if ahead else BACKWARD)
        return begin

    def go_on_from(self, position_ns: int | None, shift_ns: int) -> None:
        """Go on after a position with stamps of another offset; drop what waits."""
        self.refused['clock'] += sum(len(one.stamps) for one in (*self.queues, self._apart))
        self.start_again()
        self.queues[0].newest_ns = position_ns
        self.clock.shift_ns = shift_ns

    def finish(self) -> None:
        """End of the record: accept a sample still held back, refuse those still behind."""
        if self._apart.stamps:
            self._settle(self._is_ahead)
