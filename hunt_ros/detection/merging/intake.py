"""
What one channel delivers: which stamps are believed, and the queues of believed samples.

The verdict on a stamp depends on the channel's own sequence alone, so it is the
same however the samples of the channels are interleaved and cut into blocks.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection.merging.sample_queue import SampleQueue

#: Bits that ride on the next believed sample: what went wrong since the one before.
REPEATED, BACKWARD, AHEAD, LATE = 1, 2, 4, 8

#: Most samples of a later epoch that wait while the others do not follow: 50 s at 2 kHz.
_WAITING = 100_000

_Stamps = NDArray[np.int64]
_Values = NDArray[np.float64]


@dataclass
class StampCounts:
    """How many samples of a channel were refused, by reason."""

    repeated: int = 0
    backward: int = 0
    ahead: int = 0
    late: int = 0
    clock: int = 0

    @property
    def total(self) -> int:
        """All refused samples."""
        return self.repeated + self.backward + self.ahead + self.late + self.clock


@dataclass
class Intake:
    """
    Stamps of one channel, judged in the order of their arrival.

    - Not newer than the last believed one: refused, `REPEATED` or `BACKWARD`.
    - Stamps that stay behind by more than `clock_reset_ns`, in order, for that long:
      the clock was set back. They open a new *epoch*, in which time starts again.
    - Further ahead than `stamp_jump_ns`: held back until the next sample confirms it
      by being newer still; refused as `AHEAD` when the next one falls back behind it.

    Parameters
    ----------
    stamp_jump_ns, clock_reset_ns : int
        See above.

    Attributes
    ----------
    queues : list of SampleQueue
        Believed samples, one queue an epoch, the present epoch of the merger first.
    counts : StampCounts
        Refused so far.
    refused_since : int
        Samples refused since the last believed one.
    """

    stamp_jump_ns: int
    clock_reset_ns: int
    queues: list[SampleQueue] = field(default_factory=lambda: [SampleQueue()])
    counts: StampCounts = field(default_factory=StampCounts)
    refused_since: int = 0
    _held: tuple[int, float] | None = None
    _behind: list[tuple[int, float]] = field(default_factory=list)
    _mark: int = 0

    @property
    def last_ns(self) -> int | None:
        """Newest believed stamp, ns."""
        return self.queues[-1].newest_ns

    @property
    def run(self) -> tuple[int, int | None]:
        """Epoch and first stamp (ns) of the present run without a leap."""
        return len(self.queues), self.queues[-1].run_ns

    def push(self, stamps_ns: _Stamps, values: _Values) -> None:
        """Judge samples in the order given; arrays of shape (n,)."""
        steps = np.diff(stamps_ns)
        odd = np.flatnonzero((steps <= 0) | (steps > self.stamp_jump_ns)) + 1
        begin = 0
        while begin < stamps_ns.size:
            if self._follows(int(stamps_ns[begin])):
                place = int(np.searchsorted(odd, begin, side='right'))
                end = int(odd[place]) if place < odd.size else stamps_ns.size
                self._believe(int(stamps_ns[begin]), float(values[begin]))
                if end > begin + 1:
                    self.queues[-1].push(stamps_ns[begin + 1 : end], values[begin + 1 : end])
                begin = end
            else:
                self.push_one(int(stamps_ns[begin]), float(values[begin]))
                begin += 1

    def push_one(self, stamp_ns: int, value: float) -> None:
        """Judge one sample."""
        if self._held is not None:
            held_ns, held_value = self._held
            self._held = None
            if stamp_ns > held_ns:
                self._believe(held_ns, held_value)
            else:
                self._refuse(AHEAD)
        last = self.last_ns
        if last is not None and stamp_ns <= last:
            self._step_back(stamp_ns, value, last)
        elif last is not None and stamp_ns - last > self.stamp_jump_ns:
            self._drop_behind()
            self._held = (stamp_ns, value)
        else:
            self._believe(stamp_ns, value)

    def drop_late(self, begin: int, end: int) -> None:
        """Take samples begin..end of the first queue out again: they came too late."""
        self.counts.late += end - begin
        self._drop(self.queues[0], begin, end, LATE)

    def returned_ns(self) -> int | None:
        """
        Stamp at which a clock that had leapt is back where it would have been; None if not.

        The leap, ahead or back, must have lasted as long as the stamps say it did. A set
        clock, or a channel that was off for a while, does not do that.
        """
        if len(self.queues) < 2:
            return None
        old, new = self.queues[:2]
        first, newest = new.first_ns, old.newest_ns
        if first is None or newest is None:
            return None
        if old.leapt_beyond(first):
            away, since = old.length_of_run, first - (old.before_run_ns or 0)
            return first if abs(away - since) <= self.stamp_jump_ns else None
        place = int(np.searchsorted(new.stamps, newest, side='right'))
        if not 0 < place < len(new):
            return None
        back, end = int(new.stamps[place]), int(new.stamps[place - 1])
        away, since = end - first, back - newest
        leapt = back - end > self.stamp_jump_ns
        return back if leapt and abs(away - since) <= self.stamp_jump_ns else None

    def rejoin(self) -> None:
        """Go on in the present epoch after a leap, without the samples taken in it."""
        old, new = self.queues[0], self.queues.pop(1)
        first, newest = int(new.stamps[0]), old.newest_ns
        if old.leapt_beyond(first):
            place, count = int(np.searchsorted(old.stamps, first)), len(old)
            new.mark_first(old.drop(place, count, AHEAD))
            self.counts.ahead += count - place
        elif newest is not None:
            count = int(np.searchsorted(new.stamps, newest, side='right'))
            new.drop(0, count, BACKWARD)
            self.counts.backward += count
        old.extend(new)

    def thin(self) -> None:
        """Keep the first and the newest samples of an epoch that the others do not follow into."""
        queue = self.queues[-1]
        while len(self.queues) > 1 and len(queue) > _WAITING:
            self.counts.clock += _WAITING // 2
            queue.drop(1, 1 + _WAITING // 2, BACKWARD)

    def go_on_from(self, position_ns: int | None) -> None:
        """Go on with stamps of another offset after a position; drop what waits."""
        self.counts.clock += sum(len(queue) for queue in self.queues)
        self.counts.clock += len(self._behind) + (self._held is not None)
        self.start_again()
        self.queues[0].newest_ns = position_ns

    def start_again(self) -> None:
        """Forget what waits and the newest stamp: the clock starts anew."""
        self.queues = [SampleQueue()]
        self._held = None
        self._behind.clear()

    def finish(self) -> None:
        """End of the record: believe a sample still held back, refuse those still behind."""
        if self._held is not None:
            stamp, value = self._held
            self._held = None
            self._believe(stamp, value)
        self._drop_behind()

    def _drop(self, queue: SampleQueue, begin: int, end: int, mark: int) -> None:
        """Drop samples that wait; their marks go to the next that is believed."""
        marks = queue.drop(begin, end, mark)
        if marks:  # nothing waits that could carry them
            self.refused_since += end - begin
            self._mark |= marks

    def _follows(self, stamp_ns: int) -> bool:
        """Return True if a stamp comes after the last one as it should."""
        if self._held is not None or self.last_ns is None:
            return False
        return 0 < stamp_ns - self.last_ns <= self.stamp_jump_ns

    def _believe(self, stamp_ns: int, value: float) -> None:
        """Put a sample into the queue, with the marks of those that were refused before it."""
        if self._behind:
            self._drop_behind()
        self.queues[-1].push_one(stamp_ns, value, self._mark, self.stamp_jump_ns)
        self._mark = 0
        self.refused_since = 0

    def _refuse(self, reason: int) -> None:
        """Count a sample that is refused; the next one that is believed carries the reason."""
        if reason == REPEATED:
            self.counts.repeated += 1
        elif reason == BACKWARD:
            self.counts.backward += 1
        else:
            self.counts.ahead += 1
        self.refused_since += 1
        self._mark |= reason

    def _step_back(self, stamp_ns: int, value: float, last_ns: int) -> None:
        """Deal with a stamp that is not newer than the last: refuse it, or reset the clock."""
        if stamp_ns == last_ns:
            self._drop_behind()
            self._refuse(REPEATED)
            return
        if last_ns - stamp_ns <= self.clock_reset_ns:
            self._drop_behind()
            self._refuse(BACKWARD)
            return
        if self._behind and not 0 < stamp_ns - self._behind[-1][0] <= self.stamp_jump_ns:
            self._drop_behind()
        self._behind.append((stamp_ns, value))
        self.refused_since += 1
        if stamp_ns - self._behind[0][0] >= self.clock_reset_ns:
            behind, self._behind = self._behind, []
            self.queues.append(SampleQueue())
            self._mark |= BACKWARD
            for one in behind:
                self._believe(*one)

    def _drop_behind(self) -> None:
        """Refuse those that stayed behind: the clock was not set back."""
        for _ in self._behind:
            self._refuse(BACKWARD)
            self.refused_since -= 1  # they were counted there when they came
        self._behind.clear()
