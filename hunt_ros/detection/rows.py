"""
From merged samples to rows: estimates, decisions, level.

What is done to a stretch of samples once it is complete; the door before it and
the events after it are elsewhere.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import doubts, health
from hunt_ros.detection.configuration import DetectorConfig, with_frequency
from hunt_ros.detection.decision import decisions, states
from hunt_ros.detection.decision.form import fill_branches, form_numbers
from hunt_ros.detection.decision.limits import ALARMS
from hunt_ros.detection.decision.outlook import OutlookTable
from hunt_ros.detection.decision.rules import rules_of
from hunt_ros.detection.door import Block
from hunt_ros.detection.estimates import Estimator
from hunt_ros.detection.regions import Level, State
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.samples import CHANNELS, NANOSECONDS
from hunt_ros.sensors import COORDINATES, sensors_of

#: The outlook is looked up once in this time, and when the speed has moved by a cell.
_OUTLOOK_NS = NANOSECONDS
#: Where the speed is not known: one more speed, m/s, at which there is no outlook.
_NO_SPEED = -1e9
_NO_LOOK = (-1, math.nan)


class RowMaker:
    """
    Makes the rows of complete stretches of samples.

    Parameters
    ----------
    config : DetectorConfig
        Settings.

    Attributes
    ----------
    memory : ndarray of decisions.MEMORY, shape (1,)
        What the decisions remember.
    """

    def __init__(self, config: DetectorConfig) -> None:
        self._asked = config
        self.config = with_frequency(config)
        self.memory = decisions.fresh_memory()
        self._channels = tuple(name for name in CHANNELS if name in config.channels)
        #: Of each coordinate that is measured the sensors.
        self._sensors = {
            coordinate: set(sensors_of(coordinate)) & set(self._channels)
            for coordinate in COORDINATES
            if config.measures(coordinate)
        }
        self._estimator = Estimator(self.config)
        #: The coordinate that is judged, and for how many rows lateral has been missing.
        self._judging, self._missing = '', 0
        self._patience = round(1e9 / config.period_ns) if config.measures('lateral') else 0
        self._looked_up = _NO_LOOK
        self._unseen = 0
        self.set_normal_form(None)

    def set_normal_form(self, identified: IdentifiedNormalForm | None) -> None:
        """Use a normal form (None: v_n and v_c of the settings, or nothing) from now on."""
        self._identified = identified
        form = None if identified is None else identified.form
        self._follow(None if form is None else form.frequency_hz)
        self._estimator.set_mode_shape(None if identified is None else identified.mode_shape)
        self._numbers = form_numbers(identified)
        self._outlooks = OutlookTable(identified)
        self._rules = rules_of(self.config, *self.boundaries)
        self._looked_up = _NO_LOOK

    def reconfigure(self, config: DetectorConfig) -> None:
        """Use other settings, but for those that are fixed, from now on."""
        self._asked = config
        self.config = with_frequency(config, None, self.config.hunting_frequency_hz)
        self._estimator.configure(self.config)
        self._rules = rules_of(self.config, *self.boundaries)

    @property
    def boundaries(self) -> tuple[float, float]:
        """The boundaries of the regions, v_n (0: unknown) and v_c, m/s; NaN: there is none."""
        identified = self._identified
        if identified is None:
            v_c = self.config.critical_speed_mps or math.nan
            return self.config.nonlinear_critical_speed_mps, v_c
        form, fold = identified.form, identified.nonlinear_critical_speed
        # A subcritical form without a fold has an unstable branch at any speed below v_c; one
        # whose fold is not known may have.
        nowhere = math.nan if form.criticality == 'supercritical' else 0.0
        return nowhere if fold is None else fold, form.critical_speed

    def _follow(self, form_hz: float | None) -> None:
        """Look for the motion where the normal form says; elsewhere than before: begin anew."""
        tuned = with_frequency(self._asked, form_hz, self.config.hunting_frequency_hz)
        if tuned == self.config:
            return
        self.config = tuned
        self._estimator.configure(tuned)
        if self.state >= State.ESCAPING:
            # The hunting may lie outside the range now: until that is known it does not end.
            self._unseen = self._estimator.looks_for
        # The noise that it has learnt is that at another frequency; the hunting is the same.
        self._forget(floor=False, reference=True)

    def start_again(self) -> None:
        """Begin anew after the clocks were set back; form, hunting and noise floor are kept."""
        self._estimator.reset()
        self._missing = 0
        self._forget(floor=True, reference=True)

    def _forget(self, *, floor: bool, reference: bool) -> None:
        self.memory = decisions.kept(self.memory, floor=floor, reference=reference)
        self._looked_up = _NO_LOOK

    @property
    def alarm(self) -> bool:
        """The latched alarm."""
        return bool(self.memory['alarm'][0])

    @property
    def state(self) -> State:
        """The state in force."""
        return State(states.word_of(self.memory['state'][0]))

    def acknowledge(self) -> None:
        """Take the alarm back: at once, or once the hunting is over and all limits are kept."""
        decisions.acknowledge(self.memory[0])

    def make(
        self, rows_ns: NDArray[np.int64], blocks: dict[str, Block]
    ) -> tuple[NDArray[np.void], NDArray[np.void]]:
        """
        Make rows.

        Parameters
        ----------
        rows_ns : ndarray of int64, shape (m,)
            Their stamps, m > 0.
        blocks : dict of str to Block
            All samples since the last call, by channel, none after the last row.

        Returns
        -------
        rows : ndarray of ESTIMATE_DTYPE, shape (m,)
        motion : ndarray of MOTION_DTYPE, shape (n,)
            The usable samples of the motion.
        """
        rows, disagree, motion = self._estimator.run(rows_ns, blocks)
        trusted = self._trusted(rows)
        trusted[: self._unseen] = False
        self._unseen = max(self._unseen - rows.size, 0)
        self._decide(rows, trusted, disagree)
        self._levels(rows)
        row = np.searchsorted(rows_ns, motion['stamps_ns'])
        motion['quiet'] = rows['state'][row] <= State.DISTURBED
        return rows, motion

    def _trusted(self, rows: NDArray[np.void]) -> NDArray[np.bool_]:
        """Fill in which coordinates no sensor shows; return which rows have one that is shown."""
        trusted = np.zeros(rows.size, dtype=np.bool_)
        for coordinate, sensors in self._sensors.items():
            wrong = [rows[f'{name}_wrong'] & health.BLIND for name in sensors]
            blind = rows[f'{coordinate}_blind'] = np.min(wrong, axis=0) != 0
            trusted |= ~blind
        return trusted

    def _decide(
        self, rows: NDArray[np.void], trusted: NDArray[np.bool_], disagree: NDArray[np.bool_]
    ) -> None:
        """Run the decisions, stretch by stretch of one channel that is judged and one outlook."""
        for begin, end, channel in self._stretches(rows):
            if channel != self._judging:
                if self._judging:  # sizes have units
                    self._forget(floor=False, reference=False)
                self._judging = channel
            stretch = rows[begin:end]
            lateral = channel == 'lateral'
            if not lateral:
                for what in ('', '_std'):
                    stretch[f'judged{what}'] = stretch[f'yaw_amplitude{what}']
            stretch['judged'][~trusted[begin:end]] = math.nan
            stretch['outside_judged'] = stretch[f'outside_{channel}']
            step = stretch[f'{channel}_step']
            stretch['step'] = np.where(np.isfinite(step), step, 0.0)
            if not lateral and ('lateral' in self._sensors or self._numbers.known):
                stretch['doubts'] |= np.uint32(doubts.IN_YAW)
            # The form speaks of metres.
            numbers = self._numbers if lateral else form_numbers(None)
            fill_branches(numbers, stretch)
            for part in self._outlook_stretches(stretch):
                given = disagree[begin:end][part], trusted[begin:end][part]
                decisions.decide(self._rules, numbers, self.memory, *given, stretch[part])

    def _stretches(self, rows: NDArray[np.void]) -> Iterator[tuple[int, int, str]]:
        """
        Yield (begin, end, channel) of stretches that are judged by lateral, or by yaw instead.

        What yaw tells of the lateral motion, through a mode shape or the ratio seen before, counts
        as lateral where there is a form to compare it with. Without, yaw itself is known better:
        it is judged once lateral has been missing for a second, until lateral is measured again.
        """
        lateral = np.isfinite(rows['lateral_amplitude'])
        lateral &= np.isfinite(rows['judged']) | ((rows['doubts'] & doubts.ON_LINE) != 0)
        if self._identified is None:
            lateral &= (rows['doubts'] & doubts.FROM_YAW) == 0
        missing = self._missing + np.cumsum(~lateral & np.isfinite(rows['yaw_amplitude']))
        missing -= np.maximum.accumulate(np.where(lateral, missing, 0))
        self._missing = int(missing[-1])
        yaw = missing > self._patience
        cuts = [0, *(np.flatnonzero(np.diff(yaw)) + 1).tolist(), rows.size]
        for begin, end in itertools.pairwise(cuts):
            yield begin, end, 'yaw' if yaw[begin] else 'lateral'

    def _outlook_stretches(self, rows: NDArray[np.void]) -> Iterator[slice]:
        """Yield stretches of one outlook, which is then in the memory of the decisions."""
        seconds = rows['stamp_ns'] // _OUTLOOK_NS
        speeds = np.where(np.isnan(rows['speed']), _NO_SPEED, rows['speed'])
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
        memory = self.memory[0]
        self.memory['outlook'] = self._outlooks.at(
            float(row['speed']),
            float(memory['floor']['intensity']),
            float(memory['floor']['spread']),
            states.CALM * math.sqrt(memory['floor']['square']),
            float(np.nan_to_num(row['lateral_roughness'])),
        )

    def _levels(self, rows: NDArray[np.void]) -> None:
        """Fill in the level: the worst of what the decisions and the channels say."""
        wrong = np.bitwise_or.reduce([rows[f'{name}_wrong'] for name in self._channels])
        told = (rows['doubts'] != 0) | ((wrong & ~np.uint32(health.ABSENT)) != 0)
        level = np.where(told | (rows['limits'] != 0), Level.WARN, Level.OK)
        hunting = (rows['state'] == State.ESCAPING) | (rows['state'] == State.LIMIT_CYCLE)
        level[hunting | ((rows['limits'] & np.uint32(ALARMS)) != 0)] = Level.ERROR
        level[(wrong & health.SEVERE) != 0] = Level.STALE
        rows['level'] = level
