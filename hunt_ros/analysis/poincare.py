"""
Poincare section once a roller revolution, and its classification (Figs. 5, 7).

Roughness forces the wheelset with the period of the roller. Seen once a revolution,
a response to it is one point, a hunting wheelset a closed curve: the maps either side
of v_c. Noise makes the point a cloud and the curve a ring; they are told apart by how
the distance from the centre is distributed. Close to v_c the noise itself moves the quiet
wheelset on a slowly changing circle: its radius wanders, that of a limit cycle does not.
Without a roller there is no forcing to keep time with, and the motion is cut at a phase of
its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.analysis.phase_portrait import phase_portrait
from hunt_ros.analysis.spectrum import roughness_frequency
from hunt_ros.analysis.uniform import checked
from hunt_ros.errors import IdentificationError

Kind = Literal['periodic', 'quasi-periodic', 'noise-driven', 'transient', 'undecided']
Cut = Literal['revolution', 'hunting']

#: Mean fourth power of the whitened distance: 8 for a Gaussian cloud, 4 for a ring (Mardia).
CLOUD, RING = 8.0, 4.0

#: Spread of a section, relative to the orbit, that passes for one sharp point.
SHARP = 0.02

#: Deviation of the logarithm of the radius, given the angle, from which it wanders as noise
#: does: 0.64 for a Gaussian cloud, 0.3 or more close to v_c, 0.04 or less on a limit cycle.
WANDERING = 0.15

#: Spread from which noise, not the roller, moves the wheelset: half the power.
MOSTLY_NOISE = 0.7
#: The same cut once a cycle: 0.6 for Rayleigh's amplitude, of which the half.
OWN_MOSTLY_NOISE = 0.3

#: Longest period, in revolutions, of a locked orbit that is told from a closed curve.
LONGEST_PERIOD = 8


@dataclass(frozen=True, eq=False)
class PoincareSection:
    """
    Points of the section, and what they are.

    Parameters
    ----------
    displacement, velocity : ndarray, shape (n,)
        m and m/s, one point a revolution.
    kind : str
        'periodic' (a point, or a few: see `period`; a cloud about it where broadband noise
        drives the wheelset too), 'quasi-periodic' (a closed curve), 'noise-driven' (neither:
        most of the motion is the answer to broadband noise),
        'transient' (the radius grows or decays), 'undecided' (too few revolutions, or
        neither point nor curve).
    period : int
        Revolutions (or hunting cycles) after which a periodic orbit closes; 0 for the rest.
    ring : float
        0 for a Gaussian cloud, 1 for a ring; how sure the kind is.
    ring_std : float
        Its standard deviation.
    rotation_number : float
        Turns of the curve a revolution, in [0, 1/2]: the distance of f_h/f_r from the
        nearest whole number; NaN for a point.
    spread : float
        Size of the section over that of the whole orbit: small for a sharp point.
    cut : 'revolution' or 'hunting'
        Once a revolution of the roller, or once a cycle of the motion itself.
    """

    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    kind: Kind
    period: int
    ring: float
    ring_std: float
    rotation_number: float
    spread: float
    cut: Cut = 'revolution'


def poincare_section(
    values: ArrayLike,
    rate_hz: float,
    roller_angle: ArrayLike | None = None,
    speed: float = math.nan,
    roller_diameter_m: float = 0.3,
    phase: float = 0.0,
) -> PoincareSection:
    """
    Cut the orbit once a roller revolution and say what the section is.

    Parameters
    ----------
    values : array_like, shape (n,)
        Uniform samples of y, m (or psi, rad) in a steady state.
    rate_hz : float
        Sample rate, Hz.
    roller_angle : array_like, shape (n,), optional
        Continuous angle of the roller, rad. Without it the revolutions are counted from
        `speed` and the time, Eq. (1).
    speed : float
        Running speed, m/s.
    roller_diameter_m : float
        D, m.
    phase : float
        Roller angle of the section, rad.

    Raises
    ------
    IdentificationError
        Without angle and speed, or with fewer than four revolutions.

    References
    ----------
    The paper, Sect. 2.4, Figs. 5 and 7. Mardia 1970, Biometrika 57, 519-530 (kurtosis).
    """
    array = checked(values, 64, 'Poincare section')
    portrait = phase_portrait(array, rate_hz)
    if roller_angle is not None:
        angle = checked(roller_angle, array.size, 'roller angle')
    elif math.isfinite(speed) and speed > 0.0:
        turn = 2.0 * math.pi * roughness_frequency(speed, roller_diameter_m)
        angle = np.asarray(np.arange(array.size) * turn / rate_hz, dtype=np.float64)
    else:
        raise IdentificationError('Poincare section: expected a roller angle or a speed')
    inside = slice(portrait.first, portrait.first + portrait.displacement.size)
    turns = (angle[inside] - phase) / (2.0 * math.pi)
    if turns.size and turns[-1] < turns[0]:
        turns = -turns
    whole = np.arange(math.ceil(turns[0]), math.floor(turns[-1]) + 1)
    if whole.size < 4:
        raise IdentificationError(
            f'Poincare section: {whole.size} roller revolutions, expected at least 4'
        )
    rising = np.maximum.accumulate(turns)
    place = np.interp(whole, rising, np.arange(turns.size))
    count = np.arange(turns.size)
    displacement = np.interp(place, count, portrait.displacement)
    velocity = np.interp(place, count, portrait.velocity)
    return _classified(displacement, velocity, portrait.displacement, portrait.velocity)


def own_section(
    values: ArrayLike, rate_hz: float, yaw: ArrayLike | None = None
) -> PoincareSection:
    """
    Cut the orbit once a cycle of its own, where there is no roller to cut it at.

    A limit cycle that nothing forces closes after one cycle, and its section is a point.

    Parameters
    ----------
    values : array_like, shape (n,)
        Uniform samples of y, m, in a steady state.
    rate_hz : float
        Sample rate, Hz.
    yaw : array_like, shape (n,), optional
        psi, rad: the cut is where it rises through its mean. Without it the cut is where y
        does, and the displacement of a point is y a quarter of a cycle later.

    Raises
    ------
    IdentificationError
        For fewer than four cycles.
    """
    array = checked(values, 64, 'Poincare section')
    portrait = phase_portrait(array, rate_hz)
    trigger = portrait
    if yaw is not None:
        trigger = phase_portrait(checked(yaw, array.size, 'yaw'), rate_hz)
    place = _rising(trigger.displacement)
    if place.size < 4:
        raise IdentificationError(f'Poincare section: {place.size} cycles, expected at least 4')
    later = 0.25 * float(np.median(np.diff(place))) if yaw is None else 0.0
    place = place[place + later <= portrait.displacement.size - 1]
    count = np.arange(portrait.displacement.size)
    displacement = np.interp(place + later, count, portrait.displacement)
    velocity = np.interp(place, count, portrait.velocity)
    orbit = portrait.displacement, portrait.velocity
    found = _classified(displacement, velocity, *orbit, OWN_MOSTLY_NOISE)
    return replace(found, cut='hunting', rotation_number=math.nan)


def _rising(signal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places, in samples, at which a signal rises through zero; one a cycle."""
    below = signal[:-1] < 0.0
    crossing = np.flatnonzero(below & (signal[1:] >= 0.0))
    if crossing.size < 2:
        return crossing.astype(np.float64)
    # Ripple crosses again at once: the cycle is the middle distance of the long ones.
    steps = np.diff(crossing)
    cycle = float(np.median(steps[steps >= 0.5 * np.percentile(steps, 90.0)]))
    kept = [int(crossing[0])]
    for place in crossing[1:].tolist():
        if place - kept[-1] > 0.5 * cycle:
            kept.append(place)
    at = np.array(kept)
    return np.asarray(at - signal[at] / (signal[at + 1] - signal[at]))


