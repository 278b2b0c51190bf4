"""
Mean amplitude under random forcing: what a plateau shows where noise blurs its state.

Forced motion dz = z g dt + sqrt(Q) dW has an amplitude that wanders, and whose mean is not
the amplitude at which the growth vanishes: close to a critical speed, where the state holds
it weakly, it may be half as large again, and below a soft onset it is not zero.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from hunt_ros.dynamics.growth_law import TERMS, GrowthLaw

Array = NDArray[np.float64]

#: Points of the density, and its half width in linear standard deviations.
_POINTS, _HALF_WIDTH = 1201, 8.0
#: Largest amplitude that is looked at, in units of A_ref.
_LARGEST = 3.0


def forcing(noise: Array, u: Array | float, w: Array) -> Array:
    """
    Strength Q of the forcing, as the path likelihood has it.

    Parameters
    ----------
    noise : ndarray, shape (5,)
        d ln Q / du, d ln Q / dw, ln Q, and two that are not forcing.
    u : float or ndarray, shape (n,)
        v / v_ref - 1.
    w : ndarray, shape (n,)
        (A / A_ref)^2.

    Returns
    -------
    ndarray, shape (n,)
        A_ref^2 / s, of each part of the phasor.
    """
    push: Array = np.exp(
        np.clip(noise[2] + noise[0] * u + noise[1] * np.minimum(w, 2.0), -40.0, 10.0)
    )
    return push


def stationary_amplitude(
    law: GrowthLaw, noise: Array, speed: Array, line: Array
) -> tuple[Array, Array]:
    """
    Amplitude of the limit cycle under the forcing; of the quiet state without one.

    Parameters
    ----------
    law : GrowthLaw
        Growth of the amplitude; one law, or one for each speed.
    noise : ndarray, shape (5,)
        As at the end of the fit's parameters.
    speed, line : ndarray, shape (n,)
        m/s, and power B^2 of the line forced by the roller, m^2.

    Returns
    -------
    mean, std : ndarray, shape (n,)
        Of the amplitude as it wanders, m; NaN where the law bounds no motion.

    References
    ----------
    Risken, H., The Fokker-Planck Equation (1989), Sect. 5.2: p ~ (A / Q) exp(2 int A g / Q dA),
    here within the basin of the state.
    """
    unit = law.scales.amplitude
    laws = [replace(law, p=p) for p in np.broadcast_to(law.p, (speed.size, TERMS))]
    found = np.array(
        [_moments(*one, noise) for one in zip(laws, speed.tolist(), line.tolist(), strict=True)]
    ).reshape(-1, 2)
    return unit * found[:, 0], unit * found[:, 1]


def _moments(law: GrowthLaw, speed: float, line: float, noise: Array) -> tuple[float, float]:
    """Mean and standard deviation at one speed, in units of A_ref."""
    u, unit = float(law.detuning(speed)), law.scales.amplitude
    unstable, stable = (float(one[0]) / unit for one in law.steady_amplitudes(speed, line))

    def growth(a: Array) -> Array:
        """Return the growth rate at an amplitude."""
        return law.growth_rate(speed, a * unit, line)

    hunts = math.isfinite(stable)
    centre = stable if hunts else 0.0
    near = centre * np.array([1.0 - 1e-4, 1.0 + 1e-4])
    slope = float(np.diff(growth(near))[0]) / 2e-4 if hunts else float(growth(near[:1])[0])
    if not hunts and slope >= 1e-3:
        return math.nan, math.nan
    width = math.sqrt(float(forcing(noise, u, np.array(centre**2))) / (2.0 * max(-slope, 1e-3)))
    low = max(centre - _HALF_WIDTH * width, 1e-9)
    high = min(centre + _HALF_WIDTH * width, max(_LARGEST, 1.01 * centre))
    if hunts and math.isfinite(unstable) and unstable < stable:
        low = max(low, unstable)
    elif not hunts and math.isfinite(unstable):
        high = min(high, unstable)
    a = np.linspace(low, high, _POINTS)
    rate = growth(a)
    # Beyond the next zero of the growth a law that runs away has no say.
    beyond = np.flatnonzero((a > centre) & (rate > 0.0) & (a > 1.001 * centre))
    end = int(beyond[0]) if beyond.size else a.size
    if end < 3:
        return math.nan, math.nan
    a, rate = a[:end], rate[:end]
    push = forcing(noise, u, a**2)
    potential = cumulative_trapezoid(2.0 * a * rate / push, a, initial=0.0)
    density = a / push * np.exp(potential - potential.max())
    density /= density.sum()
    mean = float(density @ a)
    return mean, math.sqrt(float(density @ (a - mean) ** 2))
