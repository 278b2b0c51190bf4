"""Tables of the mode shape: through measured values, and from the equations of motion."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.dynamics.limit_cycle import Branch
from hunt_ros.dynamics.linear_stability import critical_speed, hunting_mode
from hunt_ros.dynamics.mode_shape import ModeShape
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.wheelset import Wheelset
from hunt_ros.errors import ConfigError

_F = NDArray[np.float64]

#: Nodes of a table along speed and amplitude.
_SPEEDS, _AMPLITUDES = 5, 9
#: How far a table reaches beyond the values it is made from.
_BEYOND = 1.3
#: And what is not known there of a mode, relative: per change of ln(speed), and at the node
#: beyond the largest amplitude.
CARRY_SPEED, _CARRY_AMPLITUDE = 0.5, 0.1
#: Terms of the ratio in (speed, amplitude squared), with their prior size as shares of it:
#: those of the normal form, Eq. (24), by which the growth rate of Eq. (2) enters the shape.
_PRIOR = (0.5, 0.5, 0.2, 0.2, 0.1)
#: What each value of the ratio is off by, relative, beside its own noise; and how many are
#: independent in that.
_ALIKE, _INDEPENDENT = 0.02, 30.0
#: Relative accuracy below which no table is believed, that computed from parameters included.
_LEAST_STD = 0.005


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
    doubt = (CARRY_SPEED * np.log(speeds / held))[:, None] ** 2
    doubt = doubt + (_CARRY_AMPLITUDE * (amplitudes > largest)) ** 2
    shape = speeds.size, amplitudes.size
    table = (centre * (grid @ terms)).reshape(shape)
    variance = np.einsum('ij,jk,ik->i', grid, covariance, grid) * spread**2 + _LEAST_STD**2
    std = np.sqrt(variance.reshape(shape) + doubt)
    if not np.min(std) < 0.5 or not np.all(np.abs(table) > 0.0):
        return None
    frequency = _line(v / middle - 1.0, turning, s, speeds / middle - 1.0)
    digits = [rounded(numbers) for numbers in (speeds, amplitudes, frequency, std)]
    ratios = rounded(table.real) + 1j * rounded(table.imag)
    return ModeShape(digits[0], digits[1], digits[2], ratios, digits[3])


def rounded(table: _F) -> _F:
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


def shape_of(rig: RigParameters, branch: Branch | None = None) -> ModeShape:
    """
    Mode shape from the equations of motion: Appendix B, and the limit cycles.

    Parameters
    ----------
    rig : RigParameters
        The rig.
    branch : Branch, optional
        Its limit cycles: with them the ratio is known by amplitude too.

    Raises
    ------
    ConfigError
        If no mode oscillates between 0.7 and 1.15 times the critical speed.
    """
    speeds = critical_speed(rig) * np.linspace(0.7, 1.15, 10)
    modes = [hunting_mode(rig, float(v)) for v in speeds]
    speed, amplitude = list(speeds), [0.0] * speeds.size
    ratio = [mode.yaw_per_lateral / rig.length_scale for mode in modes]
    frequency = [mode.frequency_hz for mode in modes]
    if branch is not None:
        inside = (branch.speed >= speeds[0]) & (branch.speed <= speeds[-1])
        places = np.flatnonzero(inside)
        for k in places[:: max(1, places.size // (2 * speeds.size))]:
            speed.append(float(branch.speed[k]))
            amplitude.append(float(branch.amplitude[k]))
            ratio.append(cycle_ratio(branch, int(k)))
            frequency.append(float(branch.frequency_hz[k]))
    std = np.full(len(speed), 0.002)
    table = fitted_shape(speed, amplitude, ratio, std, frequency, alike=0.0)
    if table is None:
        raise ConfigError(f'{rig.name}: no mode shape')
    at = [_second(rig, float(v)) for v in table.speeds]
    if any(value is None for value in at):
        return table
    known = [value for value in at if value is not None]
    return ModeShape(
        table.speeds,
        table.amplitudes,
        table.frequency_hz,
        table.ratio,
        table.ratio_std,
        rounded(np.array([value.imag / (2.0 * math.pi) for value, _ in known])),
        rounded(np.array([-value.real for value, _ in known])),
        rounded(np.array([ratio.real for _, ratio in known]))
        + 1j * rounded(np.array([ratio.imag for _, ratio in known])),
    )


def cycle_ratio(branch: Branch, place: int) -> complex:
    """Yaw over lateral phasor of the fundamental of one limit cycle of a branch, rad/m."""
    system, x = branch.system, branch.unknowns[place]
    lateral = system.to_fundamental @ x[: system.points]
    yaw = system.to_fundamental @ x[system.points : 2 * system.points]
    return complex(yaw / lateral) / system.rig.length_scale


def _second(rig: RigParameters, speed: float) -> tuple[complex, complex] | None:
    """Eigenvalue (1/s) and yaw ratio (rad/m) of the second mode; None where it does not turn."""
    values, vectors = np.linalg.eig(Wheelset(rig).linear_matrix(speed))
    turning = np.flatnonzero(values.imag > 1e-6)
    if turning.size < 2:
        return None
    place = int(turning[np.argmin(values[turning].real)])
    value = complex(values[place]) / rig.time_scale
    if not value.real < 0.0:
        return None
    return value, complex(vectors[2, place] / vectors[0, place]) / rig.length_scale
