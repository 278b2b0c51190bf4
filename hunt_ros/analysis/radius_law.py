"""
What holds the radius of an oscillation: noise, a limit cycle, or nothing yet.

Near v_c the quiet wheelset answers noise on a circle that changes slowly, and a record of
half a minute may hold no more than a few of its independent amplitudes: it may look like a
limit cycle, or like a decay. So that the length of the record counts, three laws of the
radius are compared by their evidence, each with the density of every radius given the one
before, seen through the white noise of a sensor:

- noise drives a damped linear oscillator, and the radius is as large as the noise makes it:
  Rice's density, begun from Rayleigh's;
- a limit cycle draws the radius back to its own size, from which noise moves it a little;
- a transient grows or decays at a constant rate from a radius that noise did not make.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import lfilter
from scipy.special import expit, i0e

Law = Literal['noise', 'cycle', 'transient', 'undecided']

#: A transient may begin at any radius within this many e-foldings, each as likely.
START_FOLDINGS = 7.0
#: Noise is always there: another law is called where it has odds of 20 to 1 (strong, Kass and
#: Raftery 1995), and noise where no other has 3 to 1 (worth a mention).
STRONG, MENTIONED = math.log(20.0), math.log(3.0)
#: Fewest radii to tell anything from.
FEWEST = 12

#: Least and largest logarithm of a noise power a step, in the mean square radius.
_POWER = (-30.0, 3.0)
#: Minus the logarithm of the likelihood of what cannot be.
_NEVER = 1e12
#: Range of the logit of a gain.
_GAIN = (-5.0, 8.0)
#: Logits of memory and gain that the search for a limit cycle begins at.
_STARTS = ((0.0, 2.0), (3.0, 0.0))

_F = NDArray[np.float64]
_C = NDArray[np.complex128]


@dataclass(frozen=True)
class RadiusLaw:
    """
    What holds the radius.

    Parameters
    ----------
    law : str
        'undecided' where the evidence is not enough, or for few radii.
    cycle_odds : float
        Natural logarithm of the odds of a limit cycle against the better of the others.
    transient_odds : float
        The same of a transient against noise.
    """

    law: Law
    cycle_odds: float
    transient_odds: float


def radius_law(amplitude: NDArray[np.complex128]) -> RadiusLaw:
    """
    Compare the three laws on what turns slowly: the demodulated motion.

    Parameters
    ----------
    amplitude : ndarray, shape (n,)
        Of any unit, at equal steps of time, which are shorter than the memory of the radius.

    References
    ----------
    Rice 1945, Bell Syst. Tech. J. 24, 46; Schwarz 1978, Ann. Statist. 6, 461.
    """
    power = float(np.mean(np.abs(amplitude) ** 2))
    if amplitude.size < FEWEST or not power > 0.0:
        return RadiusLaw('undecided', 0.0, 0.0)
    z = amplitude / math.sqrt(power)
    r = np.maximum(np.abs(z), 1e-6)
    step = math.log(max(float(np.mean(np.abs(np.diff(z)) ** 2)), 1e-12))
    rate = float(np.polyfit(np.arange(r.size), np.log(r), 1)[0])
    deviation = math.log(max(float(r.std()), 1e-6))
    linear = (_POWER, _GAIN)
    # Noise that did not remake the radius within the record did not make it either.
    damping = (-math.log(r.size), 2.0)
    noise = _evidence(_noise, z, [(-3.0, step, 2.0), (-1.0, step, 0.0)], (damping, *linear))
    transient = _evidence(
        _transient, z, [(rate, step, 2.0), (0.0, step, 0.0)], ((-2.0, 2.0), *linear)
    )
    cycle = _evidence(
        _cycle,
        z,
        [(float(r.mean()), memory, 2.0 * deviation, gain) for memory, gain in _STARTS],
        ((0.01, 3.0), (-8.0, 8.0), *linear),
    )
    cycle_odds, transient_odds = cycle - max(noise, transient), transient - noise
    law: Law = 'undecided'
    if max(cycle, transient) - noise < MENTIONED:
        law = 'noise'
    elif cycle_odds > STRONG:
        law = 'cycle'
    elif transient - max(cycle, noise) > STRONG:
        law = 'transient'
    return RadiusLaw(law, cycle_odds, transient_odds)


def _evidence(
    cost: Callable[[_F, _C], float],
    z: _C,
    starts: Sequence[tuple[float, ...]],
    bounds: Sequence[tuple[float, float]],
) -> float:
    """Logarithm of the evidence of a law, by its greatest likelihood (Schwarz)."""
    least = math.inf
    for start in starts:
        inside = np.clip(start, *np.transpose(bounds))
        least = min(least, float(minimize(cost, inside, (z,), 'L-BFGS-B', bounds=bounds).fun))
    return -least - 0.5 * len(bounds) * math.log(z.size)


def _predicted(x: NDArray[Any], memory: float, gain: float) -> NDArray[Any]:
    """
    What a first-order process, seen through white noise, will be at the next step.

    `gain` is the share of a surprise that is believed: 1 where there is no such noise.
    """
    kept = memory * (1.0 - gain)
    begin = np.array([kept * x[0]])  # the first value is all that is known of it
    ahead: NDArray[Any] = lfilter([memory * gain], [1.0, -kept], x[:-1], zi=begin)[0]
    return ahead


def _rice(z: _C, factor: float, power: float, gain: float) -> float:
    """Sum of the log densities of each radius, given the amplitudes before it."""
    centre, x = np.abs(_predicted(z, factor, gain)), np.maximum(np.abs(z[1:]), 1e-6)
    with np.errstate(over='ignore', divide='ignore', invalid='ignore'):  # a growth far too fast
        bessel = np.log(i0e(2.0 * x * centre / power))
        density = float(np.sum(np.log(2.0 * x / power) - (x - centre) ** 2 / power + bessel))
    return density if math.isfinite(density) else -_NEVER


def _noise(p: _F, z: _C) -> float:
    """Damping a step exp(p0), power of a surprise exp(p1), gain logistic(p2)."""
    damping, power, gain = math.exp(p[0]), math.exp(p[1]), float(expit(p[2]))
    factor = math.exp(-damping)
    stationary = power * (1.0 + (factor * gain) ** 2 / -math.expm1(-2.0 * damping))
    first = max(abs(complex(z[0])), 1e-6)
    start = math.log(2.0 * first / stationary) - first**2 / stationary
    return -start - _rice(z, factor, power, gain)


def _transient(p: _F, z: _C) -> float:
    """Growth a step p0, power of a surprise exp(p1), gain logistic(p2)."""
    first = max(abs(complex(z[0])), 1e-6)
    gain = float(expit(p[2]))
    return math.log(START_FOLDINGS * first) - _rice(z, math.exp(p[0]), math.exp(p[1]), gain)


def _cycle(p: _F, z: _C) -> float:
    """Radius p0, memory logistic(p1) a step, variance of a surprise exp(p2), gain logistic(p3)."""
    memory, shock, gain = float(expit(p[1])), math.exp(p[2]), float(expit(p[3]))
    away = np.abs(z) - p[0]
    variance = shock * (1.0 + (memory * gain) ** 2 / (1.0 - memory**2))
    left = away[1:] - _predicted(away, memory, gain)
    start = math.log(2.0 * math.pi * variance) + away[0] ** 2 / variance
    rest = left.size * math.log(2.0 * math.pi * shock) + float(np.sum(left**2)) / shock
    return 0.5 * float(start + rest)
