"""
Appendix A and beyond: what roughness, noise and sweep rate do to the measured loop.

Forward: (roughness, noise, sweep rate) -> apparent v_c, v_n and hysteresis width.
Inverse: width measured at a known rate -> size of the disturbance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from hunt_ros.dynamics.noise.escape import (
    AmplitudeDiffusion,
    committor,
    diffusion_from_quiet,
    mean_escape_time,
)
from hunt_ros.dynamics.noise.sweep import (
    Disturbance,
    JumpDistribution,
    growth_rate_on_line,
    jump_speeds,
)
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.errors import ConfigError
from hunt_ros.samples import NORMAL_95, Uncertain

__all__ = [
    'AmplitudeDiffusion',
    'ApparentLoop',
    'Disturbance',
    'JumpDistribution',
    'apparent_loop',
    'committor',
    'diffusion_from_quiet',
    'disturbance_from_width',
    'fold_delay',
    'growth_rate_on_line',
    'jump_speeds',
    'mean_escape_time',
    'threshold_on_line',
]

#: First zero of the Airy function Ai, which times the passage of a fold.
_AIRY_ZERO = 2.338107410459767


def threshold_on_line(form: NormalForm, speed: float, line_amplitude: float) -> float:
    """
    Amplitude beyond which hunting grows under a roughness line of amplitude B.

    To first order sqrt(A_u^2 - 2 B^2); here the root of `growth_rate_on_line`.

    Parameters
    ----------
    form : NormalForm
        In the amplitude coordinate.
    speed : float
        m/s, in the hysteresis region.
    line_amplitude : float
        B, m.

    Returns
    -------
    float
        m; 0 where the line alone makes hunting grow, NaN where there is no
        unstable amplitude without it.
    """
    unstable = float(form.unstable_amplitude(speed))
    if math.isnan(unstable):
        return math.nan

    def rate(amplitude: float) -> float:
        return float(growth_rate_on_line(form, speed, amplitude, line_amplitude))

    if rate(0.0) >= 0.0:
        return 0.0
    grid = np.linspace(0.0, 1.5 * unstable, 301)
    positive = np.flatnonzero(growth_rate_on_line(form, speed, grid, line_amplitude) > 0.0)
    if not positive.size:
        return math.nan
    return float(brentq(rate, grid[positive[0] - 1], grid[positive[0]], xtol=1e-15))


def fold_delay(form: NormalForm, sweep_rate: float) -> float:
    """
    How far below v_n a downward sweep still hunts, m/s, without noise: the rate^(2/3) law.

    Near the fold A s(v, A) = f_v (v - v_n) + f_AA (A - A_n)^2 / 2; with v falling at
    the rate mu this is a Riccati equation that passes at
    2.338 mu^(2/3) (f_v |f_AA| / 2)^(-1/3).

    Raises
    ------
    ConfigError
        For a form without a fold or a rate that is not positive.

    References
    ----------
    P. Jung, G. Gray, R. Roy, P. Mandel, Phys. Rev. Lett. 65 (1990) 1873.
    """
    fold = form.saddle_node()
    if fold is None:
        raise ConfigError('normal form: no fold')
    if not sweep_rate > 0.0:
        raise ConfigError(f'sweep rate must be positive, got {sweep_rate} m/s^2')
    speed, amplitude = fold
    eps, r2 = float(form.detuning(speed)), float(form.radius(amplitude)) ** 2
    by_speed = (
        amplitude
        * (form.D1 + 2.0 * form.D7 * eps + form.D10 * r2)
        / (form.critical_speed * form.time_scale)
    )
    # A s = (c0 r + c1 r^3 + c2 r^5) 2 d0 / time, twice by A
    curvature = (
        (6.0 * (form.D4 + form.D10 * eps) + 20.0 * form.D15 * r2)
        * math.sqrt(r2)
        / (2.0 * form.length_scale * form.time_scale)
    )
    steepness = 0.5 * by_speed * abs(curvature)
    return float(_AIRY_ZERO * sweep_rate ** (2.0 / 3.0) / steepness ** (1.0 / 3.0))


@dataclass(frozen=True, eq=False)
class ApparentLoop:
    """
    The loop as a swept experiment shows it.

    Parameters
    ----------
    up, down : JumpDistribution
        Speeds of the jump to hunting and of its end.
    """

    up: JumpDistribution
    down: JumpDistribution

    @property
    def critical_speed(self) -> Uncertain:
        """Apparent v_c, m/s: median, standard deviation and 95 % range of one sweep."""
        return _summary(self.up)

    @property
    def nonlinear_critical_speed(self) -> Uncertain:
        """Apparent v_n, m/s: median, standard deviation and 95 % range of one sweep."""
        return _summary(self.down)

    @property
    def hysteresis_width(self) -> Uncertain:
        """Apparent width, m/s, of one sweep up and down."""
        high, low = self.critical_speed, self.nonlinear_critical_speed
        return Uncertain(high.value - low.value, math.hypot(high.std, low.std))


def apparent_loop(form: NormalForm, disturbance: Disturbance) -> ApparentLoop:
    """
    Apparent v_c, v_n and width under noise, a roughness line and a sweep rate.

    Parameters
    ----------
    form : NormalForm
        In the amplitude coordinate, with a fold.
    disturbance : Disturbance
        Its three sources.

    Returns
    -------
    ApparentLoop

    Raises
    ------
    ConfigError
        For a form without a fold.
    """
    return ApparentLoop(
        jump_speeds(form, disturbance, 'up'), jump_speeds(form, disturbance, 'down')
    )


def disturbance_from_width(
    form: NormalForm,
    width: Uncertain,
    sweep_rate: float,
    kind: Literal['noise', 'roughness'] = 'noise',
    diffusion: AmplitudeDiffusion | None = None,
) -> Uncertain:
    """
    Size of the disturbance from the width of the loop, Appendix A turned round.

    The interval inverts the model at width -/+ 1.96 standard deviations, those of
    the measurement and of one sweep's chance together.

    Parameters
    ----------
    form : NormalForm
        Undisturbed, in the amplitude coordinate.
    width : Uncertain
        Measured v_c - v_n, m/s.
    sweep_rate : float
        m/s^2.
    kind : 'noise' or 'roughness'
        What the width is put down to.
    diffusion : AmplitudeDiffusion, optional
        Noise that is known already; needed for 'roughness'.

    Returns
    -------
    Uncertain
        m: rms amplitude of quiet hunting midway between v_n and v_c ('noise'), or
        amplitude of the line ('roughness'). 0 where the loop is wider than any
        disturbance at this rate leaves it; the ends of the interval stay inside
        the range searched, up to half the unstable amplitude there.

    Raises
    ------
    ConfigError
        For a form without a fold, or 'roughness' without a diffusion.
    """
    fold = form.saddle_node()
    if fold is None:
        raise ConfigError('normal form: no fold, so its width says nothing')
    if kind == 'roughness' and diffusion is None:
        raise ConfigError('the diffusion of the noise must be known to find the roughness')
    middle = 0.5 * (fold[0] + form.critical_speed)
    largest = 0.5 * float(form.unstable_amplitude(middle))
    base = Disturbance(diffusion or AmplitudeDiffusion(0.0), 0.0, sweep_rate)
    sizes = largest * np.geomspace(2e-3, 1.0, 11)
    if kind == 'roughness':
        sizes = np.concatenate([[0.0], largest * np.linspace(0.1, 1.0, 10)])
    widths, spreads = [], []
    for size in sizes:
        if kind == 'noise':
            law = AmplitudeDiffusion(diffusion_from_quiet(form, middle, float(size)))
            trial = replace(base, diffusion=law)
        else:
            trial = replace(base, line_amplitude=float(size))
        seen = apparent_loop(form, trial).hysteresis_width
        widths.append(seen.value)
        spreads.append(seen.std)
    return _inverted(sizes, np.array(widths), np.array(spreads), width)


def _inverted(
    sizes: NDArray[np.float64],
    widths: NDArray[np.float64],
    spreads: NDArray[np.float64],
    measured: Uncertain,
) -> Uncertain:
    """Read the size off the curve of width against size, and its interval."""
    known = np.isfinite(widths)
    curve = np.minimum.accumulate(widths[known])[::-1]  # the width falls with the size
    size, spread = sizes[known][::-1], spreads[known][::-1]
    std = math.hypot(measured.std, float(np.interp(measured.value, curve, spread)))
    low, value, high = (
        0.0 if x >= curve[-1] else float(np.interp(x, curve, size))
        for x in (
            measured.value + NORMAL_95 * std,
            measured.value,
            measured.value - NORMAL_95 * std,
        )
    )
    return Uncertain(value, (high - low) / (2.0 * NORMAL_95), low, high)


def _summary(jump: JumpDistribution) -> Uncertain:
    low, high = sorted((jump.quantile(0.025), jump.quantile(0.975)))
    return Uncertain(jump.median, jump.std, low, high)
