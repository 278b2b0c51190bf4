"""
The hunting detector: samples in, estimates, events and status out.

It merges the channels (`door`), watches them (`health`), tracks the hunting
motion (`hunt_ros.estimation`), decides row by row (`decisions`) and tells what
changed. It has no clock, no logger and no file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.detection.acceptance import form_event
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.door import Block, Door
from hunt_ros.detection.journal import JournalEntry
from hunt_ros.detection.output import Output, no_row
from hunt_ros.detection.rows import RowMaker
from hunt_ros.detection.words.alarms import UNKNOWN, AlarmHistory
from hunt_ros.detection.words.clearance import Clearances
from hunt_ros.detection.words.reasons import Basis
from hunt_ros.detection.words.status import DetectorStatus, Transitions
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.errors import ConfigError
from hunt_ros.samples import CHANNELS


class HuntingDetector:
    """
    From the channels of the rig to region, state, level and alarm.

    Parameters
    ----------
    config : DetectorConfig, optional
    normal_form : IdentifiedNormalForm, optional
        Without one, v_n and v_c of the config stand in for the regions; with
        neither, growth rate and noise floor decide, and the region is unknown.

    Attributes
    ----------
    history : AlarmHistory
        The alarms there were.
    clearances : Clearances
        Of the speeds that are held.

    Notes
    -----
    *Stream equals batch*: the same samples in any blocks, the channels interleaved
    in any way, give the same rows and events bit for bit. Rows wait until every
    channel has spoken up to their stamp; a silent channel is let go by `tick` alone,
    which is written to the journal, as is everything else that is not in the
    samples: `hunt_ros.detection.replay.detect` repeats a live run.
    """

    def __init__(
        self,
        config: DetectorConfig | None = None,
        normal_form: IdentifiedNormalForm | None = None,
    ) -> None:
        self._form = normal_form
        self.config = config or DetectorConfig()
        self.reset()

    def reset(self, config: DetectorConfig | None = None) -> None:
        """Begin anew, with these settings or those it has: only the normal form is kept."""
        self.config = config = config or self.config
        self.history = AlarmHistory(config.period_ns)
        self._rows = RowMaker(config)
        self._rows.set_normal_form(self._form)
        self._transitions = Transitions(self._basis())
        timeouts = {name: config.timeout_ns(name) for name in CHANNELS if name in config.channels}
        self._door = Door(timeouts, config.period_ns)
        self.clearances = Clearances(self._rows.config)
        self._sequence = 0
        text = '' if self._form is None else self._form.to_yaml()
        self._door.note('start', text=text, config=asdict(config))

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
        return self.feed({channel: (stamps_ns, values)})

    def feed(self, samples: Mapping[str, tuple[ArrayLike, ArrayLike]]) -> Output:
        """
        Take samples of several channels before any row is made of them.

        A clock that leaps ahead lets the others pass until it is seen to be back: what has come
        of all channels belongs in one call.

        Parameters
        ----------
        samples : mapping of str to (stamps_ns, values)
            By channel, each as for `update`.

        Raises
        ------
        HuntError
            As `update`; what stands before in the mapping has been taken.
        """
        self._door.take(samples)
        return self._advance()

    def tick(self, now_ns: int) -> Output:
        """
        Take the present time; call it a few times a second.

        A channel silent for longer than its timeout is not waited for any more. The clocks
        of the channels may be away from this one by up to `CLOCK_OFFSET_NS`: what
        stays of the difference is an offset, and is added to the stamps where it is more
        than a delay can be.

        Parameters
        ----------
        now_ns : int
            ns.
        """
        output = self._advance()
        if self._door.tick(int(now_ns)):
            self._rows.start_again()
        return Output.joined([output, self._advance()])

    def finish(self) -> Output:
        """End of the record: nothing more will come; work up to the last stamp."""
        self._door.note('finished')
        self._door.finish()
        return self._advance()

    def set_normal_form(self, form: IdentifiedNormalForm | None) -> Output:
        """
        Use another normal form (None: none) from the next row on.

        Once there are rows this is an event, 'normal_form_changed', or
        'normal_form_reverted' where a person went back to an earlier form.
        """
        self._form = form
        self._rows.set_normal_form(form)
        self._door.note('normal_form', text='' if form is None else form.to_yaml())
        self._transitions.basis = self._basis()
        self.clearances.begin_anew(self._rows.config)
        return self._say(*form_event(form), 'normal_form') if self._sequence else self._advance()

    def _basis(self) -> Basis:
        """Return what the words compare the numbers with."""
        return Basis(self._rows.config, *self._rows.boundaries, self._form)

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
        self.clearances.margin_in = config.margin_in
        self._door.note('settings', config=asdict(config))
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
        self.history.acknowledge(now_ns, by)
        self._door.note('acknowledged', now_ns=now_ns, text=by)
        ends = ': the alarm ends with the hunting' if self._rows.alarm else ''
        return self._say('acknowledged', f'by {by or UNKNOWN}{ends}', 'operator', now_ns)

    def _say(self, word: str, cause: str, test: str, now_ns: int = 0) -> Output:
        """Return an event of now, before what comes after it; without a row its stamp is `now`."""
        row = self._transitions.row if self._sequence else no_row(now_ns)
        event = self._transitions.event_of(row, word, test, cause)
        output = self._advance()
        return replace(output, events=(event, *output.events))

    def hold_at(self, entry: JournalEntry | None) -> Output:
        """For a replay: no row beyond the position of a journal entry; None: all of them."""
        self._door.hold_at(entry)
        return self._advance()

    def repeat(self, entry: JournalEntry) -> Output:
        """For a replay: do what an entry says."""
        if self._door.repeat(entry):
            self._rows.start_again()
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
        return tuple(self._door.channels)

    @property
    def silent(self) -> frozenset[str]:
        """The channels that are not waited for."""
        return self._door.silent

    @property
    def status(self) -> DetectorStatus:
        """The present view."""
        return self._transitions.status(self._door, self._rows.alarm, self.history, self._sequence)

    def _advance(self) -> Output:
        """Make every row that is complete."""
        outputs: list[Output] = []
        for stretch in self._door.complete():
            if stretch is None:
                self._rows.start_again()
            else:
                outputs.append(self._make_rows(*stretch))
        output, journal = Output.joined(outputs), self._door.take_journal()
        return replace(output, journal=journal) if journal else output

    def _make_rows(self, rows_ns: NDArray[np.int64], blocks: dict[str, Block]) -> Output:
        """Work on a stretch of samples."""
        rows, motion = self._rows.make(rows_ns, blocks)
        events = self._transitions.update(rows)
        self.clearances.update(rows)
        self.history.update(rows, events)
        self._sequence += rows.size
        return Output(rows, tuple(events), motion=motion)
