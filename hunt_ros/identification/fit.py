"""
The fit of the growth law: where it starts, where a path is broken, how far it leaves Eq. (24).

The paper's form is fitted first. Then the terms that it leaves out are let in under priors of
growing width: how far a rig departs from the form is a scale that the recording tells. Each
width has its evidence (Laplace's approximation to the marginal likelihood), and the intervals
hold what all of them say, each by its share. On a record that follows the form the further
terms are not worth their freedom, and what is given is the form as it was fitted alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from hunt_ros.dynamics.growth_law import (
    FELT,
    PAPER_TERMS,
    TERMS,
    GrowthLaw,
    GrowthScales,
    from_normal_form,
    lawful,
)
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.identification.likelihood.path import Path
from hunt_ros.identification.likelihood.path_likelihood import NOISE_TERMS
from hunt_ros.identification.likelihood.spreads import learnt
from hunt_ros.identification.likelihood.trajectory_fit import (
    LawPrior,
    Prior,
    TrajectoryFit,
    fit_path,
)
from hunt_ros.identification.settings import IdentificationSettings

#: Scales of the departure from the paper's form, and what each is given beforehand: half for
#: none at all, the rest to widths from a tenth of the form's own terms to all of them.
DEPARTURES = {0.0: 0.5, 0.1: 1.0 / 6.0, 0.3: 1.0 / 6.0, 1.0: 1.0 / 6.0}
#: Rounds in which jumps of the path are looked for, and the share of it they are at most.
_GATES = 6
_MOST_JUMPS = 0.005
#: ln Q, ln R and ln phase noise at which a fit starts, at least.
_BROAD = np.array([-8.0, -9.0, -6.0])
#: Standard deviation of the prior on the logarithm of a variance: two decades.
_FREE_NOISE = 4.6


@dataclass(frozen=True, eq=False)
class FittedLaw:
    """
    The law, fitted under one prior.

    Parameters
    ----------
    law : GrowthLaw
    fit : TrajectoryFit
    path : Path
        What it was fitted to.
    prior : LawPrior
        Under which it was fitted.
    departure : float
        Its scale of the terms beyond the paper's form.
    weight : float
        Its share of the evidence, 0 to 1.
    """

    law: GrowthLaw
    fit: TrajectoryFit
    path: Path
    prior: LawPrior
    departure: float
    weight: float

    @property
    def noise(self) -> NDArray[np.float64]:
        """Forcing and noise found beside the law, shape (5,)."""
        return self.fit.theta[-NOISE_TERMS:]


def fit_laws(
    path: Path,
    scales: GrowthScales,
    settings: IdentificationSettings,
    v_c: float | None,
) -> list[FittedLaw]:
    """
    Fit the law to a path under each scale of its departure from the paper's form.

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

    Returns
    -------
    list of FittedLaw
        With their shares of the evidence. The first is the one to be given: the paper's form
        where it has half of the evidence, else further terms of the likeliest scale.
    """
    priors = priors_of(scales, settings)
    line = path.line is not None and bool(np.any(path.line > 0.0))
    fit, path = _fit_paper(path, scales, priors, v_c, line)
    size = fit.theta[:PAPER_TERMS]
    fitted = []
    for departure in DEPARTURES:
        prior = law_prior(scales, departure, size, line)
        if departure > 0.0:
            fit = fit_path(path, fit.theta, prior, priors, own=fit.own, spread=fit.spread)
        fitted.append(FittedLaw(GrowthLaw(fit.law, scales), fit, path, prior, departure, 0.0))
    return _weighed(fitted)


def _weighed(fitted: Sequence[FittedLaw]) -> list[FittedLaw]:
    """Laws with their shares of the evidence, the one to be given first."""
    evidence = np.array([_evidence(one.fit, one.prior) for one in fitted])
    top = max(float(evidence.max()), -1e300)
    given = np.array([DEPARTURES[one.departure] for one in fitted])
    share = given * np.exp(np.maximum(evidence - top, -50.0))
    share /= share.sum()
    laws = [replace(one, weight=float(w)) for one, w in zip(fitted, share, strict=True)]
    # The paper's form, or further terms with the scale that has the most evidence.
    paper = sum(one.weight for one in laws if one.departure == 0.0) >= 0.5
    return sorted(laws, key=lambda one: ((one.departure == 0.0) != paper, -one.weight))


def _evidence(fit: TrajectoryFit, prior: LawPrior) -> float:
    """Laplace's approximation to the log evidence, up to a constant; it needs a maximum."""
    if not (fit.converged and math.isfinite(fit.log_likelihood)):
        return -math.inf
    information = fit.information.copy()
    # A noise that is too small to be seen leaves its logarithm free: without a bound on how
    # free, the law beside which it vanished would win for that alone.
    noise = np.arange(information.shape[0])[-3:]
    information[noise, noise] += _FREE_NOISE**-2
    varied = np.flatnonzero(np.diag(information) > 0.0)
    sign, logarithm = np.linalg.slogdet(information[np.ix_(varied, varied)])
    if sign <= 0.0:
        return -math.inf
    return float(fit.log_likelihood - 0.5 * logarithm - np.log(prior.std[prior.std > 0.0]).sum())


