"""
Poincare section once a roller revolution, and its classification (Figs. 5, 7).

Roughness forces the wheelset with the period of the roller. Seen once a revolution,
a response to it is one point, a hunting wheelset a closed curve: the maps either side
of v_c. Noise makes the point a cloud and the curve a ring; they are told apart by what holds
the distance from the centre: close to v_c the noise itself moves the quiet
wheelset on a slowly changing circle, which a short record cannot tell from a ring by its shape.
Without a roller there is no forcing to keep time with, and the motion is cut at a phase of
its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.analysis.phase_portrait import PhasePortrait, phase_portrait
from hunt_ros.analysis.steady_state import standard_error
from hunt_ros.analysis.uniform import checked
from hunt_ros.errors import IdentificationError

Kind = Literal['periodic', 'quasi-periodic', 'noise-driven', 'transient', 'undecided']
Cut = Literal['revolution', 'hunting']
#: What holds the radius of a section.
Law = Literal['noise', 'cycle', 'transient', 'undecided']

#: Spread of a section, relative to the orbit, that passes for one sharp point.
SHARP = 0.02

#: Spread from which noise, not the roller, moves the wheelset: half the power.
MOSTLY_NOISE = 0.7

#: Points averaged to one amplitude: the noise of the sensor and the shape of the curve cancel,
#: and the radius has not changed yet.
AVERAGED = 4
#: Fewest points that a kind is told from.
FEWEST = 30

#: Fewest independent radii that tell noise from a limit cycle: the spread is known to a quarter.
LEAST_RADII = 10
#: Spread of a radius over its mean where noise drives the motion: sqrt(4 / pi - 1).
RAYLEIGH = 0.523
#: A radius that noise makes moves by more than this within a hundredth of its memory.
STILL = 0.1
#: Change of ln of the radius that is growth or decay.
GROWN = 0.5

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
        too little evidence).
    period : int
        Revolutions (or hunting cycles) after which a periodic orbit closes; 0 for the rest.
    spread : float
        Size of the section over that of the whole orbit: small for a sharp point.
    cut : 'revolution' or 'hunting'
        Once a revolution of the roller, or once a cycle of the motion itself.
    """

    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    kind: Kind
    period: int
    spread: float
    cut: Cut


def poincare_section(
    values: ArrayLike, rate_hz: float, roller_angle: ArrayLike
) -> PoincareSection:
    """
    Cut the orbit once a roller revolution and say what the section is.

    Parameters
    ----------
    values : array_like, shape (n,)
        Uniform samples of y, m (or psi, rad) in a steady state.
    rate_hz : float
        Sample rate, Hz.
    roller_angle : array_like, shape (n,)
        Continuous angle of the roller, rad.

    Raises
    ------
    IdentificationError
        For fewer than four revolutions.

    References
    ----------
    The paper, Sect. 2.4, Figs. 5 and 7.
    """
    array = checked(values, 64, 'Poincare section')
    portrait = phase_portrait(array, rate_hz)
    angle = checked(roller_angle, array.size, 'roller angle')
    inside = slice(portrait.first, portrait.first + portrait.displacement.size)
    turns = angle[inside] / (2.0 * math.pi)
    if turns.size and turns[-1] < turns[0]:
        turns = -turns
    whole = np.arange(math.ceil(turns[0]), math.floor(turns[-1]) + 1)
    if whole.size < 4:
        raise IdentificationError(
            f'Poincare section: {whole.size} roller revolutions, expected at least 4'
        )
    rising = np.maximum.accumulate(turns)
    place = np.interp(whole, rising, np.arange(turns.size))
    return _section(portrait, place, 'revolution')


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
    return _section(portrait, place, 'hunting', later)


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


def _section(
    portrait: PhasePortrait, place: NDArray[np.float64], cut: Cut, later: float = 0.0
) -> PoincareSection:
    """Cut an orbit at these places, in samples, its displacement `later`; say what is seen."""
    count = np.arange(portrait.displacement.size)
    displacement = np.interp(place + later, count, portrait.displacement)
    velocity = np.interp(place, count, portrait.velocity)
    scale = np.array([np.std(portrait.displacement), np.std(portrait.velocity)])
    scale[scale == 0.0] = 1.0
    points = np.stack([displacement, velocity], axis=1) / scale
    centred = points - points.mean(axis=0)
    spread = math.sqrt(float(np.mean(np.sum(centred**2, axis=1))) / 2.0)
    closed = 1 if spread < SHARP else _closing(centred)
    if closed:
        return PoincareSection(displacement, velocity, 'periodic', closed, spread, cut)
    kinds: dict[Law, Kind] = {'transient': 'transient', 'undecided': 'undecided'}
    if cut == 'revolution':
        kinds |= {'cycle': 'quasi-periodic', 'noise': 'periodic'}
        turning = np.zeros(len(points), dtype=np.complex128)
        values, axes = np.linalg.eigh(centred.T @ centred / len(points))
        if values[0] > 1e-12 * max(values[1], 1e-300):
            # The sign of an axis only mirrors the points, which changes nothing below.
            first, second = (centred @ axes / np.sqrt(values)).T
            turning = first + 1j * second
    else:
        kinds |= {'cycle': 'periodic', 'noise': 'noise-driven'}
        # A cycle that comes late has turned back against one that keeps the mean time.
        steps = np.arange(place.size)
        slip = place - np.polyval(np.polyfit(steps, place, 1), steps)
        turning = np.abs(displacement) * np.exp(
            -2j * math.pi * slip / float(np.median(np.diff(place)))
        )
    law = _law(turning)
    kind = kinds[law]
    if law == 'noise' and spread > MOSTLY_NOISE:
        kind = 'noise-driven'
    return PoincareSection(displacement, velocity, kind, int(kind == 'periodic'), spread, cut)


def _turn(white: NDArray[np.complex128]) -> float:
    """Mean angle from one point to the next, rad."""
    steps = np.exp(1j * np.diff(np.angle(white)))
    return float(np.angle(np.mean(steps)))


def _law(turning: NDArray[np.complex128]) -> Law:
    """
    What holds the radius of points that turn steadily.

    The radius of what noise drives has a spread of 0.52 of its mean (Rayleigh), once the record
    holds several of its independent values; a limit cycle's is smaller, a transient's is a line
    in its logarithm.
    """
    if turning.size < FEWEST:
        return 'undecided'
    still = turning * np.exp(-1j * _turn(turning) * np.arange(turning.size))
    size = min(AVERAGED, turning.size // LEAST_RADII)
    radius = np.abs(still[: still.size // size * size].reshape(-1, size).mean(axis=1))
    spread = float(np.std(radius) / np.mean(radius))
    steps, logs = np.arange(radius.size), np.log(np.maximum(radius, 1e-12))
    line = np.polyfit(steps, logs, 1)
    change = abs(float(line[0])) * radius.size
    if change > GROWN and float(np.std(logs - np.polyval(line, steps))) < 0.1 * change:
        return 'transient'
    if spread > 0.5 * RAYLEIGH:
        return 'noise'
    independent = float(np.var(radius)) / max(standard_error(radius), 1e-300) ** 2
    return 'cycle' if spread < STILL or independent > LEAST_RADII else 'undecided'


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