def _classified(
    displacement: NDArray[np.float64],
    velocity: NDArray[np.float64],
    orbit: NDArray[np.float64],
    orbit_velocity: NDArray[np.float64],
    noise_from: float = MOSTLY_NOISE,
) -> PoincareSection:
    scale = np.array([np.std(orbit), np.std(orbit_velocity)])
    scale[scale == 0.0] = 1.0
    points = np.stack([displacement, velocity], axis=1) / scale
    centred = points - points.mean(axis=0)
    spread = math.sqrt(float(np.mean(np.sum(centred**2, axis=1))) / 2.0)
    count = len(points)
    values, axes = np.linalg.eigh(centred.T @ centred / count)
    ring, ring_std, rotation, period = 0.0, math.inf, math.nan, 0
    kind: Kind = 'undecided'
    closed = 1 if spread < SHARP else _closing(centred)
    if values[0] > 1e-12 * max(values[1], 1e-300):
        white = centred @ axes / np.sqrt(values)
        distance = np.sum(white**2, axis=1)
        ring = (CLOUD - float(np.mean(distance**2))) / (CLOUD - RING)
        ring_std = _block_std(distance**2) / (CLOUD - RING)
        steps = np.diff(np.angle(white[:, 0] + 1j * white[:, 1]))
        rotation = abs(float(np.angle(np.mean(np.exp(1j * steps))))) / (2.0 * math.pi)
        kind = _kind(ring, ring_std, white, spread > noise_from)
    if closed:
        kind, period = 'periodic', closed
    elif kind == 'periodic':
        period = 1
    if period == 1:
        rotation = math.nan
    return PoincareSection(displacement, velocity, kind, period, ring, ring_std, rotation, spread)


