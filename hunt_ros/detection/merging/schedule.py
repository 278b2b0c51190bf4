"""How far rows may be made: to the watermark, and in a replay to where the live run was."""

from __future__ import annotations

from hunt_ros.detection.merging.journal import JournalEntry
from hunt_ros.detection.merging.merge import ChannelMerger
from hunt_ros.samples import NANOSECONDS

#: Longest stretch worked on at once: bounds the memory an hour of samples takes.
_CHUNK_NS = 60 * NANOSECONDS


class Schedule:
    """
    Says which stretch of rows comes next.

    Parameters
    ----------
    merger : ChannelMerger
        Knows what is complete.
    period_ns : int
        Spacing of the rows.
    """

    def __init__(self, merger: ChannelMerger, period_ns: int) -> None:
        self._merger = merger
        self._period = period_ns
        self._limit: tuple[int, int | None] | None = None

    def hold_at(self, entry: JournalEntry) -> None:
        """For a replay: no row beyond the position of a journal entry."""
        self._limit = entry.epoch, entry.position_ns

    def let_go(self) -> None:
        """For a replay: end `hold_at`."""
        self._limit = None

    @property
    def next_ns(self) -> int | None:
        """Last row of the next stretch, ns; None where no row is complete."""
        until = self._until()
        if until is None:
            return None
        last, position = self._row_before(until), self._merger.position_ns
        waiting = self._merger.first_ns
        begin = last if waiting is None else waiting
        if position is not None:
            if last <= position:
                return None
            begin = max(begin, position)
        last = min(last, self._row_before(begin + _CHUNK_NS))
        return last if position is None or last > position else None

    @property
    def epoch_ends(self) -> bool:
        """True where the next epoch begins: all is said in this one, and more waits."""
        free = self._limit is None or self._merger.epoch < self._limit[0]
        return free and self._merger.epoch_over and self._merger.more_epochs

    def _until(self) -> int | None:
        """Stamp up to which rows may be made."""
        until = self._merger.watermark_ns
        if self._limit is None or self._merger.epoch < self._limit[0]:
            return until
        epoch, position = self._limit
        if until is None or position is None or self._merger.epoch > epoch:
            return None
        return min(until, position)

    def _row_before(self, stamp_ns: int) -> int:
        """Return the last grid stamp not after one."""
        return stamp_ns // self._period * self._period
