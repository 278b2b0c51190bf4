"""Intervals: the covariance of the law, draws of laws, and numbers made of draws."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hunt_ros.dynamics.covariance_root import covariance_root, inverse_of
from hunt_ros.dynamics.growth_law import SATURATION, TERMS, GrowthLaw, reading
from hunt_ros.dynamics.identified import EXISTS
from hunt_ros.identification.fit import FittedLaw
from hunt_ros.identification.likelihood.path_likelihood import ALL_TERMS
from hunt_ros.identification.likelihood.trajectory_fit import VAGUE_NOISE, TrajectoryFit
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.samples import NORMAL_95, Uncertain

#: Degrees of freedom of the variances: the noise is found beside the law, and its model is one.
_DEGREES = 12.0
#: Spread of the speeds of recordings, relative, from which their number is that of the degrees
#: of freedom.
_APART = 1e-3
#: Draws behind the intervals.
_DRAWS = 400
#: Fewer draws than this say nothing of an interval.
ENOUGH_DRAWS = 10
#: Draws that are tried for one that is kept, at most.
_TRIES = 8
#: Windows that all moves of the draws may take. The longer a record the more normal is what it
#: leaves open (as one over the root of its length): five moves of each draw for a minute, none
#: for six.
_WINDOWS = 200_000


def law_covariance(fit: TrajectoryFit) -> NDArray[np.float64]:
    """
    Covariance of the growth law by the information of its fit, shape (10, 10).

    Parameters
    ----------
    fit : TrajectoryFit
        At a maximum.
    """
    wide = 1e6 * np.eye(TERMS)  # a law that ran away says nothing: so that every guard sees it
    if not np.isfinite(fit.information).all():
        return wide
    covariance = np.asarray(inverse_of(fit.information)[:TERMS, :TERMS], dtype=np.float64)
    return covariance if np.diag(covariance).min() >= 0.0 else wide


def _beside(
    fitted: FittedLaw, away: NDArray[np.float64], normal: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the noise that goes with laws so far away from the fit, shape (n, 5)."""
    information = fitted.fit.information
    if not np.isfinite(information).all():
        return np.tile(fitted.noise, (len(away), 1))
    covariance = inverse_of(information[TERMS:, TERMS:])
    follow = -covariance @ information[TERMS:, :TERMS]
    return np.asarray(fitted.noise + away @ follow.T + normal @ covariance_root(covariance).T)


def linear_growth_std(fitted: FittedLaw, u: float) -> float:
    """Return the deviation of the linear growth rate at a detuning, 1/s."""
    slopes = fitted.law.linear_terms(u)
    return math.sqrt(max(float(slopes @ law_covariance(fitted.fit) @ slopes), 0.0))


def critical_speed_bound(fitted: FittedLaw) -> float:
    """
    Smallest deviation v_c can have under the law, m/s: by the information alone.

    Parameters
    ----------
    fitted : FittedLaw
        The law.

    Returns
    -------
    float
        NaN where the law has no critical speed.

    References
    ----------
    Cramer, H. (1946), Mathematical Methods of Statistics, Sect. 32.3.
    """
    law = fitted.law
    if law.critical_speed is None or not np.isfinite(fitted.fit.information).all():
        return math.nan
    u = float(law.detuning(law.critical_speed))
    return law.scales.speed * linear_growth_std(fitted, u) / float(law.linear_slope(u))


def _degrees(fit: TrajectoryFit) -> float:
    """Degrees of freedom of the variances of a law: draws of it are Student's."""
    if not np.isfinite(fit.information).all():
        return 2.0
    apart = fit.problem.spread[1:3].max() > _APART
    return min(_DEGREES, float(max(len(fit.own) - 1, 2))) if apart else _DEGREES


def _away(
    fitted: FittedLaw,
    covariance: NDArray[np.float64],
    normal: NDArray[np.float64],
    scale: NDArray[np.float64],
) -> NDArray[np.float64]:
    """
    Turn normal numbers into what draws differ by from the law, shape (n, 10).

    No saturation is negative: its distribution is cut there, and where the bound holds it is the
    flank of one whose top lies beyond. The other coefficients follow it as they do in the fit.
    """
    k, variance = SATURATION, covariance[SATURATION, SATURATION]
    follow = covariance[:, k] / variance
    std, top = math.sqrt(variance) * scale, fitted.fit.beyond
    held = -(fitted.law.p[k] + top) / std
    share = stats.norm.sf(held)
    beyond = stats.norm.isf(share * stats.norm.cdf(normal[:, k]))
    saturation = np.maximum(top + std * np.where(share > 0.0, beyond, held), -fitted.law.p[k])
    rest = covariance_root(covariance - np.outer(follow, follow) * variance)
    away: NDArray[np.float64] = (normal * scale[:, None]) @ rest.T + np.outer(saturation, follow)
    return away


