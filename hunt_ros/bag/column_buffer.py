"""A column that grows block by block, with little beside its own memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hunt_ros.samples import Series

#: Messages that room is made for at first, and at most before they are seen.
_FIRST, _MOST = 1 << 14, 1 << 26


class ColumnBuffer:
    """
    Collects stamps and values of one channel.

    Parameters
    ----------
    expected : int
        Messages expected; 0 where that is not known.
    with_log : bool
        Keep the log times as well, to sort by them. A first pass does without, and
        `needs_log` says whether that was enough.

    Attributes
    ----------
    joints : set of str
        Names of the joints that were taken.
    others : set of str
        Joints of messages that were passed over.
    """

    def __init__(self, expected: int = 0, with_log: bool = False) -> None:
        # The counts of a damaged file are not to be believed without bound.
        capacity = min(expected, _MOST) or _FIRST
        self._stamps = np.empty(capacity, dtype=np.int64)
        self._values = np.empty(capacity)
        self._log = np.empty(capacity if with_log else 0, dtype=np.int64)
        self._with_log = with_log
        self._size = 0
        self._last_ns = -(1 << 63)
        self._sorted = True
        self.joints: set[str] = set()
        self.others: set[str] = set()

    @property
    def needs_log(self) -> bool:
        """Whether the log times are needed and were not kept."""
        return not self._with_log and not self._sorted

    def __len__(self) -> int:
        return self._size

    def extend(
        self, log_ns: NDArray[np.int64], stamps: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        """Append a block: log times, stamps and values, shape (n,) each."""
        count = values.size
        if not count:
            return
        in_order = log_ns[0] >= self._last_ns and bool((log_ns[1:] >= log_ns[:-1]).all())
        self._sorted = self._sorted and bool(in_order)
        self._last_ns = int(log_ns[-1])
        if not stamps.all():
            # A header that nobody filled says nothing: the log time stands in.
            stamps = np.where(stamps == 0, log_ns, stamps)
        end = self._size + count
        if end > self._values.size:
            self._grow(max(end, 2 * self._values.size))
        place = slice(self._size, end)
        self._stamps[place], self._values[place] = stamps, values
        if self._with_log:
            self._log[place] = log_ns
        self._size = end

    def _grow(self, capacity: int) -> None:
        # Enlarged in place where the system can: the old and the new are rarely there together.
        self._stamps.resize(capacity, refcheck=False)
        self._values.resize(capacity, refcheck=False)
        if self._with_log:
            self._log.resize(capacity, refcheck=False)

    def series(self, scale: float = 1.0, offset: float = 0.0) -> Series:
        """Return what was collected, scaled, in the order of log time."""
        stamps, values = self._stamps[: self._size], self._values[: self._size]
        if self._with_log:
            log_ns = self._log[: self._size]
            if not self._sorted:
                order = np.argsort(log_ns, kind='stable')
                stamps, values = stamps[order], values[order]
        if scale != 1.0:
            values *= scale
        if offset:
            values += offset
        return Series(stamps, values)
