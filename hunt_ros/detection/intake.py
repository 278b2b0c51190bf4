"""
What one channel delivers: which stamps are believed, and the queue of believed samples.

The verdict on a stamp depends on the channel's own sequence alone, so it is the
same however the samples of the channels are interleaved and cut into blocks.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

#: Bits that ride on the next believed sample: what went wrong since the one before.
REPEATED, BACKWARD, AHEAD, LATE = 1, 2, 4, 8

_Stamps = NDArray[np.int64]
_Values = NDArray[np.float64]
_Marks = NDArray[np.uint8]


class SampleQueue:
    """Samples waiting to be merged: three arrays that grow at the end and shrink in front."""

    def __init__(self) -> None:
        self._stamps = np.empty(256, dtype=np.int64)
        self._values = np.empty(256, dtype=np.float64)
        self._marks = np.empty(256, dtype=np.uint8)
        self._head = 0
        self._tail = 0

    def __len__(self) -> int:
        return self._tail - self._head

    @property
    def stamps(self) -> _Stamps:
        """Stamps of the waiting samples, ns, shape (n,); valid until the next call."""
        return self._stamps[self._head : self._tail]

    @property
    def first_ns(self) -> int | None:
        """Stamp of the oldest waiting sample, ns."""
        return int(self._stamps[self._head]) if self._tail > self._head else None

    @property
    def last_ns(self) -> int | None:
        """Stamp of the newest waiting sample, ns."""
        return int(self._stamps[self._tail - 1]) if self._tail > self._head else None

    def push_one(self, stamp_ns: int, value: float, mark: int) -> None:
        """Append one sample."""
        if self._tail == self._stamps.size:
            self._make_room(1)
        tail = self._tail
        self._stamps[tail] = stamp_ns
        self._values[tail] = value
        self._marks[tail] = mark
        self._tail = tail + 1

    def push(self, stamps_ns: _Stamps, values: _Values) -> None:
        """Append samples, arrays of shape (n,)."""
        count = stamps_ns.size
        if self._tail + count > self._stamps.size:
            self._make_room(count)
        end = self._tail + count
        self._stamps[self._tail : end] = stamps_ns
        self._values[self._tail : end] = values
        self._marks[self._tail : end] = 0
        self._tail = end

    def take(self, until_ns: int) -> tuple[_Stamps, _Values, _Marks]:
        """Remove and return the samples with stamp <= until_ns, arrays of shape (n,)."""
        count = int(np.searchsorted(self.stamps, until_ns, side='right'))
        part = slice(self._head, self._head + count)
        self._head += count
        return self._stamps[part].copy(), self._values[part].copy(), self._marks[part].copy()

    def peek(self) -> tuple[int, float] | None:
        """Return stamp (ns) and value of the oldest waiting sample, without removing it."""
        if self._tail == self._head:
            return None
        return int(self._stamps[self._head]), float(self._values[self._head])

    def drop(self, stamp_ns: int, mark: int) -> bool:
        """
        Remove one sample; its marks, and `mark`, go over to the next.

        Returns
        -------
        bool
            False where there is no next sample to carry the marks.
        """
        at = self._head + int(np.searchsorted(self.stamps, stamp_ns))
        marks = int(self._marks[at]) | mark
        for array in (self._stamps, self._values, self._marks):
            array[at : self._tail - 1] = array[at + 1 : self._tail]
        self._tail -= 1
        if at == self._tail:
            return False
        self._marks[at] |= marks
        return True

    def _make_room(self, count: int) -> None:
        waiting = len(self)
        size = self._stamps.size
        while size < 2 * (waiting + count):
            size *= 2
        for name in ('_stamps', '_values', '_marks'):
            old = getattr(self, name)
            new = np.empty(size, dtype=old.dtype)
            new[:waiting] = old[self._head : self._tail]
            setattr(self, name, new)
        self._head, self._tail = 0, waiting


@dataclass
class StampCounts:
    """How many samples of a channel were refused, by reason."""

    repeated: int = 0
    backward: int = 0
    ahead: int = 0
    late: int = 0

    @property
    def total(self) -> int:
        """All refused samples."""
        return self.repeated + self.backward + self.ahead + self.late


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
    last_ns : int or None
        Newest believed stamp.
    refused_since : int
        Samples refused since the last believed one.
    """

    stamp_jump_ns: int
    clock_reset_ns: int
    queues: list[SampleQueue] = field(default_factory=lambda: [SampleQueue()])
    last_ns: int | None = None
    counts: StampCounts = field(default_factory=StampCounts)
    refused_since: int = 0
    _held: tuple[int, float] | None = None
    _behind: list[tuple[int, float]] = field(default_factory=list)
    _mark: int = 0

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
                    self.last_ns = int(stamps_ns[end - 1])
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

    def drop_late(self, queue: SampleQueue, stamp_ns: int) -> None:
        """Take a believed sample out again because it came too late; the next one tells of it."""
        self.counts.late += 1
        if not queue.drop(stamp_ns, LATE):
            self.refused_since += 1
            self._mark |= LATE

    def start_again(self) -> None:
        """Forget what waits and the newest stamp: the clock starts anew."""
        self.queues = [SampleQueue()]
        self.last_ns = None
        self._held = None
        self._behind.clear()

    def finish(self) -> None:
        """End of the record: believe a sample still held back, refuse those still behind."""
        if self._held is not None:
            stamp, value = self._held
            self._held = None
            self._believe(stamp, value)
        self._drop_behind()

    def _follows(self, stamp_ns: int) -> bool:
        """Tell whether a stamp comes after the last one as it should."""
        if self._held is not None or self.last_ns is None:
            return False
        return 0 < stamp_ns - self.last_ns <= self.stamp_jump_ns

    def _believe(self, stamp_ns: int, value: float) -> None:
        if self._behind:
            self._drop_behind()
        self.queues[-1].push_one(stamp_ns, value, self._mark)
        self.last_ns = stamp_ns
        self._mark = 0
        self.refused_since = 0

    def _refuse(self, reason: int) -> None:
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
        for _ in self._behind:
            self._refuse(BACKWARD)
            self.refused_since -= 1  # they were counted there when they came
        self._behind.clear()
