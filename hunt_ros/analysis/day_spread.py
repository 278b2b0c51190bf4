"""
How much the same rig differs from day to day: branches and hits, side by side by day.

An interval from the scatter within one day says nothing of the next one. Where
recordings of several days are there, the branch of each day is put on one grid of
speeds and the days themselves are the sample.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hunt_ros.samples import Uncertain, known

#: Speeds at which the days are compared.
_SPEEDS = 21
#: Largest gap between two states of one day, relative to the speed, that is bridged.
_BRIDGE = 0.08
#: Speeds that differ by no more than this share are one.
_SAME_SPEED = 1e-3
#: Replications of the bootstrap over days.
_REPLICATIONS = 2000


@dataclass(frozen=True)
class DayAmplitude:
    """Amplitude of the limit cycle on one day: speed (m/s), amplitude (m), day."""

    speed: float
    amplitude: float
    day: str


@dataclass(frozen=True)
class Hit:
    """
    Free motion after a disturbance at a constant speed.

    Parameters
    ----------
    speed : float
        m/s.
    day, source : str
    start_amplitude, end_amplitude : float
        m.
    growth_rate, growth_rate_std : float
        Mean d ln A / dt, 1/s; NaN where it could not be read.
    """

    speed: float
    day: str
    source: str
    start_amplitude: float
    end_amplitude: float
    growth_rate: float = math.nan
    growth_rate_std: float = math.nan

    @property
    def grew(self) -> bool:
        """Whether it ended larger than it began."""
        return self.end_amplitude > self.start_amplitude

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `hits`."""
        return {
            'speed_mps': self.speed,
            'day': self.day,
            'source': self.source,
            'grew': self.grew,
            'start_amplitude_m': self.start_amplitude,
            'end_amplitude_m': self.end_amplitude,
            'growth_rate_per_s': known(self.growth_rate),
            'growth_rate_std_per_s': known(self.growth_rate_std),
        }


@dataclass(frozen=True)
class Spread:
    """
    One quantity on several days.

    Parameters
    ----------
    speed : float
        m/s.
    mean : Uncertain
        Over the days, with the interval of the bootstrap over days.
    day_std : float
        Standard deviation from day to day, in the unit of the quantity.
    days : int
        That have it.
    """

    speed: float
    mean: Uncertain
    day_std: float
    days: int

    def to_json(self, name: str, unit: str) -> dict[str, Any]:
        """Return {speed_mps, NAME_UNIT, ci95_UNIT, day_std_UNIT, days}."""
        return {
            'speed_mps': self.speed,
            f'{name}_{unit}': self.mean.value,
            f'ci95_{unit}': [self.mean.low, self.mean.high],
            f'day_std_{unit}': self.day_std,
            'days': self.days,
        }


@dataclass(frozen=True, eq=False)
class DayBranches:
    """
    The stable branch of each day on one grid of speeds.

    Parameters
    ----------
    days : tuple of str
        In order.
    speeds : ndarray, shape (n,)
        m/s.
    amplitudes : ndarray, shape (days, n)
        m; NaN where a day has measured nothing.
    """

    days: tuple[str, ...]
    speeds: NDArray[np.float64]
    amplitudes: NDArray[np.float64]

    def spreads(self, seed: int = 0) -> list[Spread]:
        """Mean and spread at the speeds that at least two days have measured, m."""
        found = []
        for speed, column in zip(self.speeds, self.amplitudes.T, strict=True):
            spread = spread_of(float(speed), column[np.isfinite(column)], seed)
            if spread is not None:
                found.append(spread)
        return found

    def shifts(self) -> dict[str, float]:
        """Mean distance of each day from the mean of the days, where two have measured, m."""
        shared = np.isfinite(self.amplitudes).sum(axis=0) >= 2
        if not shared.any():
            return dict.fromkeys(self.days, math.nan)
        amplitudes = self.amplitudes[:, shared]
        away = amplitudes - np.nanmean(amplitudes, axis=0)
        known = np.isfinite(away).any(axis=1)
        return {
            day: float(np.nanmean(row)) if fine else math.nan
            for day, row, fine in zip(self.days, away, known, strict=True)
        }

    def day_std(self) -> float:
        """Standard deviation from day to day, pooled over the speeds, m; NaN for one day."""
        count = np.isfinite(self.amplitudes).sum(axis=0)
        shared = count >= 2
        if not shared.any():
            return math.nan
        variance = np.nanvar(self.amplitudes[:, shared], axis=0, ddof=1)
        freedom = count[shared] - 1
        return math.sqrt(float(np.sum(freedom * variance) / np.sum(freedom)))


