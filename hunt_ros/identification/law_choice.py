"""
Which growth law: each is fitted, and the evidence weighs them.

The quintic law is the paper's. Where a recording shows that it does not follow it, a law
with one more term does better, and where the recording cannot tell, the intervals hold
what all of them say. The weights are those of Laplace's approximation to the evidence.
Among several laws one always fits best by chance: the richer ones share between them what
the quintic law is given beforehand, and one of them is chosen only on substantial evidence.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.identification.growth_law import (
    CONICITY,
    EXTENDED,
    QUINTIC,
    TERMS,
    GrowthLaw,
    GrowthScales,
)
from hunt_ros.identification.integral_fit import integral_start
from hunt_ros.identification.normal_form_map import from_normal_form, to_normal_form
from hunt_ros.identification.path import Path
from hunt_ros.identification.path_likelihood import NOISE_TERMS
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.identification.trajectory_fit import Prior, TrajectoryFit, fit_path

#: Gain of the log likelihood from which a roughness line is taken as not felt.
_FELT = 2.0
#: Rounds in which jumps of the path are looked for.
_GATES = 6
_MOST_JUMPS = 0.005
#: ln Q, ln R and ln phase noise at which a fit starts, at least.
_BROAD = np.array([-8.0, -9.0, -6.0])
#: Standard deviation of the prior on the seventh coefficient, in units of the first six's.
_EXTRA = 0.3
#: Standard deviation of the prior on the logarithm of a variance: two decades.
_FREE_NOISE = 4.6
#: What each law is given beforehand: half for the paper's, half for all others together.
_BEFOREHAND = {QUINTIC: 0.5, EXTENDED: 0.25, CONICITY: 0.25}
#: Odds from which evidence is more than barely worth a mention (Jeffreys 1961, App. B).
_SUBSTANTIAL = math.sqrt(10.0)


@dataclass(frozen=True, eq=False)
class FittedLaw:
    """
    One law, fitted.

    Parameters
    ----------
    law : GrowthLaw
    fit : TrajectoryFit
    path : Path
        What it was fitted to.
    weight : float
        Its share of the evidence, 0 to 1.
    """

    law: GrowthLaw
    fit: TrajectoryFit
    path: Path
    weight: float

    @property
    def noise(self) -> NDArray[np.float64]:
        """Forcing and noise found beside the law, shape (5,)."""
        return self.fit.theta[-NOISE_TERMS:]


def fastest_rate(scales: GrowthScales) -> float:
    """Largest sensible growth rate, 1/s: the angular frequency of the mode itself."""
    return 2.0 * math.pi * scales.frequency_hz


def fit_laws(
    path: Path,
    scales: GrowthScales,
    settings: IdentificationSettings,
    v_c: float | None,
    floor: float,
) -> list[FittedLaw]:
    """
    Fit all laws to a path.

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
    floor : float
        Amplitude below which motion is noise, in units of A_ref.

    Returns
    -------
    list of FittedLaw
        The one chosen first: the quintic, or the one with the most evidence if substantial.
    """
    quintic, path = _fit_quintic(path, scales, settings, v_c, floor)
    fits = {QUINTIC: (quintic, path)}
    theta = quintic.theta
    extended = np.concatenate([theta[:6], [0.0], theta[-NOISE_TERMS:]])
    fits[EXTENDED] = (_finish(EXTENDED, path, extended, scales, settings), path)
    # The way to the quintic optimum may lead round by the richer law.
    shorter = np.delete(fits[EXTENDED][0].theta, 6)
    again = _finish(QUINTIC, path, shorter, scales, settings)
    if again.log_likelihood > quintic.log_likelihood:
        fits[QUINTIC] = (again, path)
    bent = replace(path, conicity=True)
    shape = _conicity_start(fits[EXTENDED][0].theta)
    fits[CONICITY] = (_finish(CONICITY, bent, shape, scales, settings), bent)
    return _weighed(fits, scales)


def fit_again(
    laws: Sequence[FittedLaw], path: Path, settings: IdentificationSettings
) -> list[FittedLaw]:
    """
    Fit laws to the same path under other weights, from where they are.

    Parameters
    ----------
    laws : sequence of FittedLaw
        As fitted.
    path : Path
        With the weights of its instants.
    settings : IdentificationSettings
        For what is known from elsewhere.

    Returns
    -------
    list of FittedLaw
        The one chosen first: the quintic, or the one with the most evidence if substantial.
    """
    fits = {}
    scales = laws[0].law.scales
    for one in laws:
        name = one.law.name
        used = replace(path, conicity=name == CONICITY)
        fits[name] = (_finish(name, used, one.fit.theta, scales, settings), used)
    return _weighed(fits, scales)


def _weighed(fits: dict[str, tuple[TrajectoryFit, Path]], scales: GrowthScales) -> list[FittedLaw]:
    """Laws with their shares of the evidence, the one chosen first."""
    evidence = {
        name: _evidence(fit, name, scales) - _one_block(fit, path, *fits[QUINTIC])
        for name, (fit, path) in fits.items()
    }
    top = max(max(evidence.values()), -1e300)
    weights = {
        name: _BEFOREHAND[name] * math.exp(max(value - top, -50.0))
        for name, value in evidence.items()
    }
    total = sum(weights.values())
    laws = [
        FittedLaw(GrowthLaw(name, fit.law, scales), fit, used, weights[name] / total)
        for name, (fit, used) in fits.items()
    ]
    laws.sort(key=lambda one: -one.weight)
    if laws[0].weight < _SUBSTANTIAL * next(o.weight for o in laws if o.law.name == QUINTIC):
        laws.sort(key=lambda one: one.law.name != QUINTIC)
    return laws


def _one_block(fit: TrajectoryFit, path: Path, quintic: TrajectoryFit, beside: Path) -> float:
    """
    Return the gain of log likelihood over the quintic law in the one cluster with the largest.

    One stretch of a record may be odd, and a richer law bends to it: it must be better
    without that stretch too.
    """
    gain = _by_cluster(fit, path) - _by_cluster(quintic, beside)
    # A law that ran away has no evidence to begin with.
    return max(float(gain.max()), 0.0) if gain.size and np.isfinite(gain).all() else 0.0


def _by_cluster(fit: TrajectoryFit, path: Path) -> NDArray[np.float64]:
    """Log likelihood of each cluster, up to a constant."""
    weight = np.ones(path.time.size) if path.weight is None else path.weight
    point = -0.5 * weight * (fit.innovations[:, :2] ** 2 + fit.innovations[:, 2:]).sum(axis=1)
    return np.bincount(path.cluster, point, minlength=path.clusters).astype(np.float64)


def _widths(name: str, scales: GrowthScales) -> NDArray[np.float64]:
    """Standard deviations of the weak prior on each coefficient."""
    widths = np.full(TERMS[name], fastest_rate(scales))
    widths[6:] *= _EXTRA
    if name == CONICITY:
        # The bend of the conicity is no rate: a number of order one at A_ref.
        widths[5] = 1.0
    return widths


def refit(
    fitted: FittedLaw,
    settings: IdentificationSettings,
    cluster_weight: NDArray[np.float64],
    iterations: int = 12,
) -> TrajectoryFit:
    """Fit the law again with other weights of the clusters: one bootstrap replication."""
    scales = fitted.law.scales
    return fit_path(
        fitted.path,
        fitted.fit.theta,
        _widths(fitted.law.name, scales),
        priors_of(scales, settings),
        cluster_weight,
        iterations,
    )


def _finish(
    name: str,
    path: Path,
    start: NDArray[np.float64],
    scales: GrowthScales,
    settings: IdentificationSettings,
) -> TrajectoryFit:
    return fit_path(path, start, _widths(name, scales), priors_of(scales, settings))


def _conicity_start(theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Conicity law near an extended one: its curvature goes into K."""
    p = theta[:7]
    bend = float(np.clip(p[5] / p[3], -2.0, 2.0)) if abs(p[3]) > 1e-6 else 0.0
    return np.concatenate([p[:5], [bend, 0.0], theta[-NOISE_TERMS:]])


