"""
The hunting detector: samples in, estimates, events and status out.

It merges the channels (`merge`), watches them (`health`), tracks the hunting
motion (`hunt_ros.estimation`), decides row by row (`decisions`) and tells what
changed. It has no clock, no logger and no file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from hunt_ros.detection.acceptance import form_event, form_words
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.merging.journal import JournalEntry
from hunt_ros.detection.merging.merge import ChannelMerger, LateRun
from hunt_ros.detection.merging.schedule import Schedule
from hunt_ros.detection.output import EMPTY, Event, Output
from hunt_ros.detection.regions import Level
from hunt_ros.detection.rows import RowMaker
from hunt_ros.detection.words.alarms import UNKNOWN, AlarmHistory
from hunt_ros.detection.words.reasons import Basis
from hunt_ros.detection.words.status import DetectorStatus, status_of
from hunt_ros.detection.words.transitions import Transitions
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.errors import ConfigError, HuntError
from hunt_ros.samples import CHANNELS, CLOCK_RESET_NS, NANOSECONDS

#: A stamp further ahead than this waits for the next one to confirm it: one bad stamp would make
#: all that follow come too late.
_STAMP_JUMP_NS = NANOSECONDS
#: Sensors whose clock is further from that of the detector are not believed: clocks that drift are
#: nearer, one that is hours away is that of another day.
_CLOCK_OFFSET_NS = 15 * NANOSECONDS

#: A stamp beyond this is taken for this one: differences of two stay within int64. It is later
#: than any that a header can hold, whose seconds are int32.
_MOST_NS = 2**61


class HuntingDetector:
    """
    From the channels of the rig to region, state, level and alarm.

    Parameters
    ----------
    config : DetectorConfig, optional
    normal_form : IdentifiedNormalForm, optional
        Without one, v_n and v_c of the config stand in for the regions; with
        neither, growth rate and noise floor decide, and the region is unknown.

    Notes
    -----
    *Stream equals batch*: the same samples in any blocks, the channels interleaved
    in any way, give the same rows and events bit for bit. Rows wait until every
    channel has spoken up to their stamp; a silent channel is let go by `tick` alone,
    which is written to the journal, as is everything else that is not in the
    samples: `hunt_ros.detection.replay.replay_journal` repeats a live run.
    """

    def __init__(
        self,
        config: DetectorConfig | None = None,
        normal_form: IdentifiedNormalForm | None = None,
    ) -> None:
        self._form = normal_form
        self._history = AlarmHistory((config or DetectorConfig()).period_ns)
        self._start(config or DetectorConfig(), {}, {})

    def _start(
        self,
        config: DetectorConfig,
        last: dict[str, int | None],
        received: dict[str, int],
        memory: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        """
        Make everything anew, but for the normal form and what is to be remembered.

        Say what had been received before.
        """
        self.config = c = config
        self._channels = tuple(name for name in CHANNELS if name in c.channels)
        timeouts = {name: c.timeout_ns(name) for name in self._channels}
        drain = max(timeouts.values()) + 2 * c.period_ns
        self._merger = ChannelMerger(
            timeouts,
            _STAMP_JUMP_NS,
            CLOCK_RESET_NS,
            _CLOCK_OFFSET_NS,
            drain,
        )
        self._schedule = Schedule(self._merger, c.period_ns)
        self._rows = RowMaker(c, drain)
        self._rows.set_normal_form(self._form)
        self._transitions = Transitions(self._basis())
        self._last_row: np.void | None = None
        self._sequence = 0
        self._rows.remember(memory)
        self._transitions.remember(self._rows.state)
        text = '' if self._form is None else self._form.to_yaml()
        start = JournalEntry(
            'start',
            None,
            channels=last,
            received=received,
            text=text,
            config=asdict(c),
            memory=dict(memory),
        )
        self._journal: list[JournalEntry] = [start]

    def update(self, channel: str, stamps_ns: ArrayLike, values: ArrayLike) -> Output:
        """
        Take samples of one channel, in the order of their arrival.

        Parameters
        ----------
        channel : str
            One of the channels of the config.
        stamps_ns : array_like of int64, shape (n,), or int
            Header stamps. Impossible ones are refused, named in the status, and counted.
        values : array_like of float64, shape (n,), or float
            m, rad, rad, m/s for lateral, yaw, roller, speed. NaN: no reading.

        Returns
        -------
        Output
            Rows that have become complete.

        Raises
        ------
        HuntError
            For a channel the detector has not been told of, or unequal lengths.
        """
        if channel not in self._channels:
            raise HuntError(f'channel {channel!r} is not one of {self._channels}')
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64)).clip(-_MOST_NS, _MOST_NS)
        numbers = np.atleast_1d(np.asarray(values, dtype=np.float64))
        if stamps.shape != numbers.shape or stamps.ndim != 1:
            raise HuntError(
                f'{channel}: {stamps.shape} stamps and {numbers.shape} values,'
                ' expected one value a stamp'
            )
        if not stamps.size:
            return EMPTY
        if channel not in self._merger.received:
            self._note('heard', channels={channel: int(stamps[0])})
        self._note_each(self._merger.push(channel, stamps, numbers))
        return self._advance()

    def tick(self, now_ns: int) -> Output:
        """
        Take the present time; call it a few times a second.

        A channel silent for longer than its timeout is not waited for any more. The clocks
        of the channels may be away from this one by up to `_CLOCK_OFFSET_NS`: what
        stays of the difference is an offset, and is added to the stamps where it is more
        than a delay can be.

        Parameters
        ----------
        now_ns : int
            ns.
        """
        output, merger, now_ns = self._advance(), self._merger, int(now_ns)
        merger.look(now_ns)
        if overdue := merger.overdue(now_ns):
            self._note('released', now_ns, *merger.received_of(overdue))
            self._note_each(merger.release(overdue))
        if offsets := merger.offsets():
            self._note('offset', now_ns, *merger.received_of(offsets), offsets=offsets)
            self._note_each(merger.shift(offsets))
        if back := merger.back():
            self._note('resumed', now_ns, *merger.received_of(back))
            merger.silent -= back
        if merger.clocks_moved():
            self._note_clock(now_ns)
            self._next_epoch()
        if not self._journal:
            return output
        return Output.joined([output, self._advance()])

    def finish(self) -> Output:
        """End of the record: nothing more will come; work up to the last stamp."""
        self._note('finished')
        self._merger.finish()
        return self._advance()

    def set_normal_form(self, form: IdentifiedNormalForm | None) -> Output:
        """
        Use another normal form (None: none) from the next row on.

        Once there are rows this is an event, 'normal_form_changed', or
        'normal_form_reverted' where a person went back to an earlier form.
        """
        self._form = form
        self._rows.set_normal_form(form)
        self._note('normal_form', text='' if form is None else form.to_yaml())
        self._transitions.basis = self._basis()
        row = self._last_row
        output = self._advance()
        if row is None:
            return output
        word, cause = form_event(form)
        event = self._transitions.event_of(row, word, 'normal_form', cause)
        return replace(output, events=(event, *output.events))

    def _basis(self) -> Basis:
        """Return what the words compare the numbers with."""
        if self._form is None:
            return Basis(self.config, *self._rows.boundaries)
        fold = self._form.form.saddle_node()
        return Basis(
            self.config,
            *self._rows.boundaries,
            form_words(self._form),
            fold_amplitude=math.nan if fold is None else fold[1],
            frequency_hz=self._form.form.frequency_hz,
        )

    def reconfigure(self, config: DetectorConfig) -> Output:
        """
        Use other settings from the next row on; nothing that has been learnt or seen is lost.

        Parameters
        ----------
        config : DetectorConfig
            Differs from the one in force only in settings that are not `fixed`.

        Raises
        ------
        ConfigError
            Naming a fixed setting that differs.
        """
        for item in fields(config):
            old, new = getattr(self.config, item.name), getattr(config, item.name)
            if item.metadata['fixed'] and new != old:
                raise ConfigError(f'{item.name}: {new!r} can only be given at the start')
        self.config = config
        self._rows.reconfigure(config)
        self._transitions.basis = self._basis()
        self._note('settings', config=asdict(config))
        return self._advance()

    def acknowledge(self, now_ns: int = 0, by: str = '') -> Output:
        """
        Acknowledge the alarm; while the wheelset still hunts it stays until that is over.

        Parameters
        ----------
        now_ns : int
            For the journal and the history.
        by : str
            Who does; '' where that is not known.
        """
        self._rows.acknowledge()
        self._history.acknowledge(now_ns, by)
        self._note('acknowledged', now_ns, text=by)
        row = self._last_row
        cause = f'by {by or UNKNOWN}'
        if self._rows.alarm:
            cause += ': the alarm ends with the hunting'
        if row is None:
            event = Event(now_ns, 'acknowledged', Level.STALE, now_ns, 'operator', cause)
        else:
            event = self._transitions.event_of(row, 'acknowledged', 'operator', cause)
        output = self._advance()
        return replace(output, events=(event, *output.events))

    def hold_at(self, entry: JournalEntry) -> Output:
        """For a replay: make the rows up to the position of a journal entry, and no more."""
        self._schedule.hold_at(entry)
        return self._advance()

    def let_go(self) -> Output:
        """For a replay: end `hold_at`."""
        self._schedule.let_go()
        return self._advance()

    def expect_late(self, channel: str, run: LateRun) -> None:
        """For a replay: drop samples that came too late in the live run."""
        self._merger.known_late.setdefault(channel, []).append(run)

    def repeat(self, entry: JournalEntry) -> Output:
        """For a replay: do what an entry says."""
        if entry.kind == 'released':
            self._note_each(self._merger.release(entry.channels))
        elif entry.kind == 'resumed':
            self._merger.silent -= set(entry.channels)
        elif entry.kind == 'offset':
            self._note_each(self._merger.shift(entry.offsets))
        elif entry.kind == 'clock':
            self._next_epoch()
        elif entry.kind == 'normal_form':
            text = entry.text
            return self.set_normal_form(IdentifiedNormalForm.from_yaml(text) if text else None)
        elif entry.kind == 'settings':
            return self.reconfigure(DetectorConfig.from_recorded(entry.config))
        elif entry.kind == 'acknowledged':
            return self.acknowledge(entry.now_ns, entry.text)
        elif entry.kind == 'finished':
            return self.finish()
        return self._advance()

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels it has been told of."""
        return self._channels

    @property
    def silent(self) -> frozenset[str]:
        """The channels that are not waited for."""
        return frozenset(self._merger.silent)

    def reset(
        self,
        config: DetectorConfig | None = None,
        memory: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        """
        Forget every sample, the alarms and the journal; keep the normal form.

        Parameters
        ----------
        config : DetectorConfig, optional
            Settings from now on; without them those it has.
        memory : mapping of str to float
            For a replay: what a restart of the live run kept; with any, the history of alarms
            is kept as well.
        """
        config = config or self.config
        last, received = self._merger.received_of(self._merger.received)
        if not memory:
            self._history = AlarmHistory(config.period_ns)
        self._start(config, last, received, memory)

    def restart(self) -> None:
        """
        Begin anew after a pause in which nothing was seen.

        Config, normal form, noise floor, hunting, alarm and the history of alarms are kept: a
        pause ends no hunting, and only `acknowledge` takes an alarm back.
        """
        self.reset(self.config, self._rows.lasting())

    @property
    def history(self) -> AlarmHistory:
        """The alarms there were."""
        return self._history

    @property
    def status(self) -> DetectorStatus:
        """The present view."""
        merger = self._merger
        until = merger.watermark_ns
        return status_of(
            self._last_row,
            self._transitions,
            merger.intakes,
            merger.clocks,
            (self._rows.state, self._rows.alarm),
            self._history,
            self._sequence,
            until,
            merger.behind,
        )

    def _note(
        self,
        kind: str,
        now_ns: int = 0,
        channels: dict[str, int | None] | None = None,
        received: dict[str, int] | None = None,
        text: str = '',
        offsets: dict[str, int] | None = None,
        config: dict[str, object] | None = None,
    ) -> None:
        """Write into the journal, at the position of the merger."""
        self._journal.append(
            JournalEntry(
                kind,
                self._merger.position_ns,
                self._merger.epoch,
                now_ns,
                channels or {},
                received or {},
                offsets or {},
                text,
                config=config or {},
            )
        )

    def _note_clock(self, now_ns: int = 0) -> None:
        self._note('clock', now_ns, *self._merger.received_of(self._channels))

    def _note_each(self, notes: list[tuple[str, str, int]]) -> None:
        for kind, channel, stamp in notes:
            self._note(kind, channels={channel: stamp})

    def _advance(self) -> Output:
        """Make every row that is complete."""
        outputs: list[Output] = []
        while True:
            last_ns = self._schedule.next_ns
            if last_ns is not None:
                outputs.append(self._make_rows(self._merger.position_ns, last_ns))
            elif self._schedule.epoch_ends:
                if self._merger.silent:  # whether they were is not in the samples
                    self._note_clock()
                self._next_epoch()
            else:
                break
        journal, self._journal = tuple(self._journal), []
        output = Output.joined(outputs)
        return replace(output, journal=journal) if journal else output

    def _next_epoch(self) -> None:
        """Begin anew after the clocks were set back."""
        silent = self._merger.silent.copy()
        self._merger.next_epoch()
        self._rows.start_again()
        if silent:
            self._note('resumed', channels=dict.fromkeys(sorted(silent)))

    def _make_rows(self, after_ns: int | None, until_ns: int) -> Output:
        """Work on the samples in (after_ns, until_ns]."""
        rows, motion = self._rows.make(after_ns, until_ns, self._merger.take(until_ns))
        if not rows.size:
            return EMPTY
        events = self._transitions.update(rows)
        self._history.update(rows, events)
        self._sequence += rows.size
        self._last_row = rows[-1]
        return Output(rows, tuple(events), motion=(motion,))
