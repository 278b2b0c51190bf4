"""
The hunting detector: samples in, estimates, events and status out.

It merges the channels (`merge`), watches them (`health`), tracks the hunting
motion (`hunt_ros.estimation`), decides row by row (`decisions`) and tells what
changed. It has no clock, no logger and no file.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.detection import decisions, health
from hunt_ros.detection.basin import EdgeTable, form_numbers
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.grid import RowGrid, SlowChannel
from hunt_ros.detection.health import ChannelHealth
from hunt_ros.detection.journal import JournalEntry
from hunt_ros.detection.merge import ChannelMerger, MergedBlock
from hunt_ros.detection.output import (
    EMPTY,
    ESTIMATE_DTYPE,
    NUMBERS,
    TRACKER_FIELDS,
    DetectorStatus,
    Event,
    Output,
)
from hunt_ros.detection.reasons import reasons_of
from hunt_ros.detection.regions import Level, Region, State
from hunt_ros.detection.transitions import Transitions
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.errors import HuntError
from hunt_ros.estimation.kalman import HuntingTracker, TrackerConfig
from hunt_ros.samples import CHANNELS, NANOSECONDS, Record

__all__ = ['DetectorConfig', 'DetectorStatus', 'Event', 'HuntingDetector', 'Output']

#: Longest stretch worked on at once: bounds the memory an hour of samples takes.
_CHUNK_NS = 60 * NANOSECONDS
#: The noise at the edge of the basin is looked up once in this time.
_EDGE_NS = NANOSECONDS
#: A saturated sensor still shows that there is motion; the others show nothing.
_BLIND = health.SEVERE & ~health.SATURATED


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
        self.config = config or DetectorConfig()
        self._channels = tuple(name for name in CHANNELS if name in self.config.channels)
        self._form = normal_form
        self._alarm_outlives: NDArray[np.float64] | None = None
        self._start()

    def _start(self) -> None:
        """Make everything anew, but for the normal form."""
        c = self.config
        timeouts = {name: c.timeout_ns(name) for name in self._channels}
        drain = max(timeouts.values()) + 2 * c.period_ns
        self._merger = ChannelMerger(
            timeouts, round(c.stamp_jump_s * 1e9), round(c.clock_reset_s * 1e9), drain
        )
        self._grid = RowGrid(c.period_ns, drain)
        ranges = {'lateral': c.lateral_range_m, 'yaw': c.yaw_range_rad}
        self._health = {
            name: ChannelHealth(
                name,
                timeouts[name],
                round(c.fault_hold_s * 1e9),
                round(c.stuck_time_s * 1e9),
                ranges.get(name, 0.0),
                c.hunting_frequency_hz,
                c.standstill_mps,
            )
            for name in self._channels
        }
        self._slow = {
            name: SlowChannel(timeouts[name], rising=name == 'roller')
            for name in ('roller', 'speed')
            if name in self._channels
        }
        self._tracker = HuntingTracker(tracker_config(c))
        self._memory = decisions.fresh_memory()
        self._transitions = Transitions(self._channels)
        self._edge_second = -1
        self._last_row: np.void | None = None
        self._sequence = 0
        self._limit_ns: int | None = None
        self._journal: list[JournalEntry] = []
        self._take_form()

    def _take_form(self) -> None:
        v_n = self.config.nonlinear_critical_speed_mps or math.nan
        v_c = self.config.critical_speed_mps or math.nan
        form = None if self._form is None else self._form.form
        if form is not None:
            v_c = form.critical_speed
            fold = form.nonlinear_critical_speed
            # A subcritical form without a fold has an unstable branch at any speed below v_c.
            nowhere = math.nan if form.criticality == 'supercritical' else 0.0
            v_n = nowhere if fold is None else fold
        self._numbers = form_numbers(self._form)
        self._edges = EdgeTable(form)
        self._rules = decisions.rules_of(self.config, v_n, v_c)
        self._memory[decisions.M_NOISE] = math.nan
        self._memory[decisions.M_NOISE_ROWS] = 0.0
        self._edge_second = -1

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
        if channel not in self._health:
            raise HuntError(f'channel {channel!r} is not one of {self._channels}')
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64))
        numbers = np.atleast_1d(np.asarray(values, dtype=np.float64))
        if stamps.shape != numbers.shape or stamps.ndim != 1:
            raise HuntError(
                f'{channel}: {stamps.shape} stamps and {numbers.shape} values,'
                ' expected one value a stamp'
            )
        if not stamps.size:
            return EMPTY
        late, resumed = self._merger.push(channel, stamps, numbers)
        if resumed:
            newest = self._merger.intakes[channel].last_ns
            self._note('resumed', channels={channel: newest})
        for stamp in late:
            self._note('late', channels={channel: stamp})
        return self._advance()

    def tick(self, now_ns: int) -> Output:
        """
        Tell the time, on the clock of the stamps; call it a few times a second.

        A channel silent for longer than its timeout is not waited for any more.

        Parameters
        ----------
        now_ns : int
            ns.
        """
        output = self._advance()
        overdue = self._merger.overdue(now_ns)
        if overdue:
            self._note('released', now_ns, overdue)
            self._merger.silent |= set(overdue)
        if self._merger.clocks_moved(now_ns):
            self._note('clock', now_ns)
            self._next_epoch()
        if not overdue and not self._journal:
            return output
        return Output.joined([output, self._advance()])

    def finish(self) -> Output:
        """End of the record: nothing more will come; work up to the last stamp."""
        self._note('finished')
        self._merger.finish()
        return self._advance()

    def set_normal_form(self, form: IdentifiedNormalForm | None) -> Output:
        """Use another normal form (None: none) from the next row on."""
        self._form = form
        self._take_form()
        self._note('normal_form', text='' if form is None else form.to_yaml())
        return self._advance()

    def acknowledge(self, now_ns: int = 0) -> Output:
        """
        Acknowledge the alarm; while the wheelset still hunts it stays until that is over.

        Parameters
        ----------
        now_ns : int
            For the journal.
        """
        memory = self._memory
        if memory[decisions.M_ALARM] > 0.0:
            memory[decisions.M_ACKNOWLEDGED] = 1.0
            if int(memory[decisions.M_STATE]) not in (State.ESCAPING, State.LIMIT_CYCLE):
                memory[decisions.M_ALARM] = memory[decisions.M_ACKNOWLEDGED] = 0.0
        self._note('acknowledged', now_ns)
        row = self._last_row
        event = Event(
            now_ns if row is None else int(row['stamp_ns']),
            'acknowledged',
            math.nan if row is None else float(row['speed']),
            math.nan if row is None else float(row['lateral_amplitude']),
            math.nan if row is None else float(row['growth_rate']),
            Level.STALE if row is None else Level(int(row['level'])),
        )
        output = self._advance()
        return Output(output.estimates, (event, *output.events), output.journal)

    def reset(self) -> None:
        """Forget every sample, the alarm and the journal; keep config and normal form."""
        self._start()

    @property
    def status(self) -> DetectorStatus:
        """The present view."""
        dropped = {
            f'{channel} {reason}': count
            for channel, intake in self._merger.intakes.items()
            for reason, count in vars(intake.counts).items()
            if count
        }
        row = self._last_row
        alarm = bool(self._memory[decisions.M_ALARM] > 0.0)
        if row is None:
            return DetectorStatus(alarm=alarm, dropped=dropped)
        refused = tuple(
            f'{channel}: {intake.refused_since} samples refused for their stamps'
            for channel, intake in self._merger.intakes.items()
            if intake.refused_since
        )
        until = self._merger.watermark_ns
        return DetectorStatus(
            stamp_ns=int(row['stamp_ns']),
            level=Level(int(row['level'])),
            region=Region(int(row['region'])),
            state=State(int(row['state'])),
            reasons=(*reasons_of(row), *refused),
            alarm=alarm,
            sequence=self._sequence,
            inputs_until_ns=int(row['stamp_ns']) if until is None else until,
            numbers={name: float(row[name]) for name in NUMBERS},
            dropped=dropped,
        )

    def _note(
        self,
        kind: str,
        now_ns: int = 0,
        channels: dict[str, int | None] | None = None,
        text: str = '',
    ) -> None:
        position = self._merger.position_ns
        self._journal.append(
            JournalEntry(kind, position, self._merger.epoch, now_ns, channels or {}, text)
        )

    def _advance(self) -> Output:
        """Make every row that is complete."""
        merger = self._merger
        outputs: list[Output] = []
        while True:
            until = merger.watermark_ns
            if until is not None and self._limit_ns is not None:
                until = min(until, self._limit_ns)
            position = merger.position_ns
            if until is not None:
                last = self._grid.last_row_ns(until)
                if position is None or last > position:
                    waiting = merger.first_ns
                    begin = last if waiting is None else waiting
                    begin = begin if position is None else max(begin, position)
                    last = min(last, self._grid.last_row_ns(begin + _CHUNK_NS))
                    if position is None or last > position:
                        outputs.append(self._make_rows(position, last))
                        continue
            if merger.epoch_over and merger.more_epochs and self._limit_ns is None:
                self._next_epoch()
                continue
            break
        journal, self._journal = tuple(self._journal), []
        output = Output.joined(outputs)
        return replace(output, journal=journal) if journal else output

    def _next_epoch(self) -> None:
        """Begin anew after the clocks were set back; form and latched alarm are kept."""
        self._merger.next_epoch()
        self._grid.reset()
        self._tracker.reset()
        for slow in self._slow.values():
            slow.reset()
        for watch in self._health.values():
            watch.reset()
        memory = self._memory
        self._memory = decisions.fresh_memory()
        for kept in (decisions.M_ALARM, decisions.M_FLOOR2, decisions.M_FLOOR_ROWS):
            self._memory[kept] = memory[kept]
        self._edge_second = -1

    def _make_rows(self, after_ns: int | None, until_ns: int) -> Output:
        """Work on the samples in (after_ns, until_ns]."""
        blocks = self._merger.take(until_ns)
        stamps = np.sort(np.concatenate([block.stamps_ns for block in blocks.values()]))
        rows_ns = self._grid.rows(after_ns, until_ns, stamps)
        usable, rows = {}, np.zeros(rows_ns.size, dtype=ESTIMATE_DTYPE)
        rows['stamp_ns'] = rows_ns
        for name, block in blocks.items():
            rows[f'{name}_wrong'], usable[name] = self._health[name].update(block, rows_ns)
        self._estimate(rows, blocks, usable)
        if not rows_ns.size:
            return EMPTY
        trusted = self._standing_still(rows)
        self._decide(rows, trusted)
        self._levels(rows)
        events = self._transitions.update(rows)
        self._sequence += rows.size
        self._last_row = rows[-1]
        return Output(rows, tuple(events))

    def _estimate(
        self,
        rows: NDArray[np.void],
        blocks: dict[str, MergedBlock],
        usable: dict[str, NDArray[np.bool_]],
    ) -> None:
        """Run the tracker over the motion samples, sorted by stamp."""
        stamps, sensors, values = [], [], []
        for number, name in enumerate(('lateral', 'yaw')):
            if name in blocks:
                good = usable[name]
                stamps.append(blocks[name].stamps_ns[good])
                values.append(blocks[name].values[good])
                sensors.append(np.full(stamps[-1].size, number, dtype=np.int8))
        stamp, value = np.concatenate(stamps), np.concatenate(values)
        sensor = np.concatenate(sensors)
        order = np.argsort(stamp, kind='stable')
        stamp, value, sensor = stamp[order], value[order], sensor[order]
        wanted = np.concatenate([stamp, rows['stamp_ns']])
        sorting = np.argsort(wanted, kind='stable')
        slow = {}
        for name in ('roller', 'speed'):
            found = np.full(wanted.size, math.nan)
            if name in blocks:
                block = blocks[name]
                readings = np.where(usable[name], block.values, math.nan)
                found[sorting] = self._slow[name].at(
                    wanted[sorting], block.stamps_ns, readings, block.following
                )
            elif name == 'speed' and self.config.constant_speed_mps > 0.0:
                found[:] = self.config.constant_speed_mps
            slow[name] = found
        if not self.config.roughness:
            slow['roller'][:] = math.nan
        count = stamp.size
        track = self._tracker.update(
            stamp,
            sensor,
            value,
            slow['roller'][:count],
            slow['speed'][:count],
            rows['stamp_ns'],
        )
        for name in TRACKER_FIELDS:
            rows[name] = track[name]
        rows['speed'] = slow['speed'][count:]

    def _standing_still(self, rows: NDArray[np.void]) -> NDArray[np.bool_]:
        """
        Clear the roller's stuck bit where the rig stands still.

        Returns
        -------
        ndarray of bool, shape (m,)
            Rows at which at least one motion sensor is to be trusted.
        """
        if 'roller' in self._channels:
            still = ~(rows['speed'] > self.config.standstill_mps)
            rows['roller_wrong'][still] &= ~np.uint32(health.STUCK)
        trusted = np.zeros(rows.size, dtype=np.bool_)
        for name in ('lateral', 'yaw'):
            if name in self._channels:
                trusted |= (rows[f'{name}_wrong'] & _BLIND) == 0
        return trusted

    def _decide(self, rows: NDArray[np.void], trusted: NDArray[np.bool_]) -> None:
        """Run the decisions, stretch by stretch of one edge of the basin."""
        main = 'lateral' if 'lateral' in self._channels else 'yaw'
        if main == 'yaw' and np.isfinite(rows['lateral_amplitude']).any():
            main = 'lateral'
        amplitude = np.where(trusted, rows[f'{main}_amplitude'], math.nan)
        spread = rows[f'{main}_amplitude_std']
        disagree = np.zeros(rows.size, dtype=np.bool_)
        numbers = np.empty((rows.size, decisions.N_OUTPUT))
        seconds = rows['stamp_ns'] // _EDGE_NS
        starts = np.flatnonzero(np.diff(seconds, prepend=self._edge_second))
        bounds = [0, *starts[starts > 0].tolist(), rows.size]
        for begin, end in itertools.pairwise(bounds):
            if seconds[begin] != self._edge_second:
                self._edge_second = int(seconds[begin])
                self._look_up_edge(float(rows['speed'][begin]))
            part = slice(begin, end)
            decisions.decide(
                self._rules,
                self._numbers,
                self._memory,
                np.ascontiguousarray(amplitude[part]),
                np.ascontiguousarray(spread[part]),
                np.ascontiguousarray(rows['growth_rate'][part]),
                np.ascontiguousarray(rows['growth_rate_std'][part]),
                np.ascontiguousarray(rows['speed'][part]),
                np.ascontiguousarray(rows['lateral_roughness'][part]),
                disagree[part],
                numbers[part],
                *self._words(part, rows.size),
            )
        for column, name in enumerate(_COLUMNS):
            rows[name] = numbers[:, column]
        rows['region'], rows['state'] = self._regions, self._states
        rows['doubts'], rows['alarm'] = self._doubts, self._alarms

    def _words(self, part: slice, size: int) -> tuple[NDArray[np.generic], ...]:
        """Return the stretch of the arrays that the kernel fills with words."""
        if part.start == 0:
            self._regions = np.zeros(size, dtype=np.int8)
            self._states = np.zeros(size, dtype=np.int8)
            self._doubts = np.zeros(size, dtype=np.uint32)
            self._alarms = np.zeros(size, dtype=np.bool_)
        return (
            self._regions[part],
            self._states[part],
            self._doubts[part],
            self._alarms[part],
        )

    def _look_up_edge(self, speed: float) -> None:
        edge = self._edges.at(speed, float(self._memory[decisions.M_NOISE]))
        self._memory[decisions.M_EDGE_CENTRE] = edge.centre
        self._memory[decisions.M_EDGE_WIDTH] = edge.width
        self._memory[decisions.M_EDGE_RATE] = edge.rate

    def _levels(self, rows: NDArray[np.void]) -> None:
        """Fill in the level: the worst of what the decisions and the channels say."""
        wrong = np.zeros(rows.size, dtype=np.uint32)
        for name in self._channels:
            wrong |= rows[f'{name}_wrong']
        level = np.where((rows['doubts'] != 0) | (wrong != 0), Level.WARN, Level.OK)
        hunting = (rows['state'] == State.ESCAPING) | (rows['state'] == State.LIMIT_CYCLE)
        level[hunting] = Level.ERROR
        level[(wrong & health.SEVERE) != 0] = Level.STALE
        rows['level'] = level


_COLUMNS = (
    'noise_floor',
    'noise_intensity',
    'unstable_amplitude',
    'unstable_amplitude_std',
    'stable_amplitude',
    'margin',
    'margin_low',
    'margin_high',
    'escape_probability',
    'outlook',
    'time_to_limit_cycle',
)


def tracker_config(config: DetectorConfig) -> TrackerConfig:
    """Return the part of the settings that is the tracker's."""
    return TrackerConfig(
        frequency_hz=config.hunting_frequency_hz,
        frequency_min_hz=config.hunting_frequency_min_hz,
        frequency_max_hz=config.hunting_frequency_max_hz,
    )


def detect(detector: HuntingDetector, record: Record) -> Output:
    """
    Run a whole recording through a detector.

    Parameters
    ----------
    detector : HuntingDetector
        Fresh, or gone on with.
    record : Record
        Channels the detector has not been told of are left out.

    Returns
    -------
    Output
        Everything, in order.
    """
    outputs = [
        detector.update(name, series.stamps_ns, series.values)
        for name, series in record.items()
        if name in detector.config.channels
    ]
    return Output.joined([*outputs, detector.finish()])
