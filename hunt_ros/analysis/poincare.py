"""
Poincare section once a roller revolution, and its classification (Figs. 5, 7).

Roughness forces the wheelset with the period of the roller. Seen once a revolution,
a response to it is one point, a hunting wheelset a closed curve: the maps either side
of v_c. Noise makes the point a cloud and the curve a ring; they are told apart by how
the distance from the centre is distributed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.analysis.phase_portrait import phase_portrait
from hunt_ros.analysis.spectrum import roughness_frequency
from hunt_ros.analysis.uniform import checked
from hunt_ros.errors import IdentificationError

Kind = Literal['periodic', 'quasi-periodic', 'transient', 'undecided']

#: Mean fourth power of the whitened distance: 8 for a Gaussian cloud, 4 for a ring (Mardia).
CLOUD, RING = 8.0, 4.0

#: Spread of a section, relative to the orbit, that passes for one sharp point.
SHARP = 0.02

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
        drives the wheelset too), 'quasi-periodic' (a closed curve),
        'transient' (the radius grows or decays), 'undecided' (too few revolutions, or
        neither point nor curve).
    period : int
        Revolutions after which a periodic orbit closes; 0 for the rest.
    ring : float
        0 for a Gaussian cloud, 1 for a ring; how sure the kind is.
    ring_std : float
        Its standard deviation.
    rotation_number : float
        Turns of the curve a revolution, in [0, 1/2]: the distance of f_h/f_r from the
        nearest whole number; NaN for a point.
    spread : float
        Size of the section over that of the whole orbit: small for a sharp point.
    """

    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    kind: Kind
    period: int
    ring: float
    ring_std: float
    rotation_number: float
    spread: float


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


def _classified(
    displacement: NDArray[np.float64],
    velocity: NDArray[np.float64],
    orbit: NDArray[np.float64],
    orbit_velocity: NDArray[np.float64],
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
        kind = _kind(ring, ring_std, distance)
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


def _kind(ring: float, ring_std: float, distance: NDArray[np.float64]) -> Kind:
    """Decide between a cloud about a point, a closed curve and a spiral."""
    count = distance.size
    if count < 30:
        return 'undecided'
    time = np.arange(count) / count
    logarithm = 0.5 * np.log(np.maximum(distance, 1e-12))
    slope, height = np.polyfit(time, logarithm, 1)
    # The radius of a cloud scatters by 0.6 in its logarithm, that of a spiral by its noise.
    if abs(slope) > 0.5 and float(np.std(logarithm - slope * time - height)) < 0.3:
        return 'transient'
    if ring < 0.5:
        return 'periodic' if ring + ring_std < 0.6 else 'undecided'
    return 'quasi-periodic' if ring - ring_std > 0.4 else 'undecided'


def _block_std(values: NDArray[np.float64], blocks: int = 10) -> float:
    """Standard deviation of the mean of a correlated sequence, by the means of blocks."""
    parts = np.array_split(values, min(blocks, max(values.size // 4, 2)))
    means = np.array([part.mean() for part in parts])
    return float(np.std(means, ddof=1)) / math.sqrt(means.size)
