"""
The door for samples: channels merged in the order of time, all of it journalled.

Each channel may arrive in any blocks and with any delay. A stamp is *complete* once every
channel has spoken up to it: that is the watermark, and only what lies at or before it is
processed. A channel that has gone silent would hold it for ever; `Door.tick`, the only way in
which time enters, lets it go, and takes it back: until then its samples are dropped.

One rule for clocks: a channel whose stamps stay away from the detector's clock has its
*offset* added to them; where the detector's clock was set as well, or there is none, stamps
that go back on all channels begin a new *epoch*.
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hunt_ros.detection.journal import JournalEntry
from hunt_ros.detection.stamps import BACKWARD, LATE, Channel, Marks, Stamps, Values
from hunt_ros.errors import HuntError
from hunt_ros.samples import NANOSECONDS

#: A stamp beyond this is taken for this one: differences of two stay within int64. It is later
#: than any that a header can hold, whose seconds are int32.
_MOST_NS = 2**61
#: Most samples of a later epoch that wait while the others do not follow: 50 s at 2 kHz.
_WAITING = 100_000
#: Longest stretch worked on at once: bounds the memory an hour of samples takes.
_CHUNK_NS = 60 * NANOSECONDS


class Block(NamedTuple):
    """
    Samples of one channel taken out of the door.

    Parameters
    ----------
    stamps_ns : ndarray of int64, shape (n,)
    values : ndarray of float64, shape (n,)
    marks : ndarray of uint8, shape (n,)
        Stamp faults since the sample before: `REPEATED`, `BACKWARD`, `AHEAD`, `LATE`.
    following : tuple of (int, float) or None
        Stamp and value of the channel's next sample, where it is known already.
    shifted : bool
        The offset of the channel's clock was added to the stamps.
    """

    stamps_ns: Stamps
    values: Values
    marks: Marks
    following: tuple[int, float] | None
    shifted: bool


#: Stamps of rows, ns, shape (m,), m > 0, and all samples up to the last of them, by channel.
Stretch = tuple[Stamps, dict[str, Block]]


class Door:
    """
    Takes the samples of all channels in, and gives them out once every channel has spoken.

    Parameters
    ----------
    timeouts_ns : mapping of str to int
        Expected channels, each with the silence after which it is let go.
    period_ns : int
        Spacing of the rows, which lie on its multiples whatever the samples' stamps are.

    Attributes
    ----------
    channels : dict of str to Channel
    position_ns : int or None
        Stamp up to which samples have been taken in this epoch.
    epoch : int
        Number of clock resets so far.
    """

    def __init__(self, timeouts_ns: Mapping[str, int], period_ns: int) -> None:
        self.channels = {name: Channel(timeout) for name, timeout in timeouts_ns.items()}
        self.position_ns: int | None = None
        self.epoch = 0
        #: Offsets below the first may be transport delay: they are left alone. One that is known
        #: is followed within the second, so that no step of it leaves a gap that is silence.
        self._tolerance = min(timeouts_ns.values())
        self._followed = self._tolerance // 2
        #: Where every channel is silent, the stamps this far beyond the newest are complete as
        #: well, so that the silence itself is processed; no row is made beyond.
        self._drain_ns = max(timeouts_ns.values()) + 2 * period_ns
        self._period_ns = period_ns
        self._limit: tuple[int, int | None] | None = None
        self._silence_until_ns: int | None = None
        self._newest_ns: int | None = None  # that was given out in this epoch
        self._finished = False
        self._journal: list[JournalEntry] = []

    def note(self, kind: str, **fields: Any) -> None:
        """Write an entry into the journal, at the present position."""
        self._journal.append(JournalEntry(kind, self.position_ns, self.epoch, **fields))

    def take_journal(self) -> tuple[JournalEntry, ...]:
        """Return what was written since the last call."""
        journal, self._journal = tuple(self._journal), []
        return journal

    def received(self, names: Iterable[str]) -> dict[str, Any]:
        """Return, as fields of an entry, what had come of channels."""
        found = {name: self.channels[name] for name in sorted(names)}
        return {
            'channels': {name: channel.received_ns for name, channel in found.items()},
            'received': {name: channel.received for name, channel in found.items()},
        }

    def take(self, samples: Mapping[str, tuple[ArrayLike, ArrayLike]]) -> None:
        """Take samples in, see `HuntingDetector.feed`."""
        before = self.received(self.channels)
        back = [self.push(name, *each) for name, each in samples.items()]
        if any(back):
            # What has come too late goes by the rows there were: those, and then these samples.
            for received in (before, self.received(self.channels)):
                self.note('back', **received)

    def push(self, name: str, stamps_ns: ArrayLike, values: ArrayLike) -> bool:
        """Take samples of one channel in; True where a clock that had leapt is back."""
        if name not in self.channels:
            raise HuntError(f'channel {name!r} is not one of {tuple(self.channels)}')
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64)).clip(-_MOST_NS, _MOST_NS)
        numbers = np.atleast_1d(np.asarray(values, dtype=np.float64))
        if stamps.shape != numbers.shape or stamps.ndim != 1:
            raise HuntError(
                f'{name}: {stamps.shape} stamps and {numbers.shape} values,'
                ' expected one value a stamp'
            )
        if not stamps.size:
            return False
        channel = self.channels[name]
        if not channel.received:
            self.note('heard', channels={name: int(stamps[0])})
        before = {silent: len(self.channels[silent].queues[0].stamps) for silent in self.silent}
        self._finished = False
        channel.push(stamps, numbers)
        if channel.silent:
            # Of an epoch that the others do not follow into the first and the newest are kept.
            while len(channel.queues) > 1 and len(channel.queues[-1].stamps) > _WAITING:
                channel.refused['clock'] += _WAITING // 2
                channel.queues[-1].drop(1, 1 + _WAITING // 2, BACKWARD)
        any_back = False
        for moved, channel in self.channels.items():
            back = False
            while (stamp := channel.returned_ns()) is not None and self._is_time(stamp, channel):
                place, back = channel.rejoin(), True
                before[moved] = min(before.get(moved, place), place)
            if channel.silent and (back or moved == name):
                channel.drop(before[moved], len(channel.queues[0].stamps), LATE)
            elif self.position_ns is not None:  # what lies behind it has come too late
                end = bisect_right(channel.queues[0].stamps, self.position_ns)
                channel.drop(0, end, LATE)
            any_back |= back
        return any_back

    def _is_time(self, stamp_ns: int, apart: Channel) -> bool:
        """Return True if another channel came to a stamp in the present epoch without a leap."""
        queues = [each.queues[0] for each in self.channels.values() if each is not apart]
        runs = [(queue.run_ns, queue.newest_ns) for queue in queues]
        return any(
            begin is not None and end is not None and begin <= stamp_ns <= end
            for begin, end in runs
        )

    def tick(self, now_ns: int) -> bool:
        """Let silent channels go, take them back, follow the clocks; True: a new epoch began."""
        anew = False
        for channel in self.channels.values():
            channel.clock.look(now_ns)
        for kind, look in (
            ('released', self._overdue),
            ('offset', self._offsets),
            ('resumed', self._back),
            ('clock', self._clocks_moved),
        ):
            if found := look(now_ns):
                offsets = found if kind == 'offset' else {}
                self.note(kind, now_ns=now_ns, offsets=offsets, **self.received(found))
                anew |= self.repeat(self._journal[-1])
        return anew

    def repeat(self, entry: JournalEntry) -> bool:
        """Do what an entry says; True: a new epoch began."""
        if entry.kind == 'released':
            for name in entry.channels:
                self.channels[name].silent = True
            newest = self._newest()
            self._silence_until_ns = max(newest) + self._drain_ns if newest else None
        elif entry.kind == 'offset':
            for name, offset in entry.offsets.items():  # what waits of them is dropped
                self.channels[name].go_on_from(self.position_ns, offset)
        elif entry.kind == 'resumed':
            for name in entry.channels:
                self.channels[name].silent = False
        elif entry.kind == 'clock':
            self._next_epoch()
            return True
        return False

    def hold_at(self, entry: JournalEntry | None) -> None:
        """For a replay: give nothing beyond the position of an entry; None: all of it again."""
        self._limit = None if entry is None else (entry.epoch, entry.position_ns)

    def finish(self) -> None:
        """
        No more samples will come: everything waiting is complete.

        A channel that goes on where the clocks of others were set back, and ends with them, was
        silent meanwhile: it is in their next epoch.
        """
        for channel in self.channels.values():
            channel.finish()
        later = self._in_later_epochs()
        left_ns = max((c.newest_ns or 0 for c in later), default=0)
        end_ns = max((c.queues[-1].newest_ns or 0 for c in later), default=0)
        for channel in self.channels.values():
            newest_ns, alone = channel.newest_ns or 0, bool(later) and channel not in later
            if alone and newest_ns > left_ns and abs(newest_ns - end_ns) <= self._drain_ns:
                channel.queues.append(channel.queues[0].split(left_ns))
        self._finished = True

    def complete(self) -> Iterator[Stretch | None]:
        """Give out what is complete, stretch by stretch; None where a new epoch begins."""
        while True:
            until_ns = self._next_ns()
            if until_ns is not None:
                after_ns, self.position_ns = self.position_ns, until_ns
                blocks = {
                    name: Block(*c.queues[0].take(until_ns), c.clock.shift_ns != 0)
                    for name, c in self.channels.items()
                }
                stamps = np.concatenate([block.stamps_ns for block in blocks.values()])
                stamps.sort(kind='stable')  # runs that are in order are merged
                rows = self._rows(after_ns, until_ns, stamps)
                if rows.size:  # there is one at or behind every sample
                    yield rows, blocks
            elif self._is_free and self._epoch_over() and self._in_later_epochs():
                if self.silent:  # whether they were is not in the samples
                    self.note('clock', **self.received(self.channels))
                self._next_epoch()
                yield None
            else:
                return

    @property
    def silent(self) -> frozenset[str]:
        """Channels that were let go and are not back."""
        return frozenset(name for name, channel in self.channels.items() if channel.silent)

    @property
    def dropped(self) -> dict[str, int]:
        """Samples refused so far, by 'channel reason'."""
        return {
            f'{name} {reason}': count
            for name, channel in self.channels.items()
            for reason, count in channel.refused.items()
            if count
        }

    @property
    def clock_offsets_s(self) -> dict[str, float]:
        """By how much the detector's clock is ahead of those of the channels, where known, s."""
        clocks = {name: channel.clock for name, channel in self.channels.items()}
        return {
            name: 1e-9 * (clock.shift_ns if clock.offset_ns is None else clock.offset_ns)
            for name, clock in clocks.items()
            if clock.offset_ns is not None or clock.shift_ns
        }

    @property
    def behind(self) -> tuple[str, ...]:
        """
        The channels for which the others have waited longer than ticks would let them.

        One sentence each. Without ticks, or where the clock stands still, no channel is ever
        let go: no rows come, and the last one is not what is now.
        """
        front = max(self._newest(), default=0)
        since = min((stamps[0] for stamps in self._waiting()), default=front)
        found = []
        for name, channel in self.channels.items():
            lag = front - (since if channel.newest_ns is None else channel.newest_ns)
            if lag > self._drain_ns and not channel.silent:
                found.append(f'{name}: {1e-9 * lag:.1f} s behind the other channels')
        return tuple(found)

    @property
    def watermark_ns(self) -> int | None:
        """Stamp up to which every channel that is not silent has spoken; None before that."""
        if self._epoch_over():
            return max((stamps[-1] for stamps in self._waiting()), default=self.position_ns)
        awaited = [channel for channel in self.channels.values() if not channel.silent]
        if not awaited:
            return self._silence_until_ns
        newest = [c.newest_ns for c in awaited if c.newest_ns is not None]
        return min(newest) if len(newest) == len(awaited) else None

    def _newest(self) -> list[int]:
        """Return the newest stamps of the channels that have one in the present epoch, ns."""
        return [c.newest_ns for c in self.channels.values() if c.newest_ns is not None]

    def _waiting(self) -> list[array[int]]:
        """Return the stamps that wait in the present epoch, ns, of each channel that has any."""
        return [c.queues[0].stamps for c in self.channels.values() if c.queues[0].stamps]

    def _next_ns(self) -> int | None:
        """Last row of the next stretch that is complete, ns; None where no row is."""
        until, position = self.watermark_ns, self.position_ns
        if not self._is_free and self._limit is not None:
            epoch, last = self._limit
            if until is None or last is None or self.epoch > epoch:
                return None
            until = min(until, last)
        if until is None:
            return None
        first = min((stamps[0] for stamps in self._waiting()), default=until)
        begin = first if position is None else max(first, position)
        last = min(until, begin + _CHUNK_NS) // self._period_ns * self._period_ns
        return last if position is None or last > position else None

    @property
    def _is_free(self) -> bool:
        """False in an epoch in which it is held at a position."""
        return self._limit is None or self.epoch < self._limit[0]

    def _rows(self, after_ns: int | None, until_ns: int, stamps_ns: Stamps) -> Stamps:
        """Return the rows in (after_ns, until_ns] that follow one of the samples soon enough."""
        newest = self._newest_ns
        if stamps_ns.size:
            self._newest_ns = int(stamps_ns[-1])
        elif newest is None:
            return stamps_ns
        if newest is None or after_ns is None:  # the first of an epoch
            begin = int(stamps_ns[0]) - 1
        else:
            begin, stamps_ns = after_ns, np.concatenate(([newest], stamps_ns))
        # From each long silence to the next: `drain` beyond the last sample before it.
        breaks = np.flatnonzero(np.diff(stamps_ns) > self._drain_ns)
        starts = [begin, *(stamps_ns[breaks + 1] - 1).tolist()]
        ends = (stamps_ns[[*breaks, -1]] + self._drain_ns).tolist()
        parts = [
            np.arange(
                max(low, begin) // self._period_ns + 1, min(high, until_ns) // self._period_ns + 1
            )
            for low, high in zip(starts, ends, strict=True)
        ]
        return np.concatenate(parts) * self._period_ns

    def _epoch_over(self) -> bool:
        """
        True where no channel has anything more to say in the present epoch.

        Clocks that are set back are set back together: where one channel was long before
        the others, its clock has leapt, and may come back.
        """
        if self._finished:
            return True
        ends = []
        for channel in self.channels.values():
            if channel.silent:
                continue
            if len(channel.queues) == 1 or channel.newest_ns is None:
                return False
            ends.append(channel.newest_ns)
        if not ends:
            return bool(self._in_later_epochs())
        return max(ends) - min(ends) <= max(c.timeout_ns for c in self.channels.values())

    def _in_later_epochs(self) -> list[Channel]:
        """Return the channels of which samples of a later epoch wait."""
        return [channel for channel in self.channels.values() if len(channel.queues) > 1]

    def _next_epoch(self) -> None:
        """Leave the present epoch; what still waits in it is given up."""
        for channel in self.channels.values():
            if len(channel.queues) > 1:
                channel.queues.pop(0)
            else:
                channel.start_again()
            channel.silent = False
        self.position_ns = self._newest_ns = None
        self.epoch += 1

    def _overdue(self, now_ns: int) -> list[str]:
        """Return the channels that are silent for longer than their timeout since now."""
        found = []
        for name, channel in self.channels.items():
            late, believed = channel.clock.late_ns, channel.clock.believed
            if len(channel.queues) > 1 and channel.newest_ns is not None:
                # Its clock was set: nothing more in this epoch.
                late, believed = now_ns - channel.newest_ns, True
            if not channel.silent and (late > channel.timeout_ns or not believed):
                found.append(name)
        return found

    def _back(self, _: int) -> list[str]:
        """Return the silent channels that deliver again, by less than half their timeout late."""
        found = []
        for name, channel in self.channels.items():
            clock, in_epoch = channel.clock, len(channel.queues) == 1
            in_time = clock.fresh and 2 * clock.late_ns <= channel.timeout_ns
            if channel.silent and in_epoch and in_time and clock.believed:
                found.append(name)
        return found

    def _offsets(self, _: int) -> dict[str, int]:
        """
        Return the channels to whose stamps another offset is to be added from now on, ns.

        Those whose clock is away from where its shift puts it by more than transport can
        explain. Channels of one host get one offset, lest their delays part them.
        """
        found: dict[str, int] = {}
        shifts = {name: channel.clock.shift_ns for name, channel in self.channels.items()}
        for name, channel in self.channels.items():
            clock, offset = channel.clock, channel.clock.offset_ns
            if offset is None or not clock.settled or not clock.believed:
                continue
            if clock.late_ns > channel.timeout_ns:
                continue
            away = abs(offset - shifts[name])
            if away > (self._followed if shifts[name] else self._tolerance):
                nearest = min((0, *shifts.values()), key=lambda shift: abs(offset - shift))
                same = abs(offset - nearest) <= self._followed
                found[name] = shifts[name] = nearest if same else offset
        return found

    def _clocks_moved(self, _: int) -> Iterable[str]:
        """Return all channels if one whose clock was set back agrees with the detector's."""
        for channel in self.channels.values():
            offset_ns, shift_ns = channel.clock.offset_ns, channel.clock.shift_ns
            if len(channel.queues) == 1 or channel.returned_ns() is not None or offset_ns is None:
                continue
            if abs(offset_ns - shift_ns) <= self._tolerance:
                return self.channels
        return ()