def _moved(
    fitted: FittedLaw,
    theta: NDArray[np.float64],
    stretch: float,
    admissible: Callable[[GrowthLaw], bool] | None,
    generator: np.random.Generator,
) -> NDArray[np.float64]:
    """
    Move draws to where the likelihood, stretched, wants them, shape (n, 15).

    Half of them at a time step along differences of two of the others, and each step is taken
    with the probability of Metropolis.

    References
    ----------
    ter Braak, C. J. F. (2006), Stat. Comput. 16, 239-249: differential evolution.
    """
    fit, problem, count = fitted.fit, fitted.fit.problem, len(theta)
    rounds = _WINDOWS // (_DRAWS * problem.path.time.size)
    if not rounds or count < theta.shape[1] or not np.isfinite(fit.information).all():
        return theta
    at, usual = (
        problem.expand(fit.theta, fit.own),
        2.38 / math.sqrt(2.0 * np.count_nonzero(problem.widths)),
    )

    def log_density(one: NDArray[np.float64]) -> float:
        """Return the log posterior, where the recordings' own follows."""
        law = replace(fitted.law, p=one[:TERMS])
        if not (problem.allowed(one) and (admissible is None or admissible(law))):
            return -math.inf
        away = one - fit.theta
        vague = 0.5 * float(np.sum((away[-3:] / VAGUE_NOISE) ** 2))
        return -(problem.objective(one, fit.own + at.follow(away, 0.0)) + vague) / stretch**2

    reached = np.array([log_density(one) for one in theta])
    halves = np.arange(0, count, 2), np.arange(1, count, 2)
    for mine, others in (halves, halves[::-1]) * rounds:
        first, second = theta[generator.choice(others, (2, mine.size))]
        step = usual * np.exp(0.5 * generator.standard_normal((mine.size, 1)))
        trial = theta[mine] + step * (first - second)
        trial[:, SATURATION] = np.abs(trial[:, SATURATION])
        value = np.array([log_density(one) for one in trial])
        with np.errstate(invalid='ignore'):  # from a place beyond the bounds to another
            taken = np.log(generator.random(mine.size)) < value - reached[mine]
        theta[mine[taken]], reached[mine[taken]] = trial[taken], value[taken]
    return theta


def draw_laws(
    fitted: FittedLaw,
    settings: IdentificationSettings,
    stretch: float = 1.0,
    admissible: Callable[[GrowthLaw], bool] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """
    Draw laws as the data leave them open, and the noise beside them.

    Parameters
    ----------
    fitted : FittedLaw
        The law.
    settings : IdentificationSettings
        For the seed, and how well the scale of the speed is known.
    stretch : float
        Further factor on all deviations, for a law that misses more than chance does.
    admissible : callable, optional
        Whether a law can be one of a rig, and of this one by what was seen.

    Returns
    -------
    p : ndarray, shape (n, 10)
        Coefficients: Student draws, moved by the likelihood.
    noise : ndarray, shape (n, 5)
        Forcing and noise of each.
    rejected : float
        Share of the draws that was rejected.
    """
    covariance = law_covariance(fitted.fit)
    degrees, generator = _degrees(fitted.fit), np.random.default_rng(settings.seed)
    normal = generator.standard_normal((_TRIES * _DRAWS, TERMS))
    scale = stretch * np.sqrt(degrees / generator.chisquare(degrees, len(normal)))
    drawn: list[NDArray[np.float64]] = []
    tried = 0
    for away in _away(fitted, covariance, normal, scale):
        tried += 1
        if admissible is None or admissible(replace(fitted.law, p=fitted.law.p + away)):
            drawn.append(away)
            if len(drawn) == _DRAWS:
                break
    scales = settings.speed_scale_std * generator.standard_normal(len(drawn))
    away = np.array(drawn).reshape(-1, TERMS)
    noise = _beside(fitted, away, generator.standard_normal((len(away), ALL_TERMS - TERMS)))
    theta = np.hstack([fitted.law.p + away, noise])
    theta = _moved(fitted, theta, stretch, admissible, generator)
    told = np.einsum('nij,nj->ni', reading(0.0, scales), theta[:, :TERMS])
    return told, theta[:, TERMS:], 1.0 - len(drawn) / tried


def summary(
    value: float, sample: NDArray[np.float64], extra_std: float = 0.0, least: float = EXISTS
) -> Uncertain | None:
    """
    Turn a value and its draws into a number with its interval.

    Parameters
    ----------
    value : float
        The estimate itself.
    sample : ndarray, shape (n,)
        Draws; NaN where a draw has no such quantity.
    extra_std : float
        Independent deviation to add (resolution of the speed).
    least : float
        Share of the draws that must have the quantity.

    Returns
    -------
    Uncertain or None
        None where too many draws say that there is no such quantity.
    """
    known = sample[np.isfinite(sample)]
    if not math.isfinite(value) or known.size < max(least * sample.size, ENOUGH_DRAWS):
        return None
    low, below, above, high = (float(x) for x in np.percentile(known, [2.5, 15.87, 84.13, 97.5]))
    # Half-widths add in squares with what does not come from the fit.
    under = math.hypot(max(value - low, 0.0), NORMAL_95 * extra_std)
    over = math.hypot(max(high - value, 0.0), NORMAL_95 * extra_std)
    std = math.hypot(0.5 * (above - below), extra_std)
    return Uncertain(float(value), std, value - under, value + over)
