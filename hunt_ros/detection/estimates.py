"""
From merged samples to estimates: health of the channels, tracker, second opinion.

What the numbers mean for the rig is decided elsewhere (`rows`, `decisions`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import doubts
from hunt_ros.detection.channels import health
from hunt_ros.detection.channels.grid import SlowChannel
from hunt_ros.detection.channels.health import ChannelHealth
from hunt_ros.detection.channels.speed_check import SpeedCheck
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.intake import Block
from hunt_ros.detection.output import TRACKER_FIELDS, Motion, blank_rows
from hunt_ros.detection.second_opinion import SecondOpinion
from hunt_ros.detection.tracking import (
    SCALE_STD,
    Agreement,
    line_orders,
    line_search,
    lines_known,
    mode_points,
    tracker_config,
    turning_angle,
    turning_of,
)
from hunt_ros.dynamics.mode_shape import ModeShape
from hunt_ros.estimation.kalman import HuntingTracker
from hunt_ros.estimation.line_search import LineSearch
from hunt_ros.estimation.turning import Unwrapping
from hunt_ros.samples import CHANNELS
from hunt_ros.sensors import DISPLACEMENTS, MOTION, SENSORS


class Estimator:
    """
    Turns stretches of samples into estimates at the rows asked for.

    Parameters
    ----------
    config : DetectorConfig
        Settings, with numbers for the frequencies (`frequencies.with_frequencies`).
    """

    def __init__(self, config: DetectorConfig) -> None:
        self._shape: ModeShape | None = None
        self._begin(config)

    def _begin(self, config: DetectorConfig) -> None:
        """Make all that remembers anything but the mode shape."""
        self.config = config
        self._channels = tuple(name for name in CHANNELS if name in config.channels)
        self._health = {name: channel_health(config, name) for name in self._channels}
        self._motion = tuple(name for name in MOTION if name in self._channels)
        self._slow: dict[str, SlowChannel] = {
            name: SlowChannel(config.timeout_ns(name), rising=name == 'roller')
            for name in ('roller', 'speed')
            if name in self._channels
        }
        self._speed_check = SpeedCheck(config) if len(self._slow) == 2 else None
        self._unwrapping = Unwrapping()
        self._angle = turning_angle(config)
        self._turning = turning_of(config)
        self._agreement = Agreement(config)
        self._follow(config)

    def _follow(self, config: DetectorConfig) -> None:
        """Make what depends on where the hunting frequency is."""
        self._tracker = HuntingTracker(tracker_config(config))
        orders = line_orders(config)
        self._opinions = {
            name: SecondOpinion(config, orders) for name in self._motion if name in DISPLACEMENTS
        }
        self._lines: dict[str, LineSearch] = {name: line_search(config) for name in self._opinions}
        shape, self._shape = self._shape, None
        self.set_mode_shape(shape)

    def retune(self, config: DetectorConfig) -> None:
        """Follow other frequencies from the next sample on; the channels are watched on."""
        self.config = config
        self._follow(config)
        for name, watch in self._health.items():
            watch.follow(channel_health(config, name))

    def reconfigure(self, config: DetectorConfig) -> None:
        """Use other settings, but for those that are fixed, from the next sample on."""
        self.config = config
        for name, watch in self._health.items():
            watch.follow(channel_health(config, name))

    def reset(self) -> None:
        """Forget every sample; the mode shape is kept."""
        self._begin(self.config)

    def set_mode_shape(self, shape: ModeShape | None) -> None:
        """Give the tracker another mode shape; what it has learnt by itself it keeps."""
        if shape is self._shape:
            return
        self._shape = shape
        plain = tracker_config(self.config)
        if shape is None:
            self._tracker.set_modes((), plain.yaw_ratio_std)
        else:
            self._tracker.set_modes(mode_points(shape, plain), SCALE_STD)

    def run(
        self, rows_ns: NDArray[np.int64], blocks: dict[str, Block]
    ) -> tuple[NDArray[np.void], NDArray[np.bool_], Motion]:
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
        motion : Motion
            The usable samples of the motion.
        """
        rows = blank_rows(rows_ns)
        usable = {}
        for name, block in blocks.items():
            wrong, usable[name], sizes = self._health[name].update(block, rows_ns)
            if name in DISPLACEMENTS:
                blind = (wrong & health.BLIND) != 0
                rows[f'{name}_step'], rows[f'{name}_measured'] = np.where(blind, math.nan, sizes)
            if name in self.config.optional_channels:
                wrong = health.excused(wrong)
            rows[f'{name}_wrong'] = wrong
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
            self._excuse_roller(rows)
        if self._speed_check is not None:
            contrary = self._speed_check.update(rows_ns, slow['roller'][count:], rows['speed'])
            rows['speed_wrong'][contrary] |= np.uint32(health.CONTRADICTED)
        own = np.flatnonzero(sensor == self._motion.index(next(iter(self._opinions))))
        quiet = np.ones(own.size, dtype=np.bool_)
        encoder = slow['roller'][:count]
        motion = Motion(stamp[own], value[own], speed[own], encoder[own], quiet)
        turning, changed = self._turning.update(rows_ns, slow['angle'][count:])
        self._agreement.update(rows, track, turning, changed)
        known = lines_known(self.config, rows['speed'])
        lines = np.where(known, slow['angle'][count:], math.nan)
        readings = {
            name: (stamp[sensor == k], value[sensor == k])
            for k, name in enumerate(self._motion)
            if name in self._opinions
        }
        return rows, self._compare(rows, track, lines, turning, changed, readings), motion

    def _in_order(
        self, blocks: dict[str, Block], usable: dict[str, NDArray[np.bool_]]
    ) -> tuple[NDArray[np.int64], NDArray[np.int8], NDArray[np.float64]]:
        """Return stamps, sensors (places in `_motion`) and values that are usable, by stamp."""
        stamps, sensors, values = [], [], []
        for number, name in enumerate(self._motion):
            good = usable[name]
            stamps.append(blocks[name].stamps_ns[good])
            values.append(blocks[name].values[good])
            sensors.append(np.full(stamps[-1].size, number, dtype=np.int8))
        stamp = np.concatenate(stamps)
        order = np.argsort(stamp, kind='stable')
        return stamp[order], np.concatenate(sensors)[order], np.concatenate(values)[order]

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
        slow = {}
        for name in ('roller', 'speed'):
            found = np.full(wanted.size, math.nan)
            if name in blocks:
                block = blocks[name]
                readings = np.where(usable[name], block.values, math.nan)
                following = block.following
                if name == 'roller':
                    after_ns, after = following or (0, math.nan)
                    readings, after = self._unwrapping.update(
                        block.stamps_ns, readings, after_ns, after
                    )
                    following = None if following is None else (after_ns, after)
                found[sorting] = self._slow[name].at(
                    wanted[sorting], block.stamps_ns, readings, following
                )
                if name == 'speed':
                    found = np.abs(found)  # a wheelset hunts in reverse as it does ahead
            elif name == 'speed' and self.config.constant_speed_mps > 0.0:
                found[:] = self.config.constant_speed_mps
            slow[name] = found
        angle = np.empty(wanted.size)
        encoder, speed = slow['roller'][sorting], slow['speed'][sorting]
        within = self._slow['roller'].within if 'roller' in blocks else None
        angle[sorting] = self._angle.update(wanted[sorting], encoder, speed, within)
        slow['angle'] = angle
        return slow

    def _excuse_roller(self, rows: NDArray[np.void]) -> None:
        """A roller at rest is not stuck; where a speed channel is silent, it may be."""
        if 'speed' in self._channels:
            still = rows['speed'] <= health.STANDSTILL_MPS
        else:
            still = ~(rows['speed'] > health.STANDSTILL_MPS)
        rows['roller_wrong'][still] &= ~np.uint32(health.STUCK)

    def _compare(
        self,
        rows: NDArray[np.void],
        track: NDArray[np.void],
        lines: NDArray[np.float64],
        turning: NDArray[np.float64],
        changed: NDArray[np.bool_],
        readings: dict[str, tuple[NDArray[np.int64], NDArray[np.float64]]],
    ) -> NDArray[np.bool_]:
        """Ask for the second opinion; return the rows at which the two disagree."""
        disagree = np.zeros(rows.size, dtype=np.bool_)
        rows['followed_min_hz'] = self.config.hunting_frequency_min_hz
        rows['followed_max_hz'] = self.config.hunting_frequency_max_hz
        for name, coordinate in ((s.name, s.coordinate) for s in SENSORS if s.derivative == 0):
            if name in self._opinions:
                both = track[f'{name}_roughness'] + track[f'{name}_roughness_second']
                rows[f'{name}_envelope'], differs = self._opinions[name].update(
                    rows['stamp_ns'],
                    *readings[name],
                    lines,
                    turning,
                    (
                        track[f'{coordinate}_amplitude'],
                        track[f'{coordinate}_amplitude_std'],
                        track['frequency_hz'],
                        np.where(changed, np.nan_to_num(both), 0.0),
                    ),
                )
                disagree |= differs
                followed = track[f'{coordinate}_amplitude']
                self._look_elsewhere(name, followed, track, turning, rows)
        if self.config.measures('lateral'):
            rows['doubts'][track['lateral_tied'] == 1.0] |= np.uint32(doubts.FROM_YAW)
        return disagree

    def _look_elsewhere(
        self,
        name: str,
        followed: NDArray[np.float64],
        track: NDArray[np.void],
        turning: NDArray[np.float64],
        rows: NDArray[np.void],
    ) -> None:
        """Say what moves slower or faster than what the filter follows, `followed` its size."""
        signal = track[f'{name}_clean'] + track[f'{name}_bias']
        frequency, amplitude = self._lines[name].update(signal, turning, followed)
        there = np.isfinite(frequency)
        if not there.any():
            return
        slower = frequency < self.config.hunting_frequency_hz
        rows['doubts'][there & slower] |= np.uint32(doubts.TOO_SLOW)
        rows['doubts'][there & ~slower] |= np.uint32(doubts.TOO_FAST)
        first = np.isnan(rows['outside_hz'])
        rows['outside_hz'] = np.where(first, frequency, rows['outside_hz'])
        rows[f'outside_{name}'] = amplitude


def channel_health(config: DetectorConfig, channel: str) -> ChannelHealth:
    """Return the watch over one channel."""
    ranges = {s.name: float(getattr(config, s.range_setting, 0.0)) for s in SENSORS}
    return ChannelHealth(
        channel,
        config.timeout_ns(channel),
        ranges.get(channel, 0.0),
        config.hunting_frequency_hz,
        config.hunting_frequency_max_hz,
    )
