"""
The fit of the growth law: where it starts, where a path is broken, how far it leaves Eq. (24).

The paper's form is fitted first: it tells how large terms are. Then the terms that it leaves out
are let in, under a prior as wide as those of a rig whose conicity or creep saturates. They are
let in also where a recording follows the form as well without them: a short one does whatever the
rig, since its linear terms bend instead, and v_c with them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import maximum_filter1d

from hunt_ros.dynamics.growth_law import (
    FELT,
    PAPER_TERMS,
    SATURATION,
    TERMS,
    GrowthLaw,
    GrowthScales,
    lawful,
    saturated,
)
from hunt_ros.identification.likelihood.path import Path
from hunt_ros.identification.likelihood.spreads import learnt
from hunt_ros.identification.likelihood.trajectory_fit import (
    Prior,
    Problem,
    TrajectoryFit,
    fit_path,
    usual_spread,
)
from hunt_ros.identification.settings import IdentificationSettings

#: Widths of the prior on the terms beyond the paper's form, in units of those they belong to, one
#: after the other: little by little the fit goes where it does not at once. Of rigs whose conicity
#: or creep saturates the terms are about as large as those, or twice: the evidence of such records
#: prefers 1.2 to 2.0 by up to tens of nats, that of others loses one, and what a short record
#: leaves open is a few per cent wider than with 0.75. It comes four times, so that the units
#: become those of the fit itself: where forces saturate they grow from one to the next.
_WIDTHS = 0.45, *4 * (1.2,)
#: Standard deviations of the prior on d ln Q / du, forcing that rises with a power of v, and on
#: d ln Q / dw. The amplitude of a limit cycle beats with the lines of the roller, and what is left
#: of that looks like forcing that grows with the amplitude: where it may not be, the quiet motion
#: gets the same forcing, and the law bends to explain the beat.
_SLOPES = 3.0, 1.0
#: Rounds in which jumps of the path are looked for, and the share of it they are at most.
_GATES = 6
_MOST_JUMPS = 0.005
#: ln Q, ln R and ln phase noise at which a fit starts, at least.
_BROAD = np.array([-8.0, -9.0, -6.0])


@dataclass(frozen=True, eq=False)
class FittedLaw:
    """
    The law, fitted.

    Parameters
    ----------
    law : GrowthLaw
    fit : TrajectoryFit
    """

    law: GrowthLaw
    fit: TrajectoryFit

    @property
    def noise(self) -> NDArray[np.float64]:
        """Forcing and noise found beside the law, shape (5,)."""
        return self.fit.theta[TERMS:]


def fit_law(
    path: Path,
    scales: GrowthScales,
    settings: IdentificationSettings,
    v_c: float | None,
) -> FittedLaw:
    """
    Fit the law to a path: the paper's form, then with further terms.

    Parameters
    ----------
    path : Path
        The measured envelope.
    scales : GrowthScales
        Units of the fit.
    settings : IdentificationSettings
        For what is known from elsewhere.
    v_c : float or None
        Observed critical speed, as a start only, m/s.
    """
    priors = priors_of(scales, settings)
    line = path.line is not None and bool(np.any(path.line > 0.0))
    problem = Problem(path, *law_prior(scales, line), priors, usual_spread(path))
    fit = _fit_paper(problem, scales, v_c)
    for width in _WIDTHS:
        mean, std = law_prior(scales, line, width, fit.theta[:PAPER_TERMS])
        problem = replace(problem, path=_turned(fit, scales), mean=mean, std=std)
        fit = fit_path(problem, fit.theta, own=fit.own)
    fit = learnt(fit)
    # A kick too small to be seen in its window shows as a step of the path: start anew there.
    for _ in range(_GATES):
        steps = _steps(fit)
        # Kicks are few; where many samples stand out it is the law that is wrong.
        if not steps.any() or steps.sum() > 3 + _MOST_JUMPS * steps.size:
            break
        problem = replace(fit.problem, path=fit.problem.path.broken_at(steps))
        fit = fit_path(problem, fit.theta, own=fit.own)
    return FittedLaw(GrowthLaw(fit.law, scales), fit)


def _fit_paper(problem: Problem, scales: GrowthScales, v_c: float | None) -> TrajectoryFit:
    """Fit the paper's form, from laws of either criticality about the observed speed."""
    path = problem.path
    step = float(np.median(np.diff(path.time)))
    change = np.abs(np.diff(path.phasor))
    usual = float(np.nanmedian(change)) ** 2 if np.isfinite(change).any() else 1.0
    noise = np.log([max(0.3 * usual / step, 1e-12), max(0.3 * usual, 1e-12), 1e-3])
    # From broad to narrow: under little noise the hills are too steep to find the highest.
    noise = np.concatenate([[0.0, 0.0], np.maximum(noise, _BROAD)])
    # The likelihood has more than one hill, and what is climbed hangs on the side.
    speed = v_c or scales.speed * (1.0 + float(np.quantile(path.u, 0.75)))
    shapes = np.array(
        [
            (1.0 - part * speed / scales.speed, 1.0, 0.0, *rest)
            for part in (0.9, 1.0, 1.1)
            for rest in ((1.0, 0.0, -1.0), (-1.0, 0.0, 0.0))
        ]
    )
    laws = [np.concatenate([lawful(law), noise]) for law in scales.frequency_hz * shapes]
    starts = [fit_path(problem, law, 8) for law in laws]
    best = max(starts, key=lambda one: one.log_likelihood)
    return fit_path(problem, best.theta, own=best.own)


