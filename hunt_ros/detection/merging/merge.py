"""
Merging the channels by header stamp: the watermark, silence, and what comes too late.

Each channel may arrive in any blocks and with any delay. A stamp is *complete*
once every channel has spoken up to it: that is the watermark, and only what lies
at or before it is processed. A channel that has gone silent would hold it for
ever; `look`, the only way in which time enters, finds it, and finds it back: until
then its samples are dropped.

One rule for clocks: a channel whose stamps stay away from the detector's clock has its
*offset* added to them; where the detector's clock was set as well, or there is none, stamps
that go back on all channels begin a new *epoch*.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection.merging.clocks import ChannelClock
from hunt_ros.detection.merging.intake import Intake


@dataclass(frozen=True, eq=False)
class MergedBlock:
    """
    Samples of one channel taken out of the merger.

    Parameters
    ----------
    stamps_ns : ndarray of int64, shape (n,)
    values : ndarray of float64, shape (n,)
    shifted : bool
        The offset of the channel's clock was added to the stamps.
    marks : ndarray of uint8, shape (n,)
        Stamp faults since the sample before, bits of `hunt_ros.detection.merging.intake`.
    following : tuple of (int, float), optional
        Stamp and value of the channel's next sample, where it is known already.
    """

    stamps_ns: NDArray[np.int64]
    values: NDArray[np.float64]
    marks: NDArray[np.uint8]
    following: tuple[int, float] | None
    shifted: bool = False


@dataclass(frozen=True)
class LateRun:
    """
    Samples of one channel that came too late, one after the other.

    Parameters
    ----------
    epoch : int
        Number of clock resets before it.
    first_ns, last_ns : int
        First and last of them; None: to the end of the epoch.
    """

    epoch: int
    first_ns: int
    last_ns: int | None


class ChannelMerger:
    """
    Waits until every channel has spoken.

    Parameters
    ----------
    timeouts_ns : mapping of str to int
        Expected channels, each with the silence after which it is let go.
    stamp_jump_ns, clock_reset_ns : int
        See `Intake`.
    offset_limit_ns : int
        A channel whose clock is further away is not believed: it counts as silent.
    drain_ns : int
        Where every channel is silent, the stamps this far beyond the newest are
        complete as well, so that the silence itself is processed.

    Attributes
    ----------
    position_ns : int or None
        Stamp up to which samples have been taken in this epoch.
    silent : set of str
        Channels that were let go and are not back.
    clocks : dict of str to ChannelClock
    """

    def __init__(
        self,
        timeouts_ns: Mapping[str, int],
        stamp_jump_ns: int,
        clock_reset_ns: int,
        offset_limit_ns: int,
        drain_ns: int,
    ) -> None:
        self.clocks = {name: ChannelClock(offset_limit_ns) for name in timeouts_ns}
        self.intakes = {name: Intake(stamp_jump_ns, clock_reset_ns) for name in timeouts_ns}
        self.position_ns: int | None = None
        self.silent: set[str] = set()
        self.epoch = 0
        #: Number of samples received, and the stamp of the last of them, by channel.
        self.received: dict[str, int] = {}
        self._last_received_ns: dict[str, int] = {}
        #: Per channel what is to be treated as late, for a replay of a journal.
        self.known_late: dict[str, list[LateRun]] = {}
        self._timeouts = dict(timeouts_ns)
        #: Offsets below the first may be transport delay: they are left alone. One that is known
        #: is followed within the second, so that no step of it leaves a gap that is silence.
        self._tolerance = min(timeouts_ns.values())
        self._followed = self._tolerance // 2
        self._drain_ns = drain_ns
        self._silence_until_ns: int | None = None
        self._finished = False
        #: Channels whose samples come too late just now, with the newest of them.
        self._late_until: dict[str, int] = {}

    def push(
        self, channel: str, stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> list[tuple[str, str, int]]:
        """
        Take samples of one channel in.

        Returns
        -------
        list of (str, str, int)
            What a replay must know, as kind of journal entry, channel and stamp (ns): where
            samples began and ceased to come too late.
        """
        intake, clock = self.intakes[channel], self.clocks[channel]
        newest, run = intake.last_ns, intake.run
        before = {name: len(self.intakes[name].queues[0]) for name in self.silent}
        self._finished = False
        if stamps_ns.size:
            self.received[channel] = self.received.get(channel, 0) + stamps_ns.size
            self._last_received_ns[channel] = int(stamps_ns[-1])
        if stamps_ns.size == 1:
            intake.push_one(int(stamps_ns[0]) + clock.shift_ns, float(values[0]))
        elif stamps_ns.size:
            intake.push(stamps_ns + clock.shift_ns, values)
        if intake.run != run:
            clock.begin_anew()
        if intake.last_ns is not None and intake.last_ns != newest:
            clock.take(intake.last_ns - clock.shift_ns)
        if channel in self.silent:
            intake.thin()
        notes = []
        for name in {channel: None, **dict.fromkeys(self._rejoin())}:
            if name in before:
                self.intakes[name].drop_late(before[name], len(self.intakes[name].queues[0]))
            else:
                notes += self._drop_late(name)
        return notes

    def _drop_late(self, channel: str) -> list[tuple[str, str, int]]:
        """Drop what lies behind the position; tell where such a run begins and ends."""
        intake = self.intakes[channel]
        self._drop_known(channel)
        waiting = intake.queues[0].stamps
        notes = []
        if self.position_ns is not None and waiting.size and waiting[0] <= self.position_ns:
            count = int(np.searchsorted(waiting, self.position_ns, side='right'))
            if channel not in self._late_until:
                notes.append(('late_from', channel, int(waiting[0])))
            self._late_until[channel] = int(waiting[count - 1])
            intake.drop_late(0, count)
        if channel in self._late_until and len(intake.queues[0]):
            notes.append(('late_to', channel, self._late_until.pop(channel)))
        return notes

    def _drop_known(self, channel: str) -> None:
        """Drop what a journal says came too late."""
        intake = self.intakes[channel]
        for run in self.known_late.get(channel, ()):
            waiting = intake.queues[0].stamps
            if run.epoch != self.epoch or not waiting.size:
                continue
            begin = int(np.searchsorted(waiting, run.first_ns))
            end = waiting.size
            if run.last_ns is not None:
                end = int(np.searchsorted(waiting, run.last_ns, side='right'))
            if end > begin:
                intake.drop_late(begin, end)

    def _rejoin(self) -> list[str]:
        """Take channels back into the present epoch whose clock had leapt; return them."""
        back = []
        for name, intake in self.intakes.items():
            while (stamp := intake.returned_ns()) is not None and self._is_time(stamp, intake):
                intake.rejoin()
                back.append(name)
        return back

    def _is_time(self, stamp_ns: int, apart: Intake) -> bool:
        """Return True if another channel came to a stamp in the present epoch without a leap."""
        for intake in self.intakes.values():
            queue = intake.queues[0]
            if intake is apart or queue.run_ns is None or queue.newest_ns is None:
                continue
            if queue.run_ns <= stamp_ns <= queue.newest_ns:
                return True
        return False

    @property
    def watermark_ns(self) -> int | None:
        """Stamp up to which every channel that is not silent has spoken; None before that."""
        if self.epoch_over:
            return self.end_of_epoch_ns
        if len(self.silent) == len(self.intakes):
            return self._silence_until_ns
        ends = [
            intake.queues[0].newest_ns
            for name, intake in self.intakes.items()
            if name not in self.silent
        ]
        known = [end for end in ends if end is not None]
        return min(known) if len(known) == len(ends) else None

    @property
    def behind(self) -> tuple[str, ...]:
        """
        The channels for which the others have waited longer than ticks would let them.

        One sentence each. Without ticks, or where the clock stands still, no channel is ever
        let go: no rows come, and the last one is not what is now.
        """
        newest = {name: intake.queues[0].newest_ns for name, intake in self.intakes.items()}
        known = {name: end for name, end in newest.items() if end is not None}
        if not known:
            return ()
        front = max(known.values())
        first = front if self.first_ns is None else self.first_ns
        lags = {name: front - known.get(name, first) for name in newest}
        return tuple(
            f'{name}: {1e-9 * lag:.1f} s behind the other channels'
            for name, lag in lags.items()
            if lag > self._drain_ns and name not in self.silent
        )

    @property
    def epoch_over(self) -> bool:
        """
        True where no channel has anything more to say in the present epoch.

        Clocks that are set back are set back together: where one channel was long before
        the others, its clock has leapt, and may come back.
        """
        if self._finished:
            return True
        ends = []
        for name, intake in self.intakes.items():
            if name in self.silent:
                continue
            end = intake.queues[0].newest_ns
            if len(intake.queues) == 1 or end is None:
                return False
            ends.append(end)
        if not ends:
            return self.more_epochs
        return max(ends) - min(ends) <= max(self._timeouts.values())

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

    def received_of(self, channels: Iterable[str]) -> tuple[dict[str, int | None], dict[str, int]]:
        """Return stamp of the last sample received (ns; None: none), and their number."""
        names = sorted(channels)
        last = {name: self._last_received_ns.get(name) for name in names}
        return last, {name: self.received.get(name, 0) for name in names}

    def look(self, now_ns: int) -> None:
        """Compare the clocks of the channels with that of the detector."""
        for clock in self.clocks.values():
            clock.look(now_ns)

    def overdue(self, now_ns: int) -> set[str]:
        """Return the channels that are silent for longer than their timeout since now."""
        return {
            name
            for name in self.intakes
            if name not in self.silent and self._is_overdue(name, now_ns)
        }

    def _is_overdue(self, channel: str, now_ns: int) -> bool:
        queues, clock = self.intakes[channel].queues, self.clocks[channel]
        newest = queues[0].newest_ns
        if len(queues) > 1 and newest is not None:  # its clock was set: nothing more in this epoch
            return now_ns - newest > self._timeouts[channel]
        return clock.late_ns > self._timeouts[channel] or not clock.believed

    def back(self) -> set[str]:
        """Return the silent channels that deliver again, by less than half their timeout late."""
        return {
            name
            for name in self.silent
            if (clock := self.clocks[name]).fresh
            and clock.believed
            and 2 * clock.late_ns <= self._timeouts[name]
            and len(self.intakes[name].queues) == 1
        }

    def release(self, channels: Iterable[str]) -> list[tuple[str, str, int]]:
        """
        Wait for these channels no more.

        Where every channel is silent, the stamps up to some time beyond the newest are
        complete, so that the silence itself is processed.

        Returns
        -------
        list of (str, str, int)
            As `push`.
        """
        self.silent |= set(channels)
        newest = [intake.queues[0].newest_ns for intake in self.intakes.values()]
        known = [stamp for stamp in newest if stamp is not None]
        self._silence_until_ns = max(known) + self._drain_ns if known else None
        return self._end_late(channels)

    def _end_late(self, channels: Iterable[str]) -> list[tuple[str, str, int]]:
        """End the runs of late samples of channels."""
        return [
            ('late_to', name, self._late_until.pop(name))
            for name in sorted(channels)
            if name in self._late_until
        ]

    def offsets(self) -> dict[str, int]:
        """
        Return the channels to whose stamps another offset is to be added from now on, ns.

        Those whose clock is away from where its shift puts it by more than transport can
        explain. Channels of one host get one offset, lest their delays part them.
        """
        found: dict[str, int] = {}
        shifts = {name: clock.shift_ns for name, clock in self.clocks.items()}
        for name, clock in self.clocks.items():
            offset = clock.offset_ns
            if offset is None or not clock.settled or not clock.believed:
                continue
            if clock.late_ns > self._timeouts[name]:
                continue
            away = abs(offset - shifts[name])
            if away > (self._followed if shifts[name] else self._tolerance):
                nearest = min((0, *shifts.values()), key=lambda shift: abs(offset - shift))
                same = abs(offset - nearest) <= self._followed
                found[name] = shifts[name] = nearest if same else offset
        return found

    def shift(self, offsets: Mapping[str, int]) -> list[tuple[str, str, int]]:
        """
        Add these offsets (ns) to the stamps of channels; what waits of them is dropped.

        Returns
        -------
        list of (str, str, int)
            As `push`.
        """
        for name, offset in offsets.items():
            self.clocks[name].shift_ns = offset
            self.intakes[name].go_on_from(self.position_ns)
        return self._end_late(offsets)

    def clocks_moved(self) -> bool:
        """Return True if a channel whose clock was set back agrees with the detector's."""
        for name, intake in self.intakes.items():
            clock = self.clocks[name]
            if len(intake.queues) == 1 or intake.returned_ns() is not None:
                continue
            if clock.offset_ns is None:
                continue
            if abs(clock.offset_ns - clock.shift_ns) <= self._tolerance:
                return True
        return False

    def take(self, until_ns: int) -> dict[str, MergedBlock]:
        """Remove the samples with stamp <= until_ns, and move the position there."""
        self.position_ns = until_ns
        blocks = {}
        for name, intake in self.intakes.items():
            queue = intake.queues[0]
            stamps, values, marks = queue.take(until_ns)
            shifted = self.clocks[name].shift_ns != 0
            blocks[name] = MergedBlock(stamps, values, marks, queue.peek(), shifted)
        return blocks

    def next_epoch(self) -> None:
        """Leave the present epoch; what still waits in it is given up."""
        for intake in self.intakes.values():
            if len(intake.queues) > 1:
                intake.queues.pop(0)
            else:
                intake.start_again()
        self.silent.clear()
        self._late_until.clear()
        self.position_ns = None
        self.epoch += 1
        for name in self.intakes:
            self._drop_known(name)

    def finish(self) -> None:
        """No more samples will come: everything waiting is complete."""
        for intake in self.intakes.values():
            intake.finish()
        self._finished = True
