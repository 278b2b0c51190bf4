"""
From merged samples to estimates: health of the channels, tracker, second opinion.

What the numbers mean for the rig is decided elsewhere (`rows`, `decisions`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import doubts, health
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.door import Block
from hunt_ros.detection.health import ChannelHealth
from hunt_ros.detection.judged import Agreement, Turning
from hunt_ros.detection.output import MOTION_DTYPE, TRACKER_FIELDS, blank_rows
from hunt_ros.detection.second_opinion import SecondOpinion
from hunt_ros.detection.slow import SlowChannel, SpeedCheck
from hunt_ros.dynamics.mode_shape import ModeShape
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.estimation.kalman import HuntingTracker
from hunt_ros.estimation.line_search import LineSearch
from hunt_ros.estimation.tracker_config import Shaft, TrackerConfig
from hunt_ros.estimation.turning import ASSUMED_ABOVE, SPEED_STD, TurningAngle, Unwrapping
from hunt_ros.samples import CHANNELS, NANOSECONDS
from hunt_ros.sensors import DISPLACEMENTS, MOTION, SENSORS

#: Scale of the yaw sensor against that of the lateral one, then and now: what a mode shape
#: from recordings or from theory cannot know of the sensors at hand.
SCALE_STD = 0.03
#: A wheel turns by its diameter and its creep, whatever is known of the roller.
CREEP_STD = 0.005
#: A roller that stood shows one value for so long after it has set off, and its fault is held, ns.
_SETS_OFF_NS = round((health.STUCK_S + health.FAULT_HOLD_S) * NANOSECONDS)
_NEVER = -(2**62)


class Estimator:
    """
    Turns stretches of samples into estimates at the rows asked for.

    Parameters
    ----------
    config : DetectorConfig
        Settings, with a hunting frequency (`configuration.with_frequency`).
    """

    def __init__(self, config: DetectorConfig) -> None:
        self._shape: ModeShape | None = None
        #: Of each channel what is wrong in the last row, and what was before a new beginning;
        #: the rows in which that is told on.
        self._wrong: dict[str, int] = {}
        self._before: dict[str, int] = {}
        self._told_on = 0
        self._begin(config)

    def _begin(self, config: DetectorConfig) -> None:
        """Make all that remembers anything but the mode shape."""
        self.config = config
        self._channels = tuple(name for name in CHANNELS if name in config.channels)
        self._health = {name: ChannelHealth(config, name) for name in self._channels}
        self._motion = tuple(name for name in MOTION if name in self._channels)
        self._slow: dict[str, SlowChannel] = {
            name: SlowChannel(config.timeout_ns(name), rising=name == 'roller')
            for name in ('roller', 'speed')
            if name in self._channels
        }
        self._speed_check = SpeedCheck(config) if len(self._slow) == 2 else None
        self._unwrapping = Unwrapping()
        self._angle = TurningAngle(roller_diameter(config))
        self._turning = Turning(config)
        self._still_ns = _NEVER  # when the roller was at rest last
        self._agreement = Agreement(config, line_orders(config))
        self._follow(config)

    def _follow(self, config: DetectorConfig) -> None:
        """Make what depends on where the hunting frequency is."""
        self._tracker = HuntingTracker(tracker_config(config))
        orders = line_orders(config)
        self._opinions = {
            name: SecondOpinion(config, orders) for name in self._motion if name in DISPLACEMENTS
        }
        rate = 1e9 / config.period_ns
        low, high = config.followed_hz
        high = min(high, 0.3 * rate)
        low = min(low, 0.5 * high)
        self._lines = {name: LineSearch(rate, low, high, orders) for name in self._opinions}
        shape, self._shape = self._shape, None
        self.set_mode_shape(shape)

    @property
    def looks_for(self) -> int:
        """Rows after which motion outside the range is known, if there is any."""
        return max(lines.looks_for for lines in self._lines.values())

    def configure(self, config: DetectorConfig) -> None:
        """Use other settings from the next sample on; the channels are watched on."""
        moved = tracker_config(config) != tracker_config(self.config)
        self.config = config
        if moved:
            self._follow(config)
        for watch in self._health.values():
            watch.follow(config)

    def reset(self) -> None:
        """Forget every sample, but for the mode shape, and what is wrong till that is over."""
        self._before = dict(self._wrong)
        self._told_on = round(health.FAULT_HOLD_S * NANOSECONDS / self.config.period_ns)
        self._begin(self.config)

    def set_mode_shape(self, shape: ModeShape | None) -> None:
        """Give the tracker another mode shape; what it has learnt by itself it keeps."""
        if shape is self._shape:
            return
        self._shape = shape
        self._tracker.set_modes(shape, SCALE_STD)

    def run(
        self, rows_ns: NDArray[np.int64], blocks: dict[str, Block]
    ) -> tuple[NDArray[np.void], NDArray[np.bool_], NDArray[np.void]]:
        """
        Take samples, and estimate.

        Parameters
        ----------
        rows_ns : ndarray of int64, shape (m,)
            Stamps at which estimates are wanted.
        blocks : dict of str to Block
            All samples since the last call, by channel.

        Returns
        -------
        rows : ndarray of ESTIMATE_DTYPE, shape (m,)
            Without what the decisions say.
        disagree : ndarray of bool, shape (m,)
            True where filter and Hilbert envelope differ on the amplitude.
        motion : ndarray of MOTION_DTYPE, shape (n,)
            The usable samples of the motion.
        """
        rows = blank_rows(rows_ns)
        usable = {}
        for name, block in blocks.items():
            rows[f'{name}_wrong'], usable[name], sizes = self._health[name].update(block, rows_ns)
            if name in DISPLACEMENTS:
                for what, size in zip(('step', 'measured', 'swing'), sizes, strict=True):
                    rows[f'{name}_{what}'] = size
        stamp, sensor, value = self._in_order(blocks, usable)
        slow = self._slow_at(np.concatenate([stamp, rows_ns]), blocks, usable)
        count = stamp.size
        angle, speed = slow['angle'][:count], slow['speed'][:count]
        line = np.where(lines_known(self.config, speed), angle, math.nan)
        track = self._tracker.update(stamp, sensor, value, line, speed, rows_ns)
        for name in TRACKER_FIELDS:
            rows[name] = track[name]
        rows['speed'] = slow['speed'][count:]
        if 'roller' in self._channels:
            # A roller at rest is not stuck, nor one that has just set off: what it showed at rest
            # is told on for a while. Where a speed channel is silent, it may be.
            still = rows['speed'] <= health.STANDSTILL_MPS
            still |= np.isnan(rows['speed']) & ('speed' not in self._channels)
            still_ns = np.maximum.accumulate(np.where(still, rows_ns, self._still_ns))
            self._still_ns = int(still_ns[-1])
            still = rows_ns - still_ns <= _SETS_OFF_NS
            rows['roller_wrong'][still] &= ~np.uint32(health.STUCK)
        if self._speed_check is not None:
            contrary = self._speed_check.update(rows_ns, slow['roller'][count:], rows['speed'])
            rows['speed_wrong'][contrary] |= np.uint32(health.CONTRADICTED)
        own = np.flatnonzero(sensor == self._motion.index(next(iter(self._opinions))))
        motion = np.empty(own.size, dtype=MOTION_DTYPE)
        motion['stamps_ns'], motion['values'] = stamp[own], value[own]
        motion['speed'], motion['roller_angle'] = speed[own], slow['roller'][:count][own]
        motion['quiet'] = True
        turning, changed = self._turning.update(rows_ns, slow['angle'][count:])
        self._agreement.update(rows, track, turning, changed)
        if self.config.measures('lateral'):
            rows['doubts'][track['lateral_tied'] == 1.0] |= np.uint32(doubts.FROM_YAW)
        rows['followed_min_hz'], rows['followed_max_hz'] = self.config.followed_hz
        known = lines_known(self.config, rows['speed'])
        lines = np.where(known, slow['angle'][count:], math.nan)
        disagree = np.zeros(rows.size, dtype=np.bool_)
        for name, opinion in self._opinions.items():
            own = sensor == self._motion.index(name)
            both = track[f'{name}_roughness'] + track[f'{name}_roughness_second']
            said = (
                track[f'{name}_amplitude'],
                track[f'{name}_amplitude_std'],
                track['frequency_hz'],
                np.where(changed, np.fmax(both, 0.0), 0.0),
            )
            rows[f'{name}_envelope'], differs, gone = opinion.update(
                rows_ns, stamp[own], value[own], lines, turning, said
            )
            disagree |= differs
            rows[f'{name}_wrong'][gone] |= np.uint32(health.LOST)
            self._look_elsewhere(name, track, turning, rows)
        self._tell_on(rows)
        return rows, disagree, motion

    def _tell_on(self, rows: NDArray[np.void]) -> None:
        """Go on with what was wrong before a new beginning: a clock that is set ends no fault."""
        for name in self._channels:
            wrong = rows[f'{name}_wrong']
            wrong[: self._told_on] |= np.uint32(self._before.get(name, 0))
            self._wrong[name] = int(wrong[-1]) & (health.FAULTS | health.MISSING)
        self._told_on = max(self._told_on - rows.size, 0)

    def _in_order(
        self, blocks: dict[str, Block], usable: dict[str, NDArray[np.bool_]]
    ) -> tuple[NDArray[np.int64], NDArray[np.int8], NDArray[np.float64]]:
        """Return stamps, sensors (places in `_motion`) and values that are usable, by stamp."""
        good = [usable[name] for name in self._motion]
        parts = [blocks[name] for name in self._motion]
        stamp = np.concatenate([part.stamps_ns[x] for part, x in zip(parts, good, strict=True)])
        value = np.concatenate([part.values[x] for part, x in zip(parts, good, strict=True)])
        sensor = np.arange(len(good), dtype=np.int8).repeat([np.count_nonzero(x) for x in good])
        order = np.argsort(stamp, kind='stable')
        return stamp[order], sensor[order], value[order]

    def _slow_at(
        self,
        wanted: NDArray[np.int64],
        blocks: dict[str, Block],
        usable: dict[str, NDArray[np.bool_]],
    ) -> dict[str, NDArray[np.float64]]:
        """
        Return encoder, speed without its sign, and the angle that follows from both.

        The stamps are in any order. What comes of the encoder is made continuous here.
        """
        sorting = np.argsort(wanted, kind='stable')
        at = wanted[sorting]
        constant = self.config.constant_speed_mps or math.nan  # where there is no speed channel
        slow = {'roller': np.full(at.size, math.nan), 'speed': np.full(at.size, constant)}
        for name, channel in self._slow.items():
            stamps, following = blocks[name].stamps_ns, blocks[name].following
            readings = np.where(usable[name], blocks[name].values, math.nan)
            if name == 'roller':
                readings, after = self._unwrapping.update(stamps, readings, *(following or ()))
                following = following and (following[0], after)
            slow[name] = channel.at(at, stamps, readings, following)
        slow['speed'] = np.abs(slow['speed'])  # a wheelset hunts in reverse as it does ahead
        within = self._slow['roller'].within if 'roller' in blocks else None
        slow['angle'] = self._angle.update(at, slow['roller'], slow['speed'], within)
        place = np.argsort(sorting)
        return {name: values[place] for name, values in slow.items()}

    def _look_elsewhere(
        self,
        name: str,
        track: NDArray[np.void],
        turning: NDArray[np.float64],
        rows: NDArray[np.void],
    ) -> None:
        """Say what moves slower or faster than what the filter follows."""
        signal = track[f'{name}_clean'] + track[f'{name}_bias']
        frequency, amplitude = self._lines[name].update(
            signal, turning, track[f'{name}_amplitude']
        )
        there = np.isfinite(frequency)
        slower = frequency < self.config.hunting_frequency_hz
        rows['doubts'][there & slower] |= np.uint32(doubts.TOO_SLOW)
        rows['doubts'][there & ~slower] |= np.uint32(doubts.TOO_FAST)
        first = np.isnan(rows['outside_hz'])
        rows['outside_hz'] = np.where(first, frequency, rows['outside_hz'])
        rows[f'outside_{name}'] = amplitude


def tracker_config(config: DetectorConfig) -> TrackerConfig:
    """Return the part of the settings that is the tracker's, its times those of the rig."""
    return TrackerConfig(
        config.hunting_frequency_hz,
        *config.followed_hz,
        shafts(config),
        tuple(sensor for sensor in SENSORS if sensor.name in config.channels),
    )


