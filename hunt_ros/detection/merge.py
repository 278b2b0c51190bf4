"""
Merging the channels by header stamp: the watermark, silence, and what comes too late.

Each channel may arrive in any blocks and with any delay. A stamp is *complete*
once every channel has spoken up to it: that is the watermark, and only what lies
at or before it is processed. A channel that has gone silent would hold it for
ever; `release` - the only way in which time enters - lets go of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection.intake import Intake


@dataclass(frozen=True, eq=False)
class MergedBlock:
    """
    Samples of one channel taken out of the merger.

    Parameters
    ----------
    stamps_ns : ndarray of int64, shape (n,)
    values : ndarray of float64, shape (n,)
    marks : ndarray of uint8, shape (n,)
        Stamp faults since the sample before, bits of `hunt_ros.detection.intake`.
    following : tuple of (int, float), optional
        Stamp and value of the channel's next sample, where it is known already.
    """

    stamps_ns: NDArray[np.int64]
    values: NDArray[np.float64]
    marks: NDArray[np.uint8]
    following: tuple[int, float] | None


class ChannelMerger:
    """
    Waits until every channel has spoken.

    Parameters
    ----------
    timeouts_ns : mapping of str to int
        Expected channels, each with the silence after which it is let go.
    stamp_jump_ns, clock_reset_ns : int
        See `Intake`.
    drain_ns : int
        Where every channel is silent, the stamps this far beyond the newest are
        complete as well, so that the silence itself is processed.

    Attributes
    ----------
    position_ns : int or None
        Stamp up to which samples have been taken in this epoch.
    silent : set of str
        Channels that were let go and have not spoken since.
    """

    def __init__(
        self,
        timeouts_ns: Mapping[str, int],
        stamp_jump_ns: int,
        clock_reset_ns: int,
        drain_ns: int,
    ) -> None:
        self.intakes = {name: Intake(stamp_jump_ns, clock_reset_ns) for name in timeouts_ns}
        self.position_ns: int | None = None
        self.silent: set[str] = set()
        self.epoch = 0
        #: Stamps per channel to be treated as late, for a replay of a journal.
        self.known_late: dict[str, set[int]] = {}
        self._timeouts = dict(timeouts_ns)
        self._drain_ns = drain_ns
        self._first_tick_ns: int | None = None
        self._finished = False

    def push(
        self, channel: str, stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> tuple[list[int], bool]:
        """
        Take samples of one channel in.

        Returns
        -------
        late : list of int
            Stamps that came too late and were dropped, ns.
        resumed : bool
            True where the channel had been let go and speaks again.
        """
        intake = self.intakes[channel]
        newest = intake.last_ns
        self._finished = False
        if stamps_ns.size == 1:
            intake.push_one(int(stamps_ns[0]), float(values[0]))
        elif stamps_ns.size:
            intake.push(stamps_ns, values)
        queue = intake.queues[0]
        late = []
        first = queue.first_ns
        while first is not None and self.position_ns is not None and first <= self.position_ns:
            intake.drop_late(queue, first)
            late.append(first)
            first = queue.first_ns
        if self.known_late.get(channel):
            late += self._drop_known(channel)
        resumed = channel in self.silent and self._speaks_again(channel, newest)
        if resumed:
            self.silent.discard(channel)
        return late, resumed

    def _speaks_again(self, channel: str, newest: int | None) -> bool:
        """
        Tell whether a silent channel is back: with samples that are new, and not far behind.

        They may be too late themselves, for the others did not wait; from now on they do.
        """
        intake = self.intakes[channel]
        last = intake.last_ns
        if len(intake.queues) > 1:
            return True
        if last is None or (newest is not None and last <= newest):
            return False
        return self.position_ns is None or self.position_ns - last <= self._timeouts[channel]

    def _drop_known(self, channel: str) -> list[int]:
        """Drop the samples that a journal says came too late."""
        intake, known = self.intakes[channel], self.known_late[channel]
        dropped = []
        for queue in intake.queues:
            for stamp in sorted(known.intersection(queue.stamps.tolist())):
                intake.drop_late(queue, stamp)
                known.discard(stamp)
                dropped.append(stamp)
        return dropped

    @property
    def watermark_ns(self) -> int | None:
        """Stamp up to which every channel that is not silent has spoken; None before that."""
        if self.epoch_over:
            return self.end_of_epoch_ns
        newest = None
        complete = None
        for name, intake in self.intakes.items():
            last = intake.last_ns
            if len(intake.queues) > 1:
                continue
            if name in self.silent:
                if last is not None and (newest is None or last > newest):
                    newest = last
                continue
            if last is None:
                return None
            if complete is None or last < complete:
                complete = last
        if complete is None and newest is not None:
            return newest + self._drain_ns  # all are silent: go on until that shows
        return complete

    @property
    def epoch_over(self) -> bool:
        """True where no channel has anything more to say in the present epoch."""
        if self._finished:
            return True
        waiting = [
            name
            for name, intake in self.intakes.items()
            if len(intake.queues) == 1 and name not in self.silent
        ]
        return not waiting and any(len(intake.queues) > 1 for intake in self.intakes.values())

    @property
    def more_epochs(self) -> bool:
        """True where samples of a later epoch wait."""
        return any(len(intake.queues) > 1 for intake in self.intakes.values())

    @property
    def end_of_epoch_ns(self) -> int | None:
        """Newest stamp waiting in the present epoch, or the position where nothing waits."""
        ends = [intake.queues[0].last_ns for intake in self.intakes.values()]
        known = [end for end in (*ends, self.position_ns) if end is not None]
        return max(known, default=None)

    @property
    def first_ns(self) -> int | None:
        """Oldest stamp waiting in the present epoch, ns."""
        firsts = [intake.queues[0].first_ns for intake in self.intakes.values()]
        return min((first for first in firsts if first is not None), default=None)

    def overdue(self, now_ns: int) -> dict[str, int | None]:
        """
        Return the channels that `now_ns` finds silent for longer than their timeout.

        Returns
        -------
        dict of str to (int or None)
            Channel and its newest stamp; only those not known as silent already.
        """
        if self._first_tick_ns is None:
            self._first_tick_ns = now_ns
        found = {}
        for name, intake in self.intakes.items():
            if name in self.silent or len(intake.queues) > 1:
                continue
            since = self._first_tick_ns if intake.last_ns is None else intake.last_ns
            if now_ns - since > self._timeouts[name]:
                found[name] = intake.last_ns
        return found

    def clocks_moved(self, now_ns: int) -> bool:
        """True where a channel whose clock was set back agrees with `now_ns`."""
        return any(
            len(intake.queues) > 1
            and intake.last_ns is not None
            and now_ns - intake.last_ns <= self._timeouts[name]
            for name, intake in self.intakes.items()
        )

    def take(self, until_ns: int) -> dict[str, MergedBlock]:
        """Remove the samples with stamp <= until_ns, and move the position there."""
        self.position_ns = until_ns
        blocks = {}
        for name, intake in self.intakes.items():
            queue = intake.queues[0]
            stamps, values, marks = queue.take(until_ns)
            blocks[name] = MergedBlock(stamps, values, marks, queue.peek())
        return blocks

    def next_epoch(self) -> None:
        """Leave the present epoch; what still waits in it is given up."""
        for intake in self.intakes.values():
            if len(intake.queues) > 1:
                intake.queues.pop(0)
            else:
                intake.start_again()
        self.silent.clear()
        self.position_ns = None
        self.epoch += 1

    def finish(self) -> None:
        """No more samples will come: everything waiting is complete."""
        for intake in self.intakes.values():
            intake.finish()
        self._finished = True
