"""
Escape of the quiet state under noise: the Fokker-Planck equation of the amplitude.

Averaged over a cycle, broadband forcing makes the amplitude A of y a diffusion

    dA = (A s(v, A) + D(A) / A) dt + sqrt(2 D(A)) dW

with s the growth rate of Eq. (24) and D in m^2/s. This is the radius of a phasor
whose two components each diffuse with D(A) in the sense of Ito. In the quiet
state A_rms^2 = 2 D / |s(v, 0)|.

All integrals are one-dimensional, on a grid that is fine where the integrand is:
a call for many amplitudes at one speed takes well under a millisecond.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.errors import ConfigError

Array = NDArray[np.float64]

#: exp of more than this is taken as infinite.
_LARGEST_EXPONENT = 700.0


@dataclass(frozen=True)
class AmplitudeDiffusion:
    """
    Diffusion coefficient of the amplitude, D(A) = quiet exp(slope A^2).

    The exponential keeps D positive at any amplitude and equals
    quiet (1 + slope A^2) where the correction is small.

    Parameters
    ----------
    quiet : float
        D at small amplitude, m^2/s.
    slope : float
        1/m^2; 0 for a diffusion that does not depend on the amplitude.

    Raises
    ------
    ConfigError
        For a value that is not finite, or a negative `quiet`.
    """

    quiet: float
    slope: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.quiet) and self.quiet >= 0.0):
            raise ConfigError(f'diffusion must not be negative, got {self.quiet} m^2/s')
        if not math.isfinite(self.slope):
            raise ConfigError(f'slope of the diffusion must be finite, got {self.slope}')

    def __call__(self, amplitude: ArrayLike) -> Array:
        """Return D in m^2/s at amplitudes in m, any shape."""
        a2 = np.asarray(amplitude, dtype=np.float64) ** 2
        return np.asarray(self.quiet * np.exp(np.clip(self.slope * a2, -50.0, 50.0)))


def diffusion_from_quiet(form: NormalForm, speed: float, amplitude_rms: float) -> float:
    """
    Diffusion that keeps the quiet wheelset at a given rms amplitude, D = |s| A_rms^2 / 2.

    Parameters
    ----------
    form : NormalForm
        In the amplitude coordinate.
    speed : float
        m/s, below v_c.
    amplitude_rms : float
        Root mean square of the amplitude of y (sqrt(2) times the standard
        deviation of y), m.

    Returns
    -------
    float
        m^2/s.

    Raises
    ------
    ConfigError
        At or above v_c, where there is no quiet state.
    """
    rate = float(form.growth_rate(speed))
    if not rate < 0.0:
        raise ConfigError(f'no quiet state at {speed} m/s (v_c = {form.critical_speed} m/s)')
    return -0.5 * rate * amplitude_rms**2


def committor(
    form: NormalForm,
    speed: float,
    amplitude: ArrayLike,
    diffusion: float | AmplitudeDiffusion,
) -> Array:
    """
    Probability that the wheelset ends in the limit cycle before it is quiet again.

    Quiet is the most likely quiet amplitude sqrt(D / |s|), at most half the
    unstable amplitude; the limit cycle counts as reached midway between the
    unstable and the stable amplitude.

    Parameters
    ----------
    form : NormalForm
        In the amplitude coordinate.
    speed : float
        m/s.
    amplitude : array_like, shape (...)
        Amplitude of y, m.
    diffusion : float or AmplitudeDiffusion
        D, m^2/s; 0 gives the step at the unstable amplitude.

    Returns
    -------
    ndarray, shape (...)
        0 where the speed has no limit cycle, 1 where it has no quiet state, NaN
        where the amplitude is NaN.

    Raises
    ------
    ConfigError
        For a negative or non-finite diffusion.

    References
    ----------
    C. W. Gardiner, Handbook of Stochastic Methods (2004), Eq. (5.2.189).
    """
    law = _law(diffusion)
    a = np.asarray(amplitude, dtype=np.float64)
    quiet = float(form.growth_rate(speed)) < 0.0
    unstable, stable = (float(x) for x in form.steady_amplitudes(speed))
    if not quiet or math.isnan(stable) or math.isnan(unstable):
        certain = 1.0 if not quiet and not math.isnan(stable) else 0.0
        return np.where(np.isnan(a), math.nan, certain)
    if law.quiet == 0.0:
        return np.where(np.isnan(a), math.nan, np.heaviside(a - unstable, 0.5))
    floor, roof = _edges(form, speed, law, unstable, stable)
    grid = _grid(form, speed, law, floor, roof, unstable)
    potential = _potential(form, speed, law, grid)
    density = np.exp(potential - potential.max()) / grid
    reached = _cumulative(density, grid)
    probability = np.interp(a, grid, reached / reached[-1], left=0.0, right=1.0)
    return np.asarray(probability, dtype=np.float64)


def mean_escape_time(
    form: NormalForm,
    speed: float,
    diffusion: float | AmplitudeDiffusion,
    amplitude: ArrayLike = 0.0,
) -> Array:
    """
    Mean time until the limit cycle is reached, as `committor` counts it.

    Parameters
    ----------
    form : NormalForm
        In the amplitude coordinate.
    speed : float
        m/s.
    diffusion : float or AmplitudeDiffusion
        D, m^2/s.
    amplitude : array_like, shape (...)
        Amplitude of y to start from, m.

    Returns
    -------
    ndarray, shape (...)
        s; inf where it cannot happen (no limit cycle, or no noise below the
        unstable amplitude) or takes more than about 1e300 s. It is the mean over all
        ends: from above the unstable amplitude it counts the few that fall back first.

    Raises
    ------
    ConfigError
        For a negative or non-finite diffusion.

    References
    ----------
    C. W. Gardiner, Handbook of Stochastic Methods (2004), Eq. (5.2.160).
    """
    law = _law(diffusion)
    a = np.asarray(amplitude, dtype=np.float64)
    unstable, stable = (float(x) for x in form.steady_amplitudes(speed))
    if math.isnan(stable):
        return np.where(np.isnan(a), math.nan, math.inf)
    if math.isnan(unstable):
        if float(form.growth_rate(speed)) < 0.0:
            return np.where(np.isnan(a), math.nan, math.inf)
        unstable = 0.0
    roof = 0.5 * (unstable + stable)
    if law.quiet == 0.0:
        return _time_without_noise(form, speed, a, unstable, roof)
    grid = _grid(form, speed, law, 0.0, roof, unstable)
    potential = _potential(form, speed, law, grid)
    with np.errstate(divide='ignore'):  # log 0 at amplitude 0, where both integrands vanish
        weight = _log_cumulative(np.log(grid / law(grid)) - potential, grid)
        integrand = np.full_like(grid, -math.inf)
        integrand[1:] = potential[1:] + weight[1:] - np.log(grid[1:])
        # From the roof down, so that a short time is not lost beside a long one.
        pieces = np.logaddexp(integrand[1:], integrand[:-1]) + np.log(0.5 * np.diff(grid))
        remaining = np.append(np.logaddexp.accumulate(pieces[::-1])[::-1], -math.inf)
        exponent = _between(a, grid, remaining)
    huge = exponent > _LARGEST_EXPONENT
    return np.where(huge, math.inf, np.exp(np.where(huge, 0.0, exponent)))


def _law(diffusion: float | AmplitudeDiffusion) -> AmplitudeDiffusion:
    if isinstance(diffusion, AmplitudeDiffusion):
        return diffusion
    return AmplitudeDiffusion(float(diffusion))


def _edges(
    form: NormalForm, speed: float, law: AmplitudeDiffusion, unstable: float, stable: float
) -> tuple[float, float]:
    quiet = math.sqrt(law.quiet / -float(form.growth_rate(speed)))
    return min(quiet, 0.5 * unstable), 0.5 * (unstable + stable)


def _grid(
    form: NormalForm,
    speed: float,
    law: AmplitudeDiffusion,
    floor: float,
    roof: float,
    unstable: float,
) -> Array:
    """Amplitudes from floor to roof, dense about the quiet state and the unstable cycle."""
    parts = [np.linspace(floor, roof, 257)]
    quiet_rate = abs(float(form.growth_rate(speed)))
    for centre, rate in ((0.0, quiet_rate), (unstable, _radial_rate(form, speed, unstable))):
        if rate > 0.0:
            width = math.sqrt(float(law(centre)) / rate)
            parts.append(centre + width * np.linspace(-8.0, 8.0, 257))
            if width < roof:  # growth from there is even in the logarithm
                parts.append(centre + np.geomspace(width, roof, 513))
    grid = np.concatenate(parts)
    return np.unique(grid[(grid >= floor) & (grid <= roof)])


def _radial_rate(form: NormalForm, speed: float, amplitude: float) -> float:
    """d(A s)/dA at a cycle: its Floquet exponent, 1/s."""
    step = 1e-6 * max(amplitude, 1e-9)
    above, below = form.growth_rate(speed, [amplitude + step, amplitude - step])
    return amplitude * float(above - below) / (2.0 * step)


def _potential(form: NormalForm, speed: float, law: AmplitudeDiffusion, grid: Array) -> Array:
    """-Integral of A s / D over the grid, by Simpson's rule on each interval."""
    middle = 0.5 * (grid[1:] + grid[:-1])
    at = -grid * form.growth_rate(speed, grid) / law(grid)
    between = -middle * form.growth_rate(speed, middle) / law(middle)
    steps = np.diff(grid) / 6.0 * (at[1:] + 4.0 * between + at[:-1])
    return np.concatenate([[0.0], np.cumsum(steps)])


