"""
From the readings of a device (V, counts) to SI: gain, offset and the range of the readings.

A calibration is a YAML file, which `hunt calibrate` makes and a sensor node applies::

    calibration:
      channel: lateral
      unit: m
      gain: 0.002             # SI of a unit of the reading; negative where it counts the other way
      offset: -0.001          # SI at the reading 0
      range: [-9.9, 9.9]      # readings at these ends or outside are saturated
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from hunt_ros.errors import ConfigError
from hunt_ros.samples import Uncertain
from hunt_ros.sensors import SENSORS
from hunt_ros.settings import Settings

_UNITS = {sensor.name: sensor.unit for sensor in SENSORS}
#: What a file may say beside the settings; `polarity`, always 1, is one of earlier versions.
_BESIDE = {'channel', 'unit', 'polarity', 'made', 'fit'}


@dataclass(frozen=True)
class Calibration(Settings):
    """
    What a reading means.

    Parameters
    ----------
    gain, offset : float
        SI = gain * reading + offset.
    range : tuple of float
        Readings at these ends or outside are saturated.

    Raises
    ------
    ConfigError
        Naming the value that makes no calibration.
    """

    gain: float = 1.0
    offset: float = 0.0
    range: tuple[float, float] = (-math.inf, math.inf)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not math.isfinite(self.gain) or self.gain == 0.0:
            raise ConfigError(f'gain: {self.gain}, expected a finite number that is not 0')
        if not math.isfinite(self.offset):
            raise ConfigError(f'offset: {self.offset}, expected a finite number')
        ends = self.range if isinstance(self.range, tuple) else ()
        if {*map(type, ends)} - {int, float} or len(ends) != 2 or not ends[0] < ends[1]:
            raise ConfigError(f'range: {self.range}, expected a lower and a higher reading')

    @classmethod
    def read(cls, path: str, channel: str) -> Calibration:
        """
        Read the calibration of a channel from a file; an empty path means readings in SI.

        Raises
        ------
        ConfigError
            If the file cannot be read, is no calibration, or is that of another channel.
        """
        if not path:
            return cls()
        try:
            document = yaml.safe_load(Path(path).read_text(encoding='utf-8'))
            given = document.get('calibration') if isinstance(document, dict) else None
            if not isinstance(given, dict):
                raise ConfigError('expected a mapping under the key calibration')
            if unknown := cls.unknown(given) - _BESIDE:
                raise ConfigError(f'unknown key {min(map(str, unknown))!r}')
            if 'gain' not in given:
                raise ConfigError('expected a gain')
            for name, wanted in (('channel', channel), ('unit', _UNITS[channel]), ('polarity', 1)):
                if given.get(name, wanted) != wanted:
                    raise ConfigError(f'{name}: {given[name]}, expected {wanted} for {channel}')
            return cls.from_recorded(given)
        except (OSError, ValueError, yaml.YAMLError) as error:
            reason = getattr(error, 'strerror', None) or ' '.join(str(error).split())
            raise ConfigError(f'calibration {path}: {reason}') from error

    def within(self, low: float, high: float) -> Calibration:
        """Return it with the range of the device too: what either calls saturated is."""
        return replace(self, range=(max(self.range[0], low), min(self.range[1], high)))

    def saturated(self, readings: ArrayLike) -> NDArray[np.bool_]:
        """Return True for each reading at an end of the range or outside."""
        raw = np.asarray(readings, dtype=np.float64)
        return np.asarray((raw <= self.range[0]) | (raw >= self.range[1]))

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
