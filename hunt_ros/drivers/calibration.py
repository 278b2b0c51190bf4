"""
From the readings of a device (V, counts) to SI: by gain and offset, or by a table.

A calibration is a YAML file, which `hunt calibrate` makes and a sensor node applies::

    calibration:
      channel: lateral
      unit: m
      polarity: 1             # -1: the sensor looks the other way
      gain: 0.002             # SI of a unit of the reading
      offset: -0.001          # SI at the reading 0
      range: [-9.9, 9.9]      # readings at these ends or outside are saturated
      table: [[-5.0, -0.011], [0.0, -0.001], [5.0, 0.009]]   # instead of gain and offset
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from hunt_ros.errors import ConfigError
from hunt_ros.samples import Uncertain
from hunt_ros.sensors import SENSORS

_UNITS = {sensor.name: sensor.unit for sensor in SENSORS}
_KEYS = {'channel', 'unit', 'polarity', 'gain', 'offset', 'range', 'table', 'made', 'fit'}


@dataclass(frozen=True)
class Calibration:
    """
    What a reading means.

    Parameters
    ----------
    channel : str
        Sensor of the motion; '' for any.
    gain, offset : float
        SI = polarity * (gain * reading + offset), where there is no table.
    table : tuple of (float, float)
        (reading, SI), interpolated; readings outside are saturated. Both columns monotonic.
    range : tuple of float
        Readings at these ends or outside are saturated.
    polarity : int
        1, or -1 where the sensor looks the other way.
    source : str
        Where it stands, for messages.

    Raises
    ------
    ConfigError
        Naming the value that makes no calibration.
    """

    channel: str = ''
    gain: float = 1.0
    offset: float = 0.0
    table: tuple[tuple[float, float], ...] = ()
    range: tuple[float, float] = (-math.inf, math.inf)
    polarity: int = 1
    source: str = field(default='calibration', compare=False)

    def __post_init__(self) -> None:
        if self.channel and self.channel not in _UNITS:
            self._refuse('channel', repr(self.channel), f'one of {", ".join(_UNITS)}')
        if self.polarity not in (1, -1):
            self._refuse('polarity', self.polarity, '1 or -1')
        if not math.isfinite(self.gain) or self.gain == 0.0:
            self._refuse('gain', self.gain, 'a finite number that is not 0')
        if not math.isfinite(self.offset):
            self._refuse('offset', self.offset, 'a finite number')
        if not self.range[0] < self.range[1]:
            self._refuse('range', list(self.range), 'a lower and a higher reading')
        if self.table:
            self._check_table()

    def _refuse(self, key: str, value: object, expected: str) -> None:
        raise ConfigError(f'{self.source}: {key}: {value}, expected {expected}')

    def _check_table(self) -> None:
        """Refuse a table that is not monotonic: a reading would mean two things, or none."""
        if len(self.table) < 2:
            self._refuse('table', list(self.table), 'two rows or more')
        readings, values = (np.array(column) for column in zip(*self.table, strict=True))
        if not (np.isfinite(readings).all() and np.isfinite(values).all()):
            self._refuse('table', list(self.table), 'finite numbers')
        for name, column in (('readings', readings), ('values', values)):
            steps = np.diff(column) * (1.0 if column[-1] > column[0] else -1.0)
            if (steps <= 0.0).any():
                row = int(np.argmax(steps <= 0.0)) + 1
                self._refuse(
                    f'table: row {row + 1}',
                    f'{column[row]:g} after {column[row - 1]:g}',
                    f'monotonic {name}',
                )

    @classmethod
    def from_yaml(cls, text: str, source: str) -> Calibration:
        """
        Read a calibration.

        Parameters
        ----------
        text : str
            YAML, as in the docstring of this module.
        source : str
            Where it comes from, for messages.

        Raises
        ------
        ConfigError
            Naming what is wrong, and where.
        """
        try:
            document = yaml.safe_load(text)
        except yaml.YAMLError as error:
            reason = ' '.join(str(error).split())
            raise ConfigError(f'{source}: no YAML ({reason})') from error
        given = document.get('calibration') if isinstance(document, dict) else None
        if not isinstance(given, dict):
            raise ConfigError(f'{source}: expected a mapping under the key calibration')
        unknown = sorted(map(str, set(given) - _KEYS))
        if unknown:
            raise ConfigError(f'{source}: unknown key {unknown[0]!r}, expected {sorted(_KEYS)}')
        if not ('gain' in given) ^ ('table' in given):
            raise ConfigError(f'{source}: expected gain and offset, or a table')
        channel = str(given.get('channel', ''))
        unit = given.get('unit', _UNITS.get(channel))
        if channel in _UNITS and unit != _UNITS[channel]:
            raise ConfigError(f'{source}: unit: {unit}, expected {_UNITS[channel]} for {channel}')
        return cls(
            channel=channel,
            gain=_number(given.get('gain', 1.0), source, 'gain'),
            offset=_number(given.get('offset', 0.0), source, 'offset'),
            table=_pairs(given.get('table', ()), source, 'table'),
            range=(_pairs([given['range']], source, 'range') or ((0.0, 0.0),))[0]
            if 'range' in given
            else (-math.inf, math.inf),
            polarity=given.get('polarity', 1),
            source=source,
        )

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
            text = Path(path).read_text(encoding='utf-8')
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, 'strerror', None) or 'not UTF-8 text'
            raise ConfigError(f'calibration {path}: cannot read it ({reason})') from error
        found = cls.from_yaml(text, f'calibration {path}')
        if found.channel not in ('', channel):
            raise ConfigError(f'calibration {path}: channel: {found.channel}, expected {channel}')
        return found

    def within(self, low: float, high: float) -> Calibration:
        """Return it with the range of the device too: what either calls saturated is."""
        both = (max(self.range[0], low), min(self.range[1], high))
        return Calibration(
            self.channel, self.gain, self.offset, self.table, both, self.polarity, self.source
        )

    def saturated(self, readings: ArrayLike) -> NDArray[np.bool_]:
        """Return True for each reading at an end of the range, or outside of range or table."""
        raw = np.asarray(readings, dtype=np.float64)
        outside = (raw <= self.range[0]) | (raw >= self.range[1])
        if self.table:
            ends = [row[0] for row in (self.table[0], self.table[-1])]
            outside |= (raw < min(ends)) | (raw > max(ends))
        return np.asarray(outside)

    def apply(self, readings: ArrayLike) -> NDArray[np.float64]:
        """Return what readings mean, SI, shape (n,); NaN where one is NaN or saturated."""
        raw = np.asarray(readings, dtype=np.float64)
        if self.table:
            rows = sorted(self.table)
            value = np.interp(raw, [row[0] for row in rows], [row[1] for row in rows])
        else:
            value = self.gain * raw + self.offset
        return np.where(self.saturated(raw) | np.isnan(raw), np.nan, self.polarity * value)


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
    """

    gain: Uncertain
    offset: Uncertain
    residuals: tuple[float, ...]
    residual_std: float


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
    raw, known = (np.array(column, dtype=np.float64) for column in zip(*points, strict=True))
    if not (np.isfinite(raw).all() and np.isfinite(known).all()):
        raise ConfigError('calibration: points: a number is not finite')
    if np.ptp(raw) == 0.0 or np.ptp(known) == 0.0:
        raise ConfigError(
            f'calibration: {len(points)} points: expected two different readings and'
            ' displacements at least'
        )
    mean = raw.mean()
    spread = float(((raw - mean) ** 2).sum())
    gain = float(((raw - mean) * known).sum()) / spread
    offset = float(known.mean() - gain * mean)
    residuals = known - gain * raw - offset
    free = raw.size - 2
    std = math.sqrt(float((residuals**2).sum()) / free) if free else math.nan
    of_offset = std * math.sqrt(1.0 / raw.size + mean**2 / spread)
    return LineFit(
        _uncertain(gain, std / math.sqrt(spread), free),
        _uncertain(offset, of_offset, free),
        tuple(residuals.tolist()),
        std,
    )


def _uncertain(value: float, std: float, free: int) -> Uncertain:
    """Return a number with the 95 % interval of Student's t: the points are few."""
    if not free:
        return Uncertain(value, math.nan)
    # Imported here: a sensor node applies calibrations, and needs 60 MB less without it.
    from scipy.special import stdtrit

    half = float(stdtrit(free, 0.975)) * std
    return Uncertain(value, std, value - half, value + half)


def _number(value: Any, source: str, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f'{source}: {key}: {value!r}, expected a number')
    return float(value)


def _pairs(value: Any, source: str, key: str) -> tuple[tuple[float, float], ...]:
    """Return rows of two numbers."""
    if not isinstance(value, Sequence) or isinstance(value, str | Mapping):
        raise ConfigError(f'{source}: {key}: {value!r}, expected rows of two numbers')
    rows = []
    for row in value:
        if not isinstance(row, Sequence) or isinstance(row, str) or len(row) != 2:
            raise ConfigError(f'{source}: {key}: {row!r}, expected two numbers')
        rows.append((_number(row[0], source, key), _number(row[1], source, key)))
    return tuple(rows)
