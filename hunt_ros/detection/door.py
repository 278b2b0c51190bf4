"""
The door for samples: channels merged in the order of time, all of it journalled.

Each channel may arrive in any blocks and with any delay. A stamp is *complete* once every
channel has spoken up to it: that is the watermark, and only what lies at or before it is
processed. A channel that has gone silent would hold it for ever; `Door.tick`, the only way in
which time enters, lets it go, and takes it back: until then its samples are dropped.

What comes out has been checked, and nobody behind the door checks it again: stamps of a channel
are whole nanoseconds that increase, each in one block alone.

One rule for clocks: a channel whose stamps stay away from the detector's clock has its
*offset* added to them; where the detector's clock was set as well, or there is none, stamps
that go back on all channels begin a new *epoch*.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.detection.journal import JournalEntry
from hunt_ros.errors import HuntError
from hunt_ros.samples import CLOCK_OFFSET_NS, CLOCK_RESET_NS, NANOSECONDS

#: A stamp beyond this is taken for this one: differences of two stay within int64. It is later
#: than any that a header can hold, whose seconds are int32.
_MOST_NS = 2**61
#: Most samples of a later epoch that wait while the others do not follow: 50 s at 2 kHz.
_WAITING = 100_000
#: Longest stretch worked on at once: bounds the memory an hour of samples takes.
_CHUNK_NS = 60 * NANOSECONDS
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

_Stamps = NDArray[np.int64]
_Values = NDArray[np.float64]
_Marks = NDArray[np.uint8]


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

    stamps_ns: _Stamps
    values: _Values
    marks: _Marks
    following: tuple[int, float] | None
    shifted: bool


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
    def stamps(self) -> _Stamps:
        """Stamps of the waiting samples, ns, shape (n,); valid until the next call."""
        return self._arrays[0][self._head : self._tail]

    @property
    def first_ns(self) -> int | None:
        return int(self._arrays[0][self._head]) if len(self) else None

    @property
    def last_ns(self) -> int | None:
        return int(self._arrays[0][self._tail - 1]) if len(self) else None

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

    def push_one(self, stamp_ns: int, value: float, mark: int) -> None:
        """Append one sample; after a leap it begins a new run."""
        place = self._room(1)
        stamps, values, marks = self._arrays
        stamps[place], values[place], marks[place] = stamp_ns, value, mark
        if self.newest_ns is None or stamp_ns - self.newest_ns > _STAMP_JUMP_NS:
            self.run_ns, self.before_run_ns = stamp_ns, self.newest_ns
        self.newest_ns = stamp_ns

    def push(self, stamps_ns: _Stamps, values: _Values, marks: _Marks | int = 0) -> None:
        """Append samples without a leap, arrays of shape (n,), n > 0."""
        place = self._room(stamps_ns.size)
        for array, new in zip(self._arrays, (stamps_ns, values, marks), strict=True):
            array[place : self._tail] = new
        self.newest_ns = int(stamps_ns[-1])

    def extend(self, later: _Queue) -> None:
        """Append all that waits in another queue, at least one; its runs go on here."""
        stamps, values, marks = (array[later._head : later._tail] for array in later._arrays)
        self.push(stamps, values, marks)
        self.newest_ns = later.newest_ns
        self.run_ns, self.before_run_ns = later.run_ns, later.before_run_ns

    def take(self, until_ns: int) -> tuple[_Stamps, _Values, _Marks, tuple[int, float] | None]:
        """Remove the samples with stamp <= until_ns, and look at the next one."""
        end = self._head + int(np.searchsorted(self.stamps, until_ns, side='right'))
        stamps, values, marks = (array[self._head : end].copy() for array in self._arrays)
        self._head = end
        following = (int(self.stamps[0]), float(self._arrays[1][end])) if len(self) else None
        return stamps, values, marks, following

    def mark_first(self, mark: int) -> None:
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
        self.late_until_ns: int | None = None  # newest of those that come too late just now
        #: For a replay: epoch, first and last stamp of what came too late; None: to its end.
        self.known_late: list[tuple[int, int, int | None]] = []
        self._held: tuple[int, float] | None = None
        self._behind: list[tuple[int, float]] = []
        self._mark = 0

    @property
    def newest_ns(self) -> int | None:
        """Newest stamp of the present epoch, also when that sample is gone, ns."""
        return self.queues[0].newest_ns

    def push(self, stamps_ns: _Stamps, values: _Values) -> None:
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

    def _push_all(self, stamps_ns: _Stamps, values: _Values) -> None:
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
        self.queues[-1].push_one(stamp_ns, value, self._mark)
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

    def drop_known(self, epoch: int) -> None:
        """Drop what a journal says came too late in an epoch."""
        for number, first_ns, last_ns in self.known_late:
            stamps = self.queues[0].stamps
            if number == epoch and stamps.size:
                begin, end = int(np.searchsorted(stamps, first_ns)), stamps.size
                if last_ns is not None:
                    end = int(np.searchsorted(stamps, last_ns, side='right'))
                if end > begin:
                    self.drop(begin, end, LATE)

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


class Stretch(NamedTuple):
    """All samples in (after_ns, until_ns] by channel; `after_ns` None: the first of an epoch."""

    after_ns: int | None
    until_ns: int
    blocks: dict[str, Block]


class Door:
    """
    Takes the samples of all channels in, and gives them out once every channel has spoken.

    Parameters
    ----------
    timeouts_ns : mapping of str to int
        Expected channels, each with the silence after which it is let go.
    drain_ns : int
        Where every channel is silent, the stamps this far beyond the newest are
        complete as well, so that the silence itself is processed.
    period_ns : int
        Spacing of the rows, which lie on its multiples.

    Attributes
    ----------
    channels : dict of str to Channel
    position_ns : int or None
        Stamp up to which samples have been taken in this epoch.
    epoch : int
        Number of clock resets so far.
    """

    def __init__(self, timeouts_ns: Mapping[str, int], drain_ns: int, period_ns: int) -> None:
        self.channels = {name: Channel(timeout) for name, timeout in timeouts_ns.items()}
        self.position_ns: int | None = None
        self.epoch = 0
        #: Offsets below the first may be transport delay: they are left alone. One that is known
        #: is followed within the second, so that no step of it leaves a gap that is silence.
        self._tolerance = min(timeouts_ns.values())
        self._followed = self._tolerance // 2
        self._drain_ns = drain_ns
        self._period_ns = period_ns
        self._limit: tuple[int, int | None] | None = None
        self._silence_until_ns: int | None = None
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

    def push(self, name: str, stamps_ns: ArrayLike, values: ArrayLike) -> None:
        """Take samples of one channel in, see `HuntingDetector.update`."""
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
            return
        channel = self.channels[name]
        if not channel.received:
            self.note('heard', channels={name: int(stamps[0])})
        before = {silent: len(self.channels[silent].queues[0]) for silent in self.silent}
        self._finished = False
        channel.push(stamps, numbers)
        if channel.silent:
            # Of an epoch that the others do not follow into the first and the newest are kept.
            while len(channel.queues) > 1 and len(channel.queues[-1]) > _WAITING:
                channel.refused['clock'] += _WAITING // 2
                channel.queues[-1].drop(1, 1 + _WAITING // 2, BACKWARD)
        for moved in dict.fromkeys([name, *self._rejoin()]):
            if moved in before:
                channel = self.channels[moved]
                channel.drop(before[moved], len(channel.queues[0]), LATE)
            else:
                self._drop_late(moved)

    def _drop_late(self, name: str) -> None:
        """Drop what lies behind the position; note where such a run begins and ends."""
        channel = self.channels[name]
        channel.drop_known(self.epoch)
        stamps = channel.queues[0].stamps
        if self.position_ns is not None and stamps.size and stamps[0] <= self.position_ns:
            count = int(np.searchsorted(stamps, self.position_ns, side='right'))
            if channel.late_until_ns is None:
                self.note('late_from', channels={name: int(stamps[0])})
            channel.late_until_ns = int(stamps[count - 1])
            channel.drop(0, count, LATE)
        if len(channel.queues[0]):
            self._end_late([name])

    def _end_late(self, names: Iterable[str]) -> None:
        """Note the end of runs of late samples."""
        for name in sorted(names):
            channel = self.channels[name]
            if channel.late_until_ns is not None:
                self.note('late_to', channels={name: channel.late_until_ns})
                channel.late_until_ns = None

    def _rejoin(self) -> list[str]:
        """Take channels back into the present epoch whose clock had leapt; return them."""
        back = []
        for name, channel in self.channels.items():
            while (stamp := channel.returned_ns()) is not None and self._is_time(stamp, channel):
                channel.rejoin()
                back.append(name)
        return back

    def _is_time(self, stamp_ns: int, apart: Channel) -> bool:
        """Return True if another channel came to a stamp in the present epoch without a leap."""
        for channel in self.channels.values():
            queue = channel.queues[0]
            if channel is apart or queue.run_ns is None or queue.newest_ns is None:
                continue
            if queue.run_ns <= stamp_ns <= queue.newest_ns:
                return True
        return False

    def tick(self, now_ns: int) -> bool:
        """Let silent channels go, take them back, follow the clocks; True: a new epoch began."""
        for channel in self.channels.values():
            channel.clock.look(now_ns)
        if overdue := self._overdue(now_ns):
            self.note('released', now_ns=now_ns, **self.received(overdue))
            self._release(overdue)
        if offsets := self._offsets():
            self.note('offset', now_ns=now_ns, offsets=offsets, **self.received(offsets))
            self._shift(offsets)
        if back := self._back():
            self.note('resumed', now_ns=now_ns, **self.received(back))
            self._resume(back)
        if moved := self._clocks_moved():
            self.note('clock', now_ns=now_ns, **self.received(self.channels))
            self._next_epoch()
        return moved

    def repeat(self, entry: JournalEntry) -> bool:
        """For a replay: do what an entry says; True: a new epoch began."""
        if entry.kind == 'released':
            self._release(entry.channels)
        elif entry.kind == 'offset':
            self._shift(entry.offsets)
        elif entry.kind == 'resumed':
            self._resume(entry.channels)
        elif entry.kind == 'clock':
            self._next_epoch()
            return True
        return False

    def hold_at(self, entry: JournalEntry | None) -> None:
        """For a replay: give nothing beyond the position of an entry; None: all of it again."""
        self._limit = None if entry is None else (entry.epoch, entry.position_ns)

    def finish(self) -> None:
        """No more samples will come: everything waiting is complete."""
        for channel in self.channels.values():
            channel.finish()
        self._finished = True

    def complete(self) -> Iterator[Stretch | None]:
        """Give out what is complete, stretch by stretch; None where a new epoch begins."""
        while True:
            until_ns = self._next_ns()
            if until_ns is not None:
                after_ns, self.position_ns = self.position_ns, until_ns
                yield Stretch(
                    after_ns,
                    until_ns,
                    {
                        name: Block(*c.queues[0].take(until_ns), c.clock.shift_ns != 0)
                        for name, c in self.channels.items()
                    },
                )
            elif self._epoch_ends():
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
        known = [c.newest_ns for c in self.channels.values() if c.newest_ns is not None]
        if not known:
            return ()
        front, first = max(known), self._first_ns()
        since = front if first is None else first
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
            return self._end_of_epoch_ns()
        awaited = [channel for channel in self.channels.values() if not channel.silent]
        if not awaited:
            return self._silence_until_ns
        known = [c.newest_ns for c in awaited if c.newest_ns is not None]
        return min(known) if len(known) == len(awaited) else None

    def _next_ns(self) -> int | None:
        """Last row of the next stretch that is complete, ns; None where no row is."""
        until, position = self.watermark_ns, self.position_ns
        if self._limit is not None and self.epoch >= self._limit[0]:
            epoch, last = self._limit
            if until is None or last is None or self.epoch > epoch:
                return None
            until = min(until, last)
        if until is None:
            return None
        last, begin = self._row_before(until), self._first_ns()
        if begin is None:
            begin = last
        if position is not None:
            begin = max(begin, position)
        last = min(last, self._row_before(begin + _CHUNK_NS))
        return last if position is None or last > position else None

    def _row_before(self, stamp_ns: int) -> int:
        """Return the last row not after a stamp."""
        return stamp_ns // self._period_ns * self._period_ns

    def _first_ns(self) -> int | None:
        """Oldest stamp waiting in the present epoch, ns."""
        firsts = [channel.queues[0].first_ns for channel in self.channels.values()]
        return min((first for first in firsts if first is not None), default=None)

    def _epoch_ends(self) -> bool:
        """True where the next epoch begins: all is said in this one, and more waits."""
        free = self._limit is None or self.epoch < self._limit[0]
        return free and self._epoch_over() and self._more_epochs()

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
            return self._more_epochs()
        return max(ends) - min(ends) <= max(c.timeout_ns for c in self.channels.values())

    def _more_epochs(self) -> bool:
        """True where samples of a later epoch wait."""
        return any(len(channel.queues) > 1 for channel in self.channels.values())

    def _end_of_epoch_ns(self) -> int | None:
        """Newest stamp waiting in the present epoch, or the position where nothing waits."""
        ends = [channel.queues[0].last_ns for channel in self.channels.values()]
        known = [end for end in (*ends, self.position_ns) if end is not None]
        return max(known, default=None)

    def _next_epoch(self) -> None:
        """Leave the present epoch; what still waits in it is given up."""
        silent = sorted(self.silent)
        for channel in self.channels.values():
            if len(channel.queues) > 1:
                channel.queues.pop(0)
            else:
                channel.start_again()
            channel.silent, channel.late_until_ns = False, None
        self.position_ns = None
        self.epoch += 1
        for channel in self.channels.values():
            channel.drop_known(self.epoch)
        if silent:
            self.note('resumed', channels=dict.fromkeys(silent))

    def _overdue(self, now_ns: int) -> list[str]:
        """Return the channels that are silent for longer than their timeout since now."""
        found = []
        for name, channel in self.channels.items():
            if len(channel.queues) > 1 and channel.newest_ns is not None:
                # Its clock was set: nothing more in this epoch.
                overdue = now_ns - channel.newest_ns > channel.timeout_ns
            else:
                clock = channel.clock
                overdue = clock.late_ns > channel.timeout_ns or not clock.believed
            if overdue and not channel.silent:
                found.append(name)
        return found

    def _release(self, names: Iterable[str]) -> None:
        """Wait for channels no more."""
        for name in names:
            self.channels[name].silent = True
        known = [c.newest_ns for c in self.channels.values() if c.newest_ns is not None]
        self._silence_until_ns = max(known) + self._drain_ns if known else None
        self._end_late(names)

    def _back(self) -> list[str]:
        """Return the silent channels that deliver again, by less than half their timeout late."""
        return [
            name
            for name, channel in self.channels.items()
            if channel.silent
            and channel.clock.fresh
            and channel.clock.believed
            and 2 * channel.clock.late_ns <= channel.timeout_ns
            and len(channel.queues) == 1
        ]

    def _resume(self, names: Iterable[str]) -> None:
        for name in names:
            self.channels[name].silent = False

    def _offsets(self) -> dict[str, int]:
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

    def _shift(self, offsets: Mapping[str, int]) -> None:
        """Add these offsets (ns) to the stamps of channels; what waits of them is dropped."""
        for name, offset in offsets.items():
            self.channels[name].go_on_from(self.position_ns, offset)
        self._end_late(offsets)

    def _clocks_moved(self) -> bool:
        """Return True if a channel whose clock was set back agrees with the detector's."""
        for channel in self.channels.values():
            clock = channel.clock
            if len(channel.queues) == 1 or channel.returned_ns() is not None:
                continue
            if clock.offset_ns is None:
                continue
            if abs(clock.offset_ns - clock.shift_ns) <= self._tolerance:
                return True
        return False
