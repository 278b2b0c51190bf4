"""
The hunting mode as the two sensors see it: yaw over lateral, by speed and amplitude.

It is measured by `identification.record.mode_ratio`, made a table by `fitted_shape`, stands in the
parameter file beside the normal form, and lets the tracker tell the lateral amplitude from the
yaw sensor alone.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.errors import ConfigError
from hunt_ros.settings import checked, yaml_value

_F = NDArray[np.float64]

#: Keys of the tables in a parameter file, all lists of numbers: real and imaginary part of the
#: ratio are in rad/m.
KEYS = (
    'mode_speed',
    'mode_amplitude',
    'mode_frequency_hz',
    'mode_ratio_real',
    'mode_ratio_imag',
    'mode_ratio_std',
)
#: Nodes of a table along speed and amplitude.
_SPEEDS, _AMPLITUDES = 5, 9
#: How far a table reaches beyond the values it is made from.
_BEYOND = 1.3
#: And what is not known there of a mode, relative: per change of ln(speed), and at the node
#: beyond the largest amplitude.
_CARRY_SPEED, _CARRY_AMPLITUDE = 0.5, 0.1
#: Terms of the ratio in (speed, amplitude squared), with their prior size as shares of it:
#: those of the normal form, Eq. (24), by which the growth rate of Eq. (2) enters the shape.
_PRIOR = (0.5, 0.5, 0.2, 0.2, 0.1)
#: What each value of the ratio is off by, relative, beside its own noise; and how many are
#: independent in that.
_ALIKE, _INDEPENDENT = 0.02, 30.0
#: Relative accuracy below which no table is believed, that computed from parameters included.
_LEAST_STD = 0.005


@dataclass(frozen=True, eq=False)
class ModeShape:
    """
    Tables over running speed and lateral amplitude, to be interpolated and held at their ends.

    Parameters
    ----------
    speeds : ndarray, shape (n,)
        m/s, increasing.
    amplitudes : ndarray, shape (m,)
        Amplitude of the lateral motion, m, increasing.
    frequency_hz : ndarray, shape (n,)
        Of the hunting mode, Hz.
    ratio : ndarray of complex, shape (n, m)
        Yaw phasor over lateral phasor, rad/m.
    ratio_std : ndarray, shape (n, m)
        Its relative standard deviation.
    """

    speeds: _F
    amplitudes: _F
    frequency_hz: _F
    ratio: NDArray[np.complex128]
    ratio_std: _F

    def to_parameters(self) -> dict[str, list[float]]:
        """Return the entries of the parameter file, `KEYS`: flat lists, speed by speed."""
        ratio = self.ratio.real, self.ratio.imag
        tables = self.speeds, self.amplitudes, self.frequency_hz, *ratio, self.ratio_std
        return {key: table.ravel().tolist() for key, table in zip(KEYS, tables, strict=True)}

    @classmethod
    def from_parameters(cls, group: Mapping[str, Any], source: str) -> ModeShape | None:
        """
        Read the entries of a parameter file.

        Parameters
        ----------
        group : mapping
            May hold any other keys.
        source : str
            Named in messages.

        Returns
        -------
        ModeShape or None
            None where the file holds none of them.

        Raises
        ------
        ConfigError
            For what is no list of numbers, and for lists that do not fit together.
        """
        lists = [numbers(group.get(key), key, source) for key in KEYS]
        speeds, amplitudes, frequency, real, imag, std = lists
        grid = speeds.size, amplitudes.size
        cells = grid[0] * grid[1]
        if not any(one.size for one in lists):
            return None
        if not cells or frequency.size != grid[0] or {one.size for one in lists[3:]} != {cells}:
            sizes = ', '.join(f'{key} {one.size}' for key, one in zip(KEYS, lists, strict=True))
            raise ConfigError(f'{source}: lists of the mode shape differ in length: {sizes}')
        rising = (np.diff(speeds) > 0.0).all() and (np.diff(amplitudes) > 0.0).all()
        if not (rising and (frequency > 0.0).all() and (std >= 0.0).all() and amplitudes[0] >= 0):
            raise ConfigError(
                f'{source}: mode shape: {KEYS[0]} and {KEYS[1]} must increase, no value but those'
                ' of the ratio may be negative'
            )
        ratio = (real + 1j * imag).reshape(grid)
        return cls(speeds, amplitudes, frequency, ratio, std.reshape(grid))


def fitted_shape(
    speed: ArrayLike,
    amplitude: ArrayLike,
    ratio: ArrayLike,
    relative_std: ArrayLike,
    frequency_hz: ArrayLike,
    alike: float = _ALIKE,
) -> ModeShape | None:
    """
    Smooth table through scattered values of the ratio.

    The ratio is a polynomial with the terms of Eq. (24): 1, e, e^2, A^2, e A^2, A^4, e the
    relative change of speed; each but the first has a prior size, so that what the values
    do not tell stays small, and shows in the standard deviation.

    Parameters
    ----------
    speed, amplitude, ratio, relative_std, frequency_hz : array_like, shape (k,)
        m/s; lateral amplitude, m; yaw over lateral phasor, rad/m; its relative standard
        deviation; frequency of the motion, Hz. Not finite: left out.
    alike : float
        What each value is off by, relative, beside its own standard deviation, in a way it
        shares with its neighbours.

    Returns
    -------
    ModeShape or None
        None where fewer than three values are left, or they do not tell the ratio to a half.
    """
    v, a, s = (np.asarray(x, dtype=np.float64) for x in (speed, amplitude, relative_std))
    values, turning = np.asarray(ratio, np.complex128), np.asarray(frequency_hz, np.float64)
    good = np.isfinite(v) & np.isfinite(a) & np.isfinite(values) & (values != 0.0) & (s > 0.0)
    good &= np.isfinite(s) & (turning > 0.0) & (v > 0.0)
    if np.count_nonzero(good) < 3:
        return None
    v, a, s, values, turning = v[good], a[good], s[good], values[good], turning[good]
    # Windows of one run share what the polynomial cannot follow: they are no more than so many
    # independent values, and none is exact.
    s = np.hypot(s, alike) * math.sqrt(max(1.0, s.size / _INDEPENDENT))
    middle, largest = float(np.median(v)), float(np.max(a))
    # A ratio that is wrong by a turn of a phase or a factor must not draw the rest along.
    centre = complex(_weighted_median(values.real, s), _weighted_median(values.imag, s))
    scaled = values / centre
    unit = largest or 1.0  # linear theory speaks of no amplitude
    basis = _basis(v / middle - 1.0, a / unit)
    kept = np.ones(v.size, dtype=np.bool_)
    for _ in range(4):
        weight = kept / s**2
        information = basis.T @ (weight[:, None] * basis)
        information[1:, 1:] += np.diag(1.0 / np.square(_PRIOR))
        try:
            covariance = np.linalg.inv(information)
        except np.linalg.LinAlgError:
            return None
        terms = covariance @ (basis.T @ (weight * scaled))
        off = np.abs(scaled - basis @ terms) / s
        spread = max(1.0, float(np.sqrt(np.mean(off[kept] ** 2) / 2.0)))
        kept = off < 4.0 * spread
        if np.count_nonzero(kept) < 3:
            return None
    within = np.linspace(v.min(), v.max(), _SPEEDS)
    # One more node beyond the values on each side: held there, and known to little.
    speeds: _F = np.unique(np.concatenate([[v.min() / _BEYOND], within, [v.max() * _BEYOND]]))
    parts = np.append(np.sqrt(np.linspace(0.0, 1.0, _AMPLITUDES)), _BEYOND)  # even in A^2
    amplitudes: _F = np.unique(largest * parts)
    held = np.clip(speeds, v.min(), v.max())
    grid = _basis(
        np.repeat(held / middle - 1.0, amplitudes.size),
        np.tile(np.minimum(amplitudes, largest) / unit, speeds.size),
    )
    doubt = (_CARRY_SPEED * np.log(speeds / held))[:, None] ** 2
    doubt = doubt + (_CARRY_AMPLITUDE * (amplitudes > largest)) ** 2
    shape = speeds.size, amplitudes.size
    table = (centre * (grid @ terms)).reshape(shape)
    variance = np.einsum('ij,jk,ik->i', grid, covariance, grid) * spread**2 + _LEAST_STD**2
    std = np.sqrt(variance.reshape(shape) + doubt)
    if not np.min(std) < 0.5 or not np.all(np.abs(table) > 0.0):
        return None
    frequency = _line(v / middle - 1.0, turning, s, speeds / middle - 1.0)
    digits = [_rounded(numbers) for numbers in (speeds, amplitudes, frequency, std)]
    ratios = _rounded(table.real) + 1j * _rounded(table.imag)
    return ModeShape(digits[0], digits[1], digits[2], ratios, digits[3])


def _rounded(table: _F) -> _F:
    """Round to six digits, which a file holds exactly and more than are known."""
    return np.array([float(f'{value:.6g}') for value in table.ravel()]).reshape(table.shape)


def _line(e: _F, frequency: _F, std: _F, wanted: _F) -> _F:
    """Straight line through frequencies over relative speeds, its slope with a prior too."""
    weight = 1.0 / std**2
    middle, mean = np.average(e, weights=weight), np.average(frequency, weights=weight)
    across = np.sum(weight * (e - middle) * (frequency / mean - 1.0))
    slope = across / (np.sum(weight * (e - middle) ** 2) + 1.0 / _PRIOR[0] ** 2)
    line: _F = mean * (1.0 + slope * (wanted - middle))
    return np.clip(line, frequency.min(), frequency.max())


def _weighted_median(values: _F, std: _F) -> float:
    order = np.argsort(values)
    weight = np.cumsum(1.0 / std[order] ** 2)
    return float(values[order][np.searchsorted(weight, 0.5 * weight[-1])])


def _basis(e: _F, a: _F) -> _F:
    """Columns 1, e, e^2, A^2, e A^2, A^4, shape (k, 6)."""
    power = a * a
    return np.stack([np.ones_like(e), e, e * e, power, e * power, power * power], axis=1)


def numbers(values: object, name: str, source: str, expected: str = 'a list of numbers') -> _F:
    """
    Return a list of a parameter file as an array, shape (n,); empty where there is none.

    Parameters
    ----------
    values : object
        A list from YAML, an `array.array` from rclpy, one number, or None.
    name, source, expected : str
        Key, file and what should stand there, for the message.

    Raises
    ------
    ConfigError
        For anything else, and numbers that are not finite.
    """
    if values is None:
        return np.zeros(0)
    listed = isinstance(values, Sequence | array) and not isinstance(values, str | bytes)
    entries: list[Any] = list(values) if listed else [values]  # type: ignore[call-overload]
    found = [yaml_value(0.0, entry) for entry in entries]
    return np.array([checked(f'{source}: {name}', entry, expected=expected) for entry in found])