def _evidence(fit: TrajectoryFit, name: str, scales: GrowthScales) -> float:
    """Laplace's approximation to the log evidence, up to a constant; it needs a maximum."""
    if not (fit.converged and math.isfinite(fit.log_likelihood)):
        return -math.inf
    information = fit.information.copy()
    # A noise that is too small to be seen leaves its logarithm free: without a bound on how
    # free, the law beside which it vanished would win for that alone.
    noise = np.arange(information.shape[0])[-3:]
    information[noise, noise] += _FREE_NOISE**-2
    sign, logarithm = np.linalg.slogdet(information)
    if sign <= 0.0:
        return -math.inf
    widths = _widths(name, scales)
    return float(fit.log_likelihood - 0.5 * logarithm - np.log(widths).sum())


def _fit_quintic(
    path: Path,
    scales: GrowthScales,
    settings: IdentificationSettings,
    v_c: float | None,
    floor: float,
) -> tuple[TrajectoryFit, Path]:
    """Fit the quintic law from several starts; leave out jumps that no law makes."""
    widths = _widths(QUINTIC, scales)
    step = float(np.median(np.diff(path.time)))
    change = np.abs(np.diff(path.phasor))
    usual = float(np.nanmedian(change)) ** 2 if np.isfinite(change).any() else 1.0
    noise = np.log([max(0.3 * usual / step, 1e-12), max(0.3 * usual, 1e-12), 1e-3])
    # From broad to narrow: under little noise the hills are too steep to find the highest.
    noise = np.concatenate([[0.0, 0.0], np.maximum(noise, _BROAD)])
    priors = priors_of(scales, settings)
    laws = [integral_start(path, floor, fastest_rate(scales)), *_templates(path, scales, v_c)]
    starts = [
        fit_path(path, np.concatenate([law, noise]), widths, priors, None, 8) for law in laws
    ]
    best = max(starts, key=lambda one: one.log_likelihood)
    fit = fit_path(path, best.theta, widths, priors)
    # A kick too small to be seen in its window shows as a jump of the path: start anew there.
    for _ in range(_GATES):
        jumps = _jumps(fit)
        # Kicks are few; where many samples stand out it is the law that is wrong.
        if not jumps.any() or jumps.sum() > 3 + _MOST_JUMPS * jumps.size:
            break
        path = path.broken_at(jumps)
        fit = fit_path(path, fit.theta, widths, priors)
    # A line that the sensor sees and the wheelset does not feel (run-out) is no part of the law.
    if path.line is not None and np.any(path.line > 0.0):
        bare = replace(path, line=None)
        other = fit_path(bare, fit.theta, widths, priors)
        if other.log_likelihood > fit.log_likelihood + _FELT:
            return other, bare
    return fit, path