def branch_by_day(states: Sequence[DayAmplitude]) -> DayBranches:
    """
    Put the stable branch of each day on one grid of speeds.

    The states of a day are joined by straight lines, and nothing is extrapolated: a day
    speaks only between neighbouring speeds that it has measured.

    Parameters
    ----------
    states : sequence of DayAmplitude
        Hunting states of all days.
    """
    days = tuple(sorted({state.day for state in states}))
    if not days:
        return DayBranches((), np.zeros(0), np.zeros((0, 0)))
    speeds = np.array([state.speed for state in states])
    held = {round(state.speed, 2) for state in states}
    shared = [
        speed for speed in held if len({s.day for s in states if round(s.speed, 2) == speed}) > 1
    ]
    grid = np.unique([*np.linspace(speeds.min(), speeds.max(), _SPEEDS), *shared])
    table = np.stack([_on_grid([s for s in states if s.day == day], grid) for day in days])
    return DayBranches(days, grid, table)


def _on_grid(states: Sequence[DayAmplitude], grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Amplitude of one day at each speed of the grid, m; NaN where it has measured nothing."""
    # States of one speed are one point: runs up and down, repeated runs.
    speeds = sorted({round(state.speed, 6) for state in states})
    values = [
        float(np.mean([s.amplitude for s in states if round(s.speed, 6) == speed]))
        for speed in speeds
    ]
    at = np.array(speeds)
    on_grid = np.interp(grid, at, values, left=np.nan, right=np.nan)
    right = np.clip(np.searchsorted(at, grid), 1, max(at.size - 1, 1))
    nearest = np.abs(grid[:, None] - at).argmin(axis=1)
    if at.size > 1:
        on_grid[at[right] - at[right - 1] > _BRIDGE * np.abs(grid)] = np.nan
    same = np.abs(at[nearest] - grid) <= _SAME_SPEED * np.abs(grid)
    return np.where(same, np.array(values)[nearest], on_grid)


def hits_by_speed(hits: Sequence[Hit], seed: int = 0, tolerance: float = 0.01) -> list[Spread]:
    """
    Compare growth rates of hits at one speed on different days.

    Parameters
    ----------
    hits : sequence of Hit
        Those without a growth rate are left out.
    seed : int
        Of the bootstrap.
    tolerance : float
        Speeds within this share of each other count as one.

    Returns
    -------
    list of Spread
        1/s, at the speeds at which at least two days have a hit.
    """
    usable = sorted((h for h in hits if math.isfinite(h.growth_rate)), key=lambda hit: hit.speed)
    groups: list[list[Hit]] = []
    for hit in usable:
        if groups and hit.speed <= groups[-1][0].speed * (1.0 + tolerance):
            groups[-1].append(hit)
        else:
            groups.append([hit])
    found = []
    for group in groups:
        means = [
            float(np.mean([hit.growth_rate for hit in group if hit.day == day]))
            for day in sorted({hit.day for hit in group})
        ]
        speed = float(np.mean([hit.speed for hit in group]))
        spread = spread_of(speed, np.array(means), seed)
        if spread is not None:
            found.append(spread)
    return found


def spread_of(speed: float, values: NDArray[np.float64], seed: int = 0) -> Spread | None:
    """
    Mean over days with the interval of a bootstrap over days.

    Parameters
    ----------
    speed : float
        m/s.
    values : ndarray, shape (days,)
        One value a day, finite.
    seed : int
        Of the bootstrap.

    Returns
    -------
    Spread or None
        None for fewer than two days.

    References
    ----------
    Efron, B., Tibshirani, R. J., An Introduction to the Bootstrap (1993), Sects. 6.5 and
    12.5: for n values the percentiles are too narrow by sqrt(n / (n - 1)), and by
    Student's quantile over the normal one.
    """
    count = values.size
    if count < 2:
        return None
    mean = float(values.mean())
    generator = np.random.default_rng(seed)
    drawn = values[generator.integers(0, count, (_REPLICATIONS, count))].mean(axis=1)
    std = math.sqrt(count / (count - 1)) * float(drawn.std())
    # With two or three days the percentiles themselves are a handful of values: the
    # deviation of the replications is what can be used, with Student's quantile.
    reach = float(stats.t.ppf(0.975, count - 1)) * std
    return Spread(
        speed,
        Uncertain(mean, std, mean - reach, mean + reach),
        float(values.std(ddof=1)),
        count,
    )
