"""
The jumps of a swept experiment: when the loop is left, going up and coming down.

With the speed moving, the Fokker-Planck equation of the amplitude (see `escape`) is
solved in time, so that noise (which makes the jump early), the rate (which makes it
late, both at v_c and at v_n) and roughness act together. Space is discretised by the
exponentially fitted fluxes of Scharfetter and Gummel, which keep the probability
positive however small the noise, and time by implicit Euler.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_banded

from hunt_ros.dynamics.noise.escape import AmplitudeDiffusion
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.errors import ConfigError

Array = NDArray[np.float64]
Direction = Literal['up', 'down']

_CELLS = 200
#: Speed covered in one step over v_c, and limits of a step, s.
_SPEED_STEP = 2.5e-4
_STEP_LIMITS_S = (0.02, 0.4)
#: Smallest diffusion used, m^2/s: amplitudes of some 10 nm, below any sensor.
_LEAST_DIFFUSION = 1e-17


@dataclass(frozen=True)
class Disturbance:
    """
    What shifts the jumps of a swept experiment.

    Parameters
    ----------
    diffusion : AmplitudeDiffusion
        Of the broadband excitation.
    line_amplitude : float
        Amplitude B of the roughness line in y, m.
    sweep_rate : float
        |dv/dt|, m/s^2.
    """

    diffusion: AmplitudeDiffusion
    line_amplitude: float = 0.0
    sweep_rate: float = 0.02

    def __post_init__(self) -> None:
        if not (math.isfinite(self.sweep_rate) and self.sweep_rate > 0.0):
            raise ConfigError(f'sweep rate must be positive, got {self.sweep_rate} m/s^2')
        if not (math.isfinite(self.line_amplitude) and self.line_amplitude >= 0.0):
            raise ConfigError(f'line amplitude must not be negative, got {self.line_amplitude} m')


@dataclass(frozen=True, eq=False)
class JumpDistribution:
    """
    Distribution of the speed at which a sweep jumps.

    Parameters
    ----------
    speed : ndarray, shape (n,)
        m/s, in the order of the sweep.
    probability : ndarray, shape (n,)
        That the jump has happened by then.
    """

    speed: Array
    probability: Array

    def quantile(self, share: float) -> float:
        """Speed by which this share of sweeps has jumped, m/s; NaN if fewer ever do."""
        if self.probability[-1] < share:
            return math.nan
        return float(np.interp(share, self.probability, self.speed))

    @property
    def median(self) -> float:
        """m/s."""
        return self.quantile(0.5)

    @property
    def std(self) -> float:
        """Standard deviation of the speeds of those sweeps that jump, m/s."""
        weight = np.diff(self.probability)
        middle = 0.5 * (self.speed[1:] + self.speed[:-1])
        mean = float(np.average(middle, weights=weight))
        return math.sqrt(float(np.average((middle - mean) ** 2, weights=weight)))


def growth_rate_on_line(
    form: NormalForm, speed: ArrayLike, amplitude: ArrayLike, line_amplitude: ArrayLike
) -> Array:
    """
    Growth rate of hunting while y also carries a roughness line of amplitude B.

    Of (a cos x + b cos z)^3 and ^5, with x and z incommensurate, the share at cos x is
    that of a alone with a^2 -> a^2 + 2 b^2 and a^4 -> a^4 + 6 a^2 b^2 + 3 b^4. It
    takes the nonlinearity to be one of y, as an equivalent conicity is.

    Parameters
    ----------
    form : NormalForm
        In the amplitude coordinate.
    speed, amplitude, line_amplitude : array_like
        m/s, m, m; broadcast.

    Returns
    -------
    ndarray
        1/s.
    """
    r2, b2 = form.radius(amplitude) ** 2, form.radius(line_amplitude) ** 2
    eps = form.detuning(speed)
    added = 2.0 * (form.D4 + form.D10 * eps) * b2 + form.D15 * (6.0 * r2 * b2 + 3.0 * b2**2)
    rate: Array = form.growth_rate(speed, amplitude) + added / form.time_scale
    return rate


def jump_speeds(
    form: NormalForm, disturbance: Disturbance, direction: Direction
) -> JumpDistribution:
    """
    Distribution of the apparent critical speed of a sweep.

    Up: from a little below v_n, quiet, until the amplitude is half that of the
    limit cycle at v_c. Down: from v_c, in the limit cycle, until it is half the
    amplitude of the fold.

    Parameters
    ----------
    form : NormalForm
        In the amplitude coordinate, with a fold.
    disturbance : Disturbance
        Noise, roughness line and sweep rate.
    direction : 'up' or 'down'
        Of the sweep.

    Returns
    -------
    JumpDistribution

    Raises
    ------
    ConfigError
        For a form without a fold: there is no loop.

    References
    ----------
    D. L. Scharfetter, H. K. Gummel, IEEE Trans. Electron Devices 16 (1969) 64.
    """
    fold = form.saddle_node()
    if fold is None:
        raise ConfigError('normal form: no fold, so a sweep has no loop')
    law = disturbance.diffusion
    if law.quiet < _LEAST_DIFFUSION:
        law = AmplitudeDiffusion(_LEAST_DIFFUSION, law.slope)
    hopf = form.critical_speed
    cycle = float(form.stable_amplitude(hopf))
    if direction == 'up':
        start, end = max(fold[0] - 0.02 * hopf, 0.5 * hopf), 1.6 * hopf
        low, high = 0.0, 0.5 * cycle
        quiet = math.sqrt(law.quiet / max(-float(form.growth_rate(start)), 1e-3))
        edges = _edges(low, high, 0.3 * quiet)
    else:
        start, end = hopf, 0.5 * hopf
        low, high = 0.5 * fold[1], 1.15 * cycle
        quiet = cycle
        edges = np.linspace(low, high, _CELLS + 1)
    sweep = _Sweep(form, law, disturbance.line_amplitude, edges, direction)
    return sweep.run(start, end, disturbance.sweep_rate, quiet)


class _Sweep:
    """Finite volumes in amplitude, one implicit step after another in speed."""

    def __init__(
        self,
        form: NormalForm,
        law: AmplitudeDiffusion,
        line_amplitude: float,
        edges: Array,
        direction: Direction,
    ) -> None:
        self.form, self.line_amplitude, self.direction = form, line_amplitude, direction
        self.width = np.diff(edges)
        self.centre = 0.5 * (edges[1:] + edges[:-1])
        # Fluxes at the inner edges and at the absorbing one; none at the other.
        if direction == 'up':
            self.edge = edges[1:]
            self.spacing = np.append(np.diff(self.centre), 0.5 * self.width[-1])
        else:
            self.edge = edges[:-1]
            self.spacing = np.append(0.5 * self.width[0], np.diff(self.centre))
        self.diffusion = law(self.edge)
        # In the plane of the phasor the diffusion is Ito's: drift D / A, and J has -D' p.
        self.steady_drift = self.diffusion / self.edge - 2.0 * law.slope * self.edge * (
            self.diffusion
        )

    def run(self, start: float, end: float, rate: float, initial: float) -> JumpDistribution:
        duration = abs(end - start) / rate
        wanted = _SPEED_STEP * self.form.critical_speed / rate
        step = min(max(wanted, _STEP_LIMITS_S[0]), _STEP_LIMITS_S[1])
        count = math.ceil(duration / step)
        speeds = np.linspace(start, end, count + 1)
        density = self.centre * np.exp(-0.5 * (self.centre / initial) ** 2)
        if self.direction == 'down':
            density = np.exp(-0.5 * ((self.centre - initial) / (2.0 * self.width[0])) ** 2)
        density /= density @ self.width
        jumped = [0.0]
        for speed in speeds[1:]:
            density = solve_banded((1, 1), self.matrix(float(speed), duration / count), density)
            jumped.append(1.0 - float(density @ self.width))
            if jumped[-1] > 0.9999:
                break
        probability = np.maximum.accumulate(np.clip(jumped, 0.0, 1.0))
        return JumpDistribution(speeds[: len(probability)], probability)

    def matrix(self, speed: float, step: float) -> Array:
        """Tridiagonal matrix of one implicit step, as `solve_banded` takes it."""
        rate = growth_rate_on_line(self.form, speed, self.edge, self.line_amplitude)
        peclet = (self.edge * rate + self.steady_drift) * self.spacing / self.diffusion
        conductance = self.diffusion / self.spacing
        out = conductance * _bernoulli(-peclet)  # of the cell below the edge, upwards
        back = conductance * _bernoulli(peclet)  # of the cell above it, downwards
        n = len(self.centre)
        bands = np.zeros((3, n))
        bands[1] = 1.0
        scale = step / self.width
        if self.direction == 'up':
            inner_out, inner_back = out[:-1], back[:-1]
            bands[1, -1] += scale[-1] * out[-1]
        else:
            inner_out, inner_back = out[1:], back[1:]
            bands[1, 0] += scale[0] * back[0]
        bands[1, :-1] += scale[:-1] * inner_out
        bands[1, 1:] += scale[1:] * inner_back
        bands[0, 1:] = -scale[:-1] * inner_back
        bands[2, :-1] = -scale[1:] * inner_out
        return bands


def _bernoulli(x: Array) -> Array:
    """Bernoulli function x / (exp(x) - 1), without overflow and with its limit 1 at 0."""
    clipped = np.clip(x, -500.0, 500.0)
    small = np.abs(clipped) < 1e-6
    safe = np.where(small, 1.0, clipped)
    value: Array = np.where(small, 1.0 - 0.5 * clipped, safe / np.expm1(safe))
    # below -500 it is -x to rounding
    return np.where(x < -500.0, -x, value)


def _edges(low: float, high: float, scale: float) -> Array:
    """Cell edges, evenly spaced in asinh(A / scale)."""
    edges = scale * np.sinh(
        np.linspace(math.asinh(low / scale), math.asinh(high / scale), _CELLS + 1)
    )
    return np.asarray(edges, dtype=np.float64)