def _closing(centred: NDArray[np.float64]) -> int:
    """
    Revolutions after which the orbit comes back to the same few points; 0 where it does not.

    Every n-th point must stay in its own small cloud through the whole record: on a closed
    curve with a nearly rational rotation number it would drift along the curve.
    """
    size = float(np.mean(np.sum(centred**2, axis=1)))
    for period in range(2, min(LONGEST_PERIOD, len(centred) // 6) + 1):
        clouds = [centred[start::period] for start in range(period)]
        if sum(float(np.sum(np.var(cloud, axis=0))) for cloud in clouds) / period < 0.05 * size:
            return period
    return 0


def _kind(ring: float, ring_std: float, white: NDArray[np.float64], wide: bool) -> Kind:
    """Decide between a cloud about a point, a closed curve, a spiral and noise."""
    distance = np.sum(white**2, axis=1)
    count = distance.size
    if count < 30:
        return 'undecided'
    time = np.arange(count) / count
    logarithm = 0.5 * np.log(np.maximum(distance, 1e-12))
    slope, height = np.polyfit(time, logarithm, 1)
    # The radius of a cloud scatters by 0.6 in its logarithm, that of a spiral by its noise.
    if abs(slope) > 0.5 and float(np.std(logarithm - slope * time - height)) < 0.3:
        return 'transient'
    if _wandering(white, logarithm - slope * time - height) > WANDERING:
        return 'noise-driven' if wide else 'periodic'
    return 'quasi-periodic' if ring - ring_std > 0.4 else 'undecided'


def _wandering(white: NDArray[np.float64], logarithm: NDArray[np.float64]) -> float:
    """Deviation of the logarithmic radius from a closed curve, which may be no ellipse."""
    angle = np.arctan2(white[:, 1], white[:, 0])
    harmonics = range(1, 1 + min(3, (len(white) - 10) // 8))
    columns = [np.ones(len(white))]
    for k in harmonics:
        columns += [np.cos(k * angle), np.sin(k * angle)]
    basis = np.stack(columns, axis=1)
    left = logarithm - basis @ np.linalg.lstsq(basis, logarithm, rcond=None)[0]
    return float(np.sqrt(np.sum(left**2) / (len(white) - basis.shape[1])))


def _block_std(values: NDArray[np.float64], blocks: int = 10) -> float:
    """Standard deviation of the mean of a correlated sequence, by the means of blocks."""
    parts = np.array_split(values, min(blocks, max(values.size // 4, 2)))
    means = np.array([part.mean() for part in parts])
    return float(np.std(means, ddof=1)) / math.sqrt(means.size)
