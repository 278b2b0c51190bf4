"""
From merged samples to rows: estimates, decisions, level.

What is done to a stretch of samples once it is complete; the door before it and
the events after it are elsewhere.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection.channels import health
from hunt_ros.detection.channels.grid import RowGrid
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.decision import decisions, doubts, states
from hunt_ros.detection.decision.limits import ALARMS, AmplitudeLimits
from hunt_ros.detection.decision.outlook import OutlookTable, form_numbers
from hunt_ros.detection.decision.rules import rules_of
from hunt_ros.detection.estimates import Estimator
from hunt_ros.detection.frequencies import nominal_hz, with_frequencies
from hunt_ros.detection.intake import Block
from hunt_ros.detection.output import Motion
from hunt_ros.detection.regions import Level, State, acknowledge
from hunt_ros.detection.tracking import JudgedChannel
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.estimation.tracker_config import REFERENCE_HZ
from hunt_ros.samples import CHANNELS, NANOSECONDS
from hunt_ros.sensors import COORDINATES, sensors_of

#: The outlook is looked up once in this time, and when the speed has moved by a cell.
_OUTLOOK_NS = NANOSECONDS
#: Where the speed is not known: one more speed, m/s, at which there is no outlook.
_NO_SPEED = -1e9
#: What no new beginning ends: the hunting and its alarm, for nothing has been seen of its end.
_HUNTING = (
    ('state', 'hunting'),
    ('state', 'cause'),
    ('state', 'alarm'),
    ('state', 'acknowledged'),
)
#: How large the hunting is, and what is quiet: known as long as the same motion is judged.
_SIZES = (('evidence', 'reference'), ('floor', 'square'), ('floor', 'learnt'))


class RowMaker:
    """
    Makes the rows of the estimates out of complete stretches of samples.

    Parameters
    ----------
    config : DetectorConfig
        Settings.
    drain_ns : int
        Silence after which no row is made, see `RowGrid`.

    Attributes
    ----------
    memory : ndarray of decisions.MEMORY, shape (1,)
        What the decisions remember.
    """

    def __init__(self, config: DetectorConfig, drain_ns: int) -> None:
        self._asked = config
        self._nominal_hz = REFERENCE_HZ
        self.config = with_frequencies(config)
        self.memory = decisions.fresh_memory()
        self._channels = tuple(name for name in CHANNELS if name in config.channels)
        self._grid = RowGrid(config.period_ns, drain_ns)
        self._estimator = Estimator(self.config)
        self._judged = JudgedChannel(config)
        self._limits = AmplitudeLimits(self.config)
        self._judging = ''
        self._floors: dict[str, NDArray[np.void]] = {}
        self._looked_up = (-1, math.nan)
        self._form: NormalForm | None = None
        self.set_normal_form(None)

    def set_normal_form(self, identified: IdentifiedNormalForm | None) -> None:
        """Use a normal form (None: v_n and v_c of the settings, or nothing) from now on."""
        form = self._form = None if identified is None else identified.form
        self._follow(None if form is None else form.frequency_hz)
        self._estimator.set_mode_shape(None if identified is None else identified.mode_shape)
        self._numbers = form_numbers(identified)
        self._outlooks = OutlookTable(identified)
        self._judged.compared = identified is not None
        self._make_rules()
        self.memory['noise'] = decisions.fresh_memory()['noise']
        self._looked_up = (-1, math.nan)

    def reconfigure(self, config: DetectorConfig) -> None:
        """Use other settings, but for those that are fixed, from now on."""
        self._asked = config
        self.config = with_frequencies(config, self._nominal_hz)
        self._estimator.reconfigure(self.config)
        self._limits.reconfigure(self.config)
        self._make_rules()

    def _make_rules(self) -> None:
        self._rules = rules_of(self.config, *self.boundaries)

    @property
    def boundaries(self) -> tuple[float, float]:
        """The boundaries of the regions, v_n and v_c, m/s; NaN: there is none, or unknown."""
        form = self._form
        if form is None:
            config = self.config
            v_n = config.nonlinear_critical_speed_mps or math.nan
            return v_n, config.critical_speed_mps or math.nan
        fold = form.nonlinear_critical_speed
        # A subcritical form without a fold has an unstable branch at any speed below v_c.
        nowhere = math.nan if form.criticality == 'supercritical' else 0.0
        return nowhere if fold is None else fold, form.critical_speed

    def lasting(self) -> dict[str, float]:
        """Return what a pause does not end: the hunting, its alarm, and what size is quiet."""
        memory = self.memory[0]
        state, floor = memory['state'], memory['floor']
        found = {
            'hunting': state['hunting']['word'],
            'cause': state['cause'],
            'alarm': state['alarm'],
            'acknowledged': state['acknowledged'],
            'reference': memory['evidence']['reference'],
            'square': floor['square'],
            'learnt': floor['learnt'],
            'in_yaw': self._judging == 'yaw',
        }
        known = {name: float(value) for name, value in found.items() if not math.isnan(value)}
        return known | self._limits.lasting()

    def remember(self, lasting: Mapping[str, float]) -> None:
        """Go on, before the first row, with what `lasting` gave."""
        if not lasting:
            return
        self._limits.remember(lasting)
        state = self.memory['state']
        state['hunting']['word'] = state['hunting']['wanted'] = lasting['hunting']
        for part, name in (*_HUNTING[1:], *_SIZES):
            if name in lasting:
                self.memory[part][name] = lasting[name]
        if lasting['in_yaw']:
            self._judging = 'yaw'

    def _follow(self, form_hz: float | None) -> None:
        """Look for the motion where the normal form says; elsewhere than before: begin anew."""
        self._nominal_hz = nominal_hz(self._asked, form_hz, self._nominal_hz)
        tuned = with_frequencies(self._asked, self._nominal_hz)
        if tuned == self.config:
            return
        self.config = tuned
        self._estimator.retune(tuned)
        self._limits.reconfigure(tuned)
        # The noise that it has learnt is that at another frequency; the hunting is the same.
        self._forget((*_HUNTING, ('evidence', 'reference')))
        self._floors.clear()

    def start_again(self) -> None:
        """Begin anew after the clocks were set back; form, hunting and noise floor are kept."""
        self._grid.reset()
        self._estimator.reset()
        self._judged.reset()
        self._forget((*_HUNTING, *_SIZES))

    def _forget(self, lasting: tuple[tuple[str, str], ...]) -> None:
        """Forget what the decisions remember, but for what lasts."""
        memory = decisions.fresh_memory()
        for part, name in lasting:
            memory[part][name] = self.memory[part][name]
        hunting = memory['state']['hunting']
        hunting['wanted'], hunting['waited'] = hunting['word'], 0  # a hold time begins anew
        self.memory = memory
        self._looked_up = (-1, math.nan)

    @property
    def alarm(self) -> bool:
        """The latched alarm."""
        return bool(self.memory['state']['alarm'][0]) or self._limits.alarm

    @property
    def state(self) -> State:
        """The state in force."""
        return State(states.word_of(self.memory['state'][0]))

    def acknowledge(self) -> None:
        """Take the alarm back: at once, or once the hunting is over and all limits are kept."""
        self._limits.acknowledge()
        state = self.memory['state'][0]
        acknowledge(state, self.state in (State.ESCAPING, State.LIMIT_CYCLE))

    def make(
        self, after_ns: int | None, until_ns: int, blocks: dict[str, Block]
    ) -> tuple[NDArray[np.void], Motion]:
        """
        Make the rows in (after_ns, until_ns].

        Parameters
        ----------
        after_ns : int or None
            Last row made; None at the beginning.
        until_ns : int
            A grid stamp.
        blocks : dict of str to Block
            All samples in that stretch, by channel.

        Returns
        -------
        rows : ndarray of ESTIMATE_DTYPE, shape (m,)
        motion : Motion
            The usable samples of the motion in that stretch.
        """
        stamps = np.sort(np.concatenate([block.stamps_ns for block in blocks.values()]))
        rows_ns = self._grid.rows(after_ns, until_ns, stamps)
        rows, disagree, motion = self._estimator.run(rows_ns, blocks)
        if rows.size:
            trusted = self._trusted(rows)
            self._decide(rows, trusted, disagree)
            self._limits.watch(rows, trusted)
            self._levels(rows)
            motion = motion.told(rows)
        return rows, motion

    def _trusted(self, rows: NDArray[np.void]) -> NDArray[np.bool_]:
        """Fill in which coordinates no sensor shows; return which rows have one that is shown."""
        trusted = np.zeros(rows.size, dtype=np.bool_)
        for coordinate in COORDINATES:
            if self.config.measures(coordinate):
                shown = np.zeros(rows.size, dtype=np.bool_)
                for name in set(sensors_of(coordinate)) & set(self._channels):
                    shown |= (rows[f'{name}_wrong'] & health.BLIND) == 0
                rows[f'{coordinate}_blind'] = ~shown
                trusted |= shown
        return trusted

    def _decide(
        self, rows: NDArray[np.void], trusted: NDArray[np.bool_], disagree: NDArray[np.bool_]
    ) -> None:
        """Run the decisions, stretch by stretch of one channel that is judged."""
        for begin, end, channel in self._judged.stretches(rows):
            if channel != self._judging:
                if self._judging:
                    # Sizes are in the unit of the channel: what is quiet is known for each.
                    self._floors[self._judging] = self.memory['floor'].copy()
                    self._forget(_HUNTING)
                    self.memory['floor'] = self._floors.get(channel, self.memory['floor'])
                self._judging = channel
            part = slice(begin, end)
            self._decide_on(channel, rows[part], trusted[part], disagree[part])

    def _decide_on(
        self,
        channel: str,
        rows: NDArray[np.void],
        trusted: NDArray[np.bool_],
        disagree: NDArray[np.bool_],
    ) -> None:
        """Run the decisions on one channel, stretch by stretch of one outlook."""
        size = 'judged' if channel == 'lateral' else 'yaw_amplitude'
        spread_of = 'judged_std' if channel == 'lateral' else 'yaw_amplitude_std'
        amplitude = np.where(trusted, rows[size], math.nan)
        spread = np.ascontiguousarray(rows[spread_of])
        outside = np.ascontiguousarray(rows[f'outside_{channel}'])
        rows['step'] = np.nan_to_num(rows[f'{channel}_step'], posinf=0.0)
        rules, numbers = self._rules, self._numbers
        if channel == 'yaw':  # the form speaks of metres
            numbers = form_numbers(None)
            if self.config.measures('lateral') or self._numbers.known:
                rows['doubts'] |= np.uint32(doubts.IN_YAW)
        for part in self._outlook_stretches(rows):
            decisions.decide(
                rules,
                numbers,
                self.memory,
                amplitude[part],
                spread[part],
                outside[part],
                disagree[part],
                rows[part],
            )

    def _outlook_stretches(self, rows: NDArray[np.void]) -> Iterator[slice]:
        """Yield stretches of one outlook, which is then in the memory of the decisions."""
        seconds = rows['stamp_ns'] // _OUTLOOK_NS
        speeds = np.nan_to_num(rows['speed'], nan=_NO_SPEED)
        starts = np.flatnonzero(np.diff(seconds)) + 1
        for begin, end in itertools.pairwise([0, *starts.tolist(), rows.size]):
            while begin < end:
                second, speed = self._looked_up
                if seconds[begin] != second or self._outlooks.differ(speeds[begin], speed):
                    self._look_up(rows[begin])
                    self._looked_up = int(seconds[begin]), float(speeds[begin])
                moved = self._outlooks.differ(speeds[begin:end], self._looked_up[1])
                stop = begin + int(moved.argmax()) if moved.any() else end
                yield slice(begin, stop)
                begin = stop

    def _look_up(self, row: np.void) -> None:
        """Take the outlook at the speed and the noise of a row into the memory of the kernel."""
        memory, rules = self.memory[0], self._rules
        line = float(row['lateral_roughness'])
        quiet = math.sqrt(memory['floor']['square'])
        self.memory['outlook'] = self._outlooks.at(
            float(row['speed']),
            float(memory['noise']['intensity']),
            float(memory['noise']['spread']),
            rules.disturbed_out * quiet,
            0.0 if math.isnan(line) else line,
        )

    def _levels(self, rows: NDArray[np.void]) -> None:
        """Fill in the level: the worst of what the decisions and the channels say."""
        wrong = np.zeros(rows.size, dtype=np.uint32)
        for name in self._channels:
            wrong |= rows[f'{name}_wrong']
        told = (rows['doubts'] != 0) | ((wrong & ~np.uint32(health.ABSENT)) != 0)
        level = np.where(told | (rows['limits'] != 0), Level.WARN, Level.OK)
        hunting = (rows['state'] == State.ESCAPING) | (rows['state'] == State.LIMIT_CYCLE)
        level[hunting | ((rows['limits'] & np.uint32(ALARMS)) != 0)] = Level.ERROR
        level[(wrong & health.SEVERE) != 0] = Level.STALE
        rows['level'] = level