def _fit_paper(
    path: Path,
    scales: GrowthScales,
    priors: Sequence[Prior],
    v_c: float | None,
    line: bool,
) -> tuple[TrajectoryFit, Path]:
    """Fit the paper's form from several starts; break the path where a step was."""
    prior = law_prior(scales, 0.0, None, line)
    step = float(np.median(np.diff(path.time)))
    change = np.abs(np.diff(path.phasor))
    usual = float(np.nanmedian(change)) ** 2 if np.isfinite(change).any() else 1.0
    noise = np.log([max(0.3 * usual / step, 1e-12), max(0.3 * usual, 1e-12), 1e-3])
    # From broad to narrow: under little noise the hills are too steep to find the highest.
    noise = np.concatenate([[0.0, 0.0], np.maximum(noise, _BROAD)])
    laws = _templates(path, scales, v_c)
    starts = [
        fit_path(path, np.concatenate([lawful(law), noise]), prior, priors, 8) for law in laws
    ]
    best = max(starts, key=lambda one: one.log_likelihood)
    fit = fit_path(path, best.theta, prior, priors, own=best.own)
    fit = learnt(path, fit, prior, priors)
    # A kick too small to be seen in its window shows as a step of the path: start anew there.
    for _ in range(_GATES):
        steps = _steps(fit)
        # Kicks are few; where many samples stand out it is the law that is wrong.
        if not steps.any() or steps.sum() > 3 + _MOST_JUMPS * steps.size:
            break
        path = path.broken_at(steps)
        fit = fit_path(path, fit.theta, prior, priors, own=fit.own, spread=fit.spread)
    return fit, path


def _templates(path: Path, scales: GrowthScales, v_c: float | None) -> list[NDArray[np.float64]]:
    """
    Laws of the usual shapes at the observed speeds, as starts.

    The likelihood has more than one hill; which is the highest, the data decide, and from one side
    a hill is climbed that is not from the other.
    """
    rate = scales.frequency_hz * scales.time_scale
    big = rate / scales.ratio
    speed = v_c or float(scales.speed * (1.0 + np.quantile(path.u, 0.75)))
    units = scales.length_scale, scales.time_scale, scales.frequency_hz
    shapes = [(big, -big / scales.ratio), (-big, 0.0)]
    forms = [
        NormalForm(part * speed, rate, D4, 0.0, 0.0, D15, *units)
        for part in (0.9, 1.0, 1.1)
        for D4, D15 in shapes
    ]
    return [from_normal_form(one, scales) for one in forms]


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
    power = 0.5 * (out[:, 0] ** 2 + out[:, 1] ** 2) / usual**2
    ratio = np.where(used, power + 0.5 * (out[:, 2] + out[:, 3]), -np.inf)
    # One step a neighbourhood: those beside it may be its shadow.
    largest = maximum_filter1d(ratio, 7, mode='constant', cval=-np.inf)
    steps: NDArray[np.bool_] = (ratio > math.log(max(used.sum(), 2))) & (ratio >= largest)
    return steps


def law_prior(
    scales: GrowthScales, departure: float, size: NDArray[np.float64] | None, line: bool
) -> LawPrior:
    """
    Prior of the law for a rig that departs from the paper's form by so much.

    Parameters
    ----------
    scales : GrowthScales
        Units. No mode that still oscillates grows faster than its own angular frequency.
    departure : float
        Scale of the further terms relative to those they belong to; 0 for the paper's form.
    size : ndarray, shape (6,), optional
        Coefficients of the paper's form; not needed for `departure` 0.
    line : bool
        Whether there is a line of the roller.

    Returns
    -------
    LawPrior
    """
    mean, std = np.zeros(TERMS), np.zeros(TERMS)
    std[:PAPER_TERMS] = scales.fastest_rate
    mean[FELT], std[FELT] = 1.0, 0.5 if line else 0.0
    if departure > 0.0 and size is not None:
        # In a series in u and w each term is about as large as the one before, less w^3 / 6.
        amplitude = float(np.max(np.abs(size[[3, 5]])))
        std[[6, 7, 8, 9]] = departure * np.array(
            [amplitude, 0.3 * amplitude, abs(float(size[1])), amplitude]
        )
    return LawPrior(mean, std)


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