def _cumulative(values: Array, grid: Array) -> Array:
    """Trapezoidal integral from the first point, shape of the grid."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(grid))])


def _log_cumulative(logarithms: Array, grid: Array) -> Array:
    """
    Logarithm of the integral, from the first point, of a function given by its logarithm.

    The logarithm is taken as linear between the points, because with little noise the
    function changes by orders of magnitude from one to the next; nothing overflows.
    """
    low, high = np.sort([logarithms[1:], logarithms[:-1]], axis=0)
    drop = np.maximum(high - low, 1e-12)
    pieces = high + np.log(-np.expm1(-drop) / drop)
    pieces[0] = np.logaddexp(*logarithms[:2]) - math.log(2.0)  # from amplitude 0: linear
    pieces += np.log(np.diff(grid))
    return np.concatenate([[-math.inf], np.logaddexp.accumulate(pieces)])


def _between(amplitude: Array, grid: Array, logarithms: Array) -> Array:
    """Interpolate logarithms that end in -inf: linearly, in the last interval their values."""
    inner = np.interp(amplitude, grid[:-1], logarithms[:-1])
    share = (grid[-1] - amplitude) / (grid[-1] - grid[-2])
    outer = logarithms[-2] + np.log(np.clip(share, 0.0, 1.0))
    return np.asarray(np.where(amplitude > grid[-2], outer, inner), dtype=np.float64)


def _time_without_noise(
    form: NormalForm, speed: float, amplitude: Array, unstable: float, roof: float
) -> Array:
    """Deterministic time from above the unstable amplitude to the roof."""
    times = [
        0.0
        if a >= roof
        else form.time_between(speed, a, roof)
        if a > unstable
        else math.nan
        if math.isnan(a)
        else math.inf
        for a in np.ravel(amplitude)
    ]
    return np.reshape(np.array(times), amplitude.shape)