def _turned(fit: TrajectoryFit, scales: GrowthScales) -> Path:
    """
    Turn the frame of the path with what its frequency leaves out, over speed and amplitude.

    The innovations across the amplitude show it, each as well as the filter knows it: a frame
    that turns too fast or too slow in a transient makes it look like a kick, and rest better
    damped than it is.
    """
    path = fit.problem.path
    u, amplitude = path.u, np.abs(path.phasor)
    x = saturated(fit.theta[SATURATION], np.nan_to_num(amplitude) ** 2)
    basis = np.stack([np.ones_like(u), u, u * u, x, u * x, x * x, u * x * x], axis=1)
    basis[1:] = 0.5 * (basis[1:] + basis[:-1])
    lasts = np.diff(path.time, prepend=path.time[0])
    out = fit.innovations
    used = out[:, 3] != 0.0
    rows = basis * (lasts * np.nan_to_num(amplitude) * np.exp(-0.5 * out[:, 3]))[:, None]
    used &= np.isfinite(out[:, 1]) & np.isfinite(rows).all(axis=1)
    ridge = np.eye(basis.shape[1]) / scales.fastest_rate
    found = np.linalg.lstsq(
        np.concatenate([rows[used], ridge]),
        np.concatenate([out[used, 1], np.zeros(len(ridge))]),
        rcond=None,
    )[0]
    moved = np.where(path.restart, 0.0, lasts * (basis @ found))
    return replace(path, phasor=path.phasor * np.exp(-1j * np.cumsum(moved)))


def _steps(fit: TrajectoryFit) -> NDArray[np.bool_]:
    """
    Instants at which a step of the path is likelier than smooth growth under the law.

    References
    ----------
    Willsky, A. S., Jones, H. L. (1976), IEEE Trans. Autom. Control 21, 108-115: generalised
    likelihood ratio; here of a step anywhere among n instants, of a size up to A_ref.
    """
    out = fit.innovations
    used = out[:, 2] != 0.0
    # Where the law is not right yet all innovations are large, and none of them a step.
    usual = max(1.4826 * float(np.median(np.abs(out[used, 0]))), 1.0) if used.any() else 1.0
    along, across = (0.5 * (out[:, :2] / usual) ** 2 + 0.5 * out[:, 2:]).T
    # Frequency and growth change with the amplitude alike, and the law has no frequency: where the
    # path turns by less than that, and by less than a radian, it is no step.
    size = np.abs(fit.problem.path.phasor)
    before = np.concatenate([[np.nan], size[:-1]])
    most = np.minimum(np.abs(size - before), np.minimum(size, before))
    turned = np.abs(out[:, 1]) * np.exp(0.5 * out[:, 3]) < most
    across = np.where(turned, np.minimum(across, 0.0), across)
    ratio = np.where(used, along + across, -np.inf)
    # One step a neighbourhood: those beside it may be its shadow.
    largest = maximum_filter1d(ratio, 7, mode='constant', cval=-np.inf)
    steps: NDArray[np.bool_] = (ratio > math.log(max(used.sum(), 2))) & (ratio >= largest)
    return steps


def law_prior(
    scales: GrowthScales, line: bool, width: float = 0.0, size: ArrayLike = (0.0,) * PAPER_TERMS
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Prior of the law, and of how the forcing changes: independent normal numbers.

    Parameters
    ----------
    scales : GrowthScales
        Units. No mode that still oscillates grows faster than its own angular frequency.
    line : bool
        Whether there is a line of the roller.
    width : float
        Of the terms beyond the paper's form, relative to those they belong to.
    size : array_like, shape (6,)
        Coefficients of the form.

    Returns
    -------
    mean, std : ndarray, shape (10 + 2,)
        1/s; a coefficient with std 0 is held at its mean.
    """
    mean, std = np.zeros(TERMS), np.zeros(TERMS)
    std[:PAPER_TERMS] = scales.fastest_rate
    mean[FELT], std[FELT] = 1.0, 0.5 if line else 0.0
    # u x^2 and u^2 x beside the terms in x^2 and u x that they change.
    _, _, _, cubic, mixed, quintic = np.abs(size)
    std[[6, 7, SATURATION]] = width * np.array([max(cubic, quintic), mixed, 2.0 / 3.0])
    return np.append(mean, [0.0, 0.0]), np.append(std, _SLOPES)


def priors_of(scales: GrowthScales, settings: IdentificationSettings) -> Sequence[Prior]:
    """Turn what is known from elsewhere into functions of the law's coefficients."""
    priors: list[Prior] = []
    if settings.prior_v_c:
        v_c, std = settings.prior_v_c
        u = v_c / scales.speed - 1.0

        def offset(p: NDArray[np.float64]) -> float:
            """Return how far the root of the linear growth rate is from v_c, to first order."""
            law = GrowthLaw(p, scales)
            slope = max(float(law.linear_slope(u)), 1e-3 * scales.fastest_rate)
            return float(law.linear(u)) / slope * scales.speed

        priors.append((offset, 0.0, std))
    if settings.prior_D1:

        def linear(p: NDArray[np.float64]) -> float:
            """Return D1, at v_c where the law has one."""
            v_c = GrowthLaw(p, scales).critical_speed
            if v_c is None:
                return float(p[1]) * scales.time_scale
            slope = float(GrowthLaw(p, scales).linear_slope(v_c / scales.speed - 1.0))
            return slope * v_c / scales.speed * scales.time_scale

        D1, std = settings.prior_D1
        priors.append((linear, D1, std))
    return priors