def roller_diameter(config: DetectorConfig) -> float:
    """Return the diameter of the roller, m; that of the built-in rig where none is given."""
    return config.roller_diameter_m or RigParameters.roller_diameter_m


def shafts(config: DetectorConfig) -> tuple[Shaft, ...]:
    """Return what turns with the roller's angle, and how well each angle is known by it."""
    known = 'roller' in config.channels
    orders = tuple(order for order in config.lines if order > 0.0)
    found = (Shaft(orders, 0.0 if known else SPEED_STD),)
    if config.wheel_diameter_m == 0.0:
        return found
    order = config.roller_diameter_m / config.wheel_diameter_m
    return (*found, Shaft((order,), CREEP_STD if known else SPEED_STD))


def line_orders(config: DetectorConfig) -> list[float]:
    """Return the orders of all lines, in turns of the roller."""
    return [order for shaft in shafts(config) for order in shaft.orders]


def lines_known(config: DetectorConfig, speed: NDArray[np.float64]) -> NDArray[np.bool_]:
    """
    Return at which speeds, m/s, the lines are known well enough to be taken out.

    They are where encoder or diameter are given; else above `ASSUMED_ABOVE`.
    """
    if 'roller' in config.channels or config.roller_diameter_m > 0.0:
        return np.ones(speed.size, dtype=np.bool_)
    lowest = min((order for order in config.lines if order > 0.0), default=math.inf)
    line = lowest * speed / (math.pi * roller_diameter(config))
    above: NDArray[np.bool_] = line > ASSUMED_ABOVE * config.hunting_frequency_hz
    return above
