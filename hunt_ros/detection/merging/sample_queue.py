"""Believed samples of one channel, waiting to be merged with those of the others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_Stamps = NDArray[np.int64]
_Values = NDArray[np.float64]
_Marks = NDArray[np.uint8]


class SampleQueue:
    """
    Three arrays that grow at the end and shrink in front, stamps increasing.

    Attributes
    ----------
    newest_ns : int or None
        Stamp of the newest sample it was ever given, also when that is gone.
    run_ns : int or None
        Stamp at which the present run without a leap began.
    before_run_ns : int or None
        Stamp of the sample before that leap; None in the first run.
    """

    def __init__(self) -> None:
        self._stamps = np.empty(256, dtype=np.int64)
        self._values = np.empty(256, dtype=np.float64)
        self._marks = np.empty(256, dtype=np.uint8)
        self._head = 0
        self._tail = 0
        self.newest_ns: int | None = None
        self.run_ns: int | None = None
        self.before_run_ns: int | None = None

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

    @property
    def length_of_run(self) -> int:
        """Time from the beginning of the present run to the newest stamp, ns."""
        return 0 if self.newest_ns is None or self.run_ns is None else self.newest_ns - self.run_ns

    def leapt_beyond(self, stamp_ns: int) -> bool:
        """Return True if the present run began with a leap over a stamp."""
        if self.run_ns is None or self.before_run_ns is None:
            return False
        return self.before_run_ns < stamp_ns < self.run_ns

    def push_one(self, stamp_ns: int, value: float, mark: int, leap_ns: int) -> None:
        """Append one sample; a step of more than `leap_ns` begins a new run."""
        if self._tail == self._stamps.size:
            self._make_room(1)
        tail = self._tail
        self._stamps[tail] = stamp_ns
        self._values[tail] = value
        self._marks[tail] = mark
        self._tail = tail + 1
        if self.newest_ns is None or stamp_ns - self.newest_ns > leap_ns:
            self.run_ns, self.before_run_ns = stamp_ns, self.newest_ns
        self.newest_ns = stamp_ns

    def push(self, stamps_ns: _Stamps, values: _Values) -> None:
        """Append samples without a leap, arrays of shape (n,)."""
        count = stamps_ns.size
        if self._tail + count > self._stamps.size:
            self._make_room(count)
        end = self._tail + count
        self._stamps[self._tail : end] = stamps_ns
        self._values[self._tail : end] = values
        self._marks[self._tail : end] = 0
        self._tail = end
        self.newest_ns = int(stamps_ns[-1])

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

    def drop(self, begin: int, end: int, mark: int) -> int:
        """
        Remove the waiting samples begin..end; their marks, and `mark`, go to the next.

        Returns
        -------
        int
            The marks, where there is no next sample to carry them; else 0.
        """
        if end <= begin:
            return 0
        first, after = self._head + begin, self._head + end
        marks = mark | int(np.bitwise_or.reduce(self._marks[first:after]))
        if begin == 0:
            self._head = after
        else:
            for array in (self._stamps, self._values, self._marks):
                array[first : self._tail - (end - begin)] = array[after : self._tail]
            self._tail -= end - begin
            after = first
        if after == self._tail:
            return marks
        self._marks[after] |= marks
        return 0

    def mark_first(self, mark: int) -> None:
        """Put a mark on the oldest waiting sample."""
        self._marks[self._head] |= mark

    def extend(self, later: SampleQueue) -> None:
        """Append all that waits in another queue, whose runs go on here."""
        part = slice(later._head, later._tail)
        count = len(later)
        if self._tail + count > self._stamps.size:
            self._make_room(count)
        end = self._tail + count
        self._stamps[self._tail : end] = later._stamps[part]
        self._values[self._tail : end] = later._values[part]
        self._marks[self._tail : end] = later._marks[part]
        self._tail = end
        self.newest_ns = later.newest_ns
        self.run_ns, self.before_run_ns = later.run_ns, later.before_run_ns

    def _make_room(self, count: int) -> None:
        """Move what waits to the front of arrays that have room for `count` more."""
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
