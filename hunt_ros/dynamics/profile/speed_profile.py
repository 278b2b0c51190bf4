"""The set point of the running speed against time, as an experiment prescribes it."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.errors import ConfigError
from hunt_ros.settings import checked


@dataclass(frozen=True)
class SpeedProfile:
    """
    A piecewise linear set point; held after its last corner.

    Parameters
    ----------
    times_s : tuple of float
        Corners, increasing, the first at 0.
    speeds : tuple of float
        Set points there, m/s.

    Raises
    ------
    ConfigError
        For times that do not increase or speeds that are negative or not finite.
    """

    times_s: tuple[float, ...]
    speeds: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.times_s) != len(self.speeds) or not self.times_s:
            raise ConfigError(
                f'speed profile: {len(self.times_s)} times for {len(self.speeds)} speeds'
            )
        if self.times_s[0] != 0.0:
            raise ConfigError(f'speed profile: must begin at 0 s, got {self.times_s[0]}')
        for before, after in itertools.pairwise(self.times_s):
            if not after > before:
                raise ConfigError(f'speed profile: {after} s comes after {before} s')
        for speed in self.speeds:
            checked('speed profile: speed', speed, 'not be negative')

    @property
    def duration_s(self) -> float:
        """Time of the last corner, s."""
        return self.times_s[-1]

    def __call__(self, time_s: ArrayLike) -> NDArray[np.float64]:
        """Return the set point, m/s, at times in s, any shape."""
        times = np.asarray(time_s, dtype=np.float64)
        return np.asarray(np.interp(times, self.times_s, self.speeds), dtype=np.float64)

    @classmethod
    def constant(cls, speed: float) -> SpeedProfile:
        """One speed, m/s, for as long as the simulation runs."""
        return cls((0.0,), (float(speed),))

    @classmethod
    def staircase(cls, *speeds: float, hold_s: float, acceleration: float = 0.2) -> SpeedProfile:
        """
        Hold one speed after another.

        Parameters
        ----------
        *speeds : float
            m/s.
        hold_s : float
            Time on each, s, ramps not counted.
        acceleration : float
            Of the ramps between them, m/s^2.
        """
        checked('speed profile: hold_s', hold_s, 'be positive')
        checked('speed profile: acceleration', acceleration, 'be positive')
        times, values = [0.0], [float(speeds[0])] if speeds else []
        for speed in speeds:
            if speed != values[-1]:
                times.append(times[-1] + abs(speed - values[-1]) / acceleration)
                values.append(float(speed))
            times.append(times[-1] + hold_s)
            values.append(float(speed))
        return cls(tuple(times), tuple(values))

    @classmethod
    def sweep(cls, low: float, high: float, rate: float, back: bool = True) -> SpeedProfile:
        """
        Go from `low` to `high` (m/s) at `rate` (m/s^2), and back unless `back` is false.

        With low > high the sweep goes down first.
        """
        checked('speed profile: rate', rate, 'be positive')
        one_way = abs(high - low) / rate
        if back:
            return cls((0.0, one_way, 2.0 * one_way), (low, high, low))
        return cls((0.0, one_way), (low, high))