def _templates(path: Path, scales: GrowthScales, v_c: float | None) -> list[NDArray[np.float64]]:
    """
    Laws of the usual shapes at the observed speeds, as further starts.

    The likelihood has more than one hill; which is the highest, the data decide.
    """
    rate = scales.frequency_hz * scales.time_scale
    big = rate / scales.ratio
    speed = v_c or float(scales.speed * (1.0 + np.quantile(path.u, 0.75)))

    def form(D1: float, D4: float, D15: float) -> NormalForm:
        return NormalForm(
            critical_speed=speed,
            D1=D1,
            D4=D4,
            D7=0.0,
            D10=0.0,
            D15=D15,
            length_scale=scales.length_scale,
            time_scale=scales.time_scale,
            frequency_hz=scales.frequency_hz,
        )

    forms = [form(rate, big, -big / scales.ratio), form(rate, -big, 0.0)]
    return [from_normal_form(one, scales) for one in forms]


def _jumps(fit: TrajectoryFit) -> NDArray[np.bool_]:
    """Innovations that stand out from all others, and from their neighbours."""
    size = np.abs(fit.innovations[:, :2]).max(axis=1)
    usual = max(1.4826 * float(np.median(np.abs(fit.innovations[:, 0]))), 0.5)
    largest = maximum_filter1d(size, 7, mode='constant')
    jumps: NDArray[np.bool_] = (size > 6.0 * usual) & (size >= largest)
    return jumps


def priors_of(scales: GrowthScales, settings: IdentificationSettings) -> Sequence[Prior]:
    """Turn what is known from elsewhere into functions of the law's coefficients."""
    priors: list[Prior] = []
    if settings.prior_v_c is not None:
        v_c, std = settings.prior_v_c
        u = v_c / scales.speed - 1.0

        def offset(p: NDArray[np.float64]) -> float:
            # How far the root of the linear growth rate is from v_c, to first order.
            slope = max(float(p[1] + 2.0 * p[2] * u), 1e-3 * fastest_rate(scales))
            return float(p[0] + p[1] * u + p[2] * u**2) / slope * scales.speed

        priors.append((offset, 0.0, std))
    if settings.prior_D1 is not None:

        def linear(p: NDArray[np.float64]) -> float:
            form = to_normal_form(p[:6], scales)
            return float(p[1]) * scales.time_scale if form is None else form.D1

        priors.append((linear, *settings.prior_D1))
    return priors
