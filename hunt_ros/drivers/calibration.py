"""From the readings of a device (V, counts) to SI: gain, offset and the range of the readings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.errors import ConfigError
from hunt_ros.samples import Uncertain
from hunt_ros.settings import Settings, setting

_ANY = (-math.inf, math.inf)


@dataclass(frozen=True)
class Calibration(Settings):
    """
    What a reading means: parameters of a sensor node, as `hunt calibrate` writes them.

    Raises
    ------
    ConfigError
        Naming the value that makes no calibration.
    """

    gain: float = setting(
        1.0, 'SI of a unit of the reading; negative where the device counts the other way.'
    )
    offset: float = setting(0.0, 'SI at the reading 0.')
    range: tuple[float, ...] = setting(
        (), 'Readings at these ends or outside are saturated; none: those of the device.'
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not math.isfinite(self.gain) or self.gain == 0.0:
            raise ConfigError(f'gain: {self.gain}, expected a finite number that is not 0')
        if not math.isfinite(self.offset):
            raise ConfigError(f'offset: {self.offset}, expected a finite number')
        if self.range and (len(self.range) != 2 or not self.range[0] < self.range[1]):
            raise ConfigError(f'range: {self.range}, expected a lower and a higher reading')

    def within(self, low: float, high: float) -> Calibration:
        """Return it with the range of the device too: what either calls saturated is."""
        lowest, highest = self.range or _ANY
        return replace(self, range=(max(lowest, low), min(highest, high)))

    def saturated(self, readings: ArrayLike) -> NDArray[np.bool_]:
        """Return True for each reading at an end of the range or outside."""
        raw, (low, high) = np.asarray(readings, dtype=np.float64), self.range or _ANY
        return np.asarray((raw <= low) | (raw >= high))

    def apply(self, readings: ArrayLike) -> NDArray[np.float64]:
        """Return what readings mean, SI, shape (n,); NaN where one is NaN or saturated."""
        raw = np.asarray(readings, dtype=np.float64)
        return np.where(self.saturated(raw), np.nan, self.gain * raw + self.offset)


@dataclass(frozen=True)
class LineFit:
    """
    A straight line through known displacements.

    Parameters
    ----------
    gain, offset : Uncertain
        SI of a unit of the reading, SI at the reading 0. Their deviation is NaN for two points.
    residuals : tuple of float
        Known displacement less that of the line, SI, one a point.
    residual_std : float
        Their deviation with n - 2 degrees of freedom, SI; NaN for two points.
    bends : bool
        A parabola describes the points better, at 99 % (F test).
    """

    gain: Uncertain
    offset: Uncertain
    residuals: tuple[float, ...]
    residual_std: float
    bends: bool


def fit_line(points: Sequence[tuple[float, float]]) -> LineFit:
    """
    Fit a line to (reading, known displacement) by least squares.

    Parameters
    ----------
    points : sequence of (float, float)
        Readings in the unit of the device, displacements in SI.

    Raises
    ------
    ConfigError
        For less than two different readings or displacements, or a number that is not finite.
    """
    # Imported here: a sensor node applies calibrations, and needs 60 MB less without it.
    from scipy.special import fdtri, stdtrit
    from scipy.stats import linregress

    raw, known = np.array(points, dtype=np.float64).reshape(-1, 2).T
    if not np.isfinite([raw, known]).all():
        raise ConfigError('calibration: points: a number is not finite')
    if raw.size < 2 or np.ptp(raw) == 0.0 or np.ptp(known) == 0.0:
        raise ConfigError(
            f'calibration: {len(points)} points: expected two different readings and'
            ' displacements at least'
        )
    line, free = linregress(raw, known), raw.size - 2
    residuals = known - line.slope * raw - line.intercept
    squares = float((residuals**2).sum())

    def uncertain(value: float, std: float) -> Uncertain:
        """Return a number with the 95 % interval of Student's t: the points are few."""
        half = float(stdtrit(free, 0.975)) * std if free else math.nan
        return Uncertain(value, std if free else math.nan, value - half, value + half)

    bends = False
    if free > 1 and np.unique(raw).size > 2:
        scaled = (raw - raw.mean()) / np.ptp(raw)
        rest = float(((known - np.polyval(np.polyfit(scaled, known, 2), scaled)) ** 2).sum())
        rest = max(rest / (free - 1), (1e-9 * float(np.ptp(known))) ** 2)  # rounding
        bends = (squares - rest * (free - 1)) / rest > fdtri(1, free - 1, 0.99)
    return LineFit(
        uncertain(float(line.slope), float(line.stderr)),
        uncertain(float(line.intercept), float(line.intercept_stderr)),
        tuple(residuals.tolist()),
        math.sqrt(squares / free) if free else math.nan,
        bool(bends),
    )
