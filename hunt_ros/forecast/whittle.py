"""
Maximum of a Whittle likelihood with priors, by Fisher scoring.

The bins of a periodogram are nearly independent and exponentially distributed
about the spectrum; their likelihood needs the spectrum alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.forecast.response_spectrum import (
    ResponseLaw,
    Spectra,
    expected_periodogram,
    own_bins,
)
from hunt_ros.samples import NORMAL_95, Uncertain

_STEP = 1e-4

#: A fit is not refined with fewer bins than this.
FEWEST_BINS = 30

#: Decay times in a window beyond which its bins count as independent.
INDEPENDENT = 15.0


@dataclass(frozen=True, eq=False)
class WhittleFit:
    """
    Where the likelihood is largest, and how sharply.

    Parameters
    ----------
    theta : ndarray, shape (p,)
    covariance : ndarray, shape (p, p)
        Of theta: the inverse of Fisher information and prior; from `best_fit` with the
        correlation of neighbouring bins.
    cost : float
        Negative logarithm of likelihood times prior.
    misfit : float
        Mean square of the standardised residuals of groups of bins; 1 for the right law.
    expected : ndarray, shape (bins,)
        The periodogram expected, m^2 s.
    spectra : Spectra
        The bins used: from `best_fit`, without those that show leakage.
    """

    theta: NDArray[np.float64]
    covariance: NDArray[np.float64]
    cost: float
    misfit: float
    expected: NDArray[np.float64]
    spectra: Spectra


def _cost(
    law: ResponseLaw, spectra: Spectra, theta: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64]]:
    """Return -ln of likelihood times prior, inf where the law is unstable, and the spectra."""
    expected = expected_periodogram(law, spectra, theta)
    if expected is None:
        return np.inf, np.zeros(0)
    fit = float(np.sum(spectra.weight * (np.log(expected) + spectra.power / expected)))
    away = (theta - law.prior_mean) / law.prior_std
    return fit + 0.5 * float(away @ away), expected


def information(
    law: ResponseLaw,
    spectra: Spectra,
    theta: NDArray[np.float64],
    expected: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Fisher information of a law with its prior, and the derivatives of ln S.

    Returns
    -------
    information : ndarray, shape (p, p)
        sum over bins of d ln S/d theta_i d ln S/d theta_j, plus the prior's.
    derivatives : ndarray, shape (bins, p)

    References
    ----------
    Whittle 1953, Estimation and information in stationary time series.
    """
    derivatives = np.zeros((expected.size, theta.size))
    for k in range(theta.size):
        for step in (_STEP, -_STEP):
            moved = theta.copy()
            moved[k] += step
            there = expected_periodogram(law, spectra, moved)
            if there is not None:
                derivatives[:, k] = np.log(there / expected) / step
                break
    fisher = (derivatives * spectra.weight[:, None]).T @ derivatives
    return fisher + np.diag(law.prior_std**-2.0), derivatives


def maximise(
    law: ResponseLaw,
    spectra: Spectra,
    start: NDArray[np.float64],
    evaluations: int = 60,
) -> WhittleFit | None:
    """
    Climb the likelihood from `start` (Levenberg-Marquardt on the Fisher information).

    Returns
    -------
    WhittleFit or None
        None where the start makes no stationary response.
    """
    theta = start.copy()
    cost, expected = _cost(law, spectra, theta)
    if not np.isfinite(cost):
        return None
    damping = 1e-2
    while True:
        fisher, derivatives = information(law, spectra, theta, expected)
        pull = derivatives.T @ (spectra.weight * (spectra.power / expected - 1.0))
        pull -= (theta - law.prior_mean) / law.prior_std**2
        better = False
        while not better and damping < 1e8 and evaluations > 0:
            step = np.linalg.solve(fisher + damping * np.diag(np.diag(fisher)), pull)
            moved = theta + np.clip(step, -0.5, 0.5)
            new_cost, there = _cost(law, spectra, moved)
            evaluations -= 1
            better = new_cost < cost
            damping = max(damping / 5.0, 1e-9) if better else max(damping * 5.0, 1e-6)
        gain = cost - new_cost if better else 0.0
        if better:
            theta, cost, expected = moved, new_cost, there
        if gain < 1e-4 or evaluations <= 0:
            break
    covariance = np.asarray(np.linalg.inv(fisher), dtype=np.float64)
    return WhittleFit(theta, covariance, cost, _misfit(spectra, expected), expected, spectra)


def _covariance(
    law: ResponseLaw,
    spectra: Spectra,
    theta: NDArray[np.float64],
    expected: NDArray[np.float64],
) -> NDArray[np.float64]:
    """
    Covariance of the estimate, with the correlation of neighbouring bins (Godambe 1960).

    H^-1 J H^-1 with J the variance of the score: equal to H^-1 for independent bins.
    """
    fisher, derivatives = information(law, spectra, theta, expected)
    inverse = np.asarray(np.linalg.inv(fisher), dtype=np.float64)
    modes = law.modes(spectra.speed, theta)
    assert modes is not None  # theta was fitted
    score = np.diag(law.prior_std**-2.0)
    for level in range(spectra.speed.size):
        inside = spectra.level == level
        # The windows averaged in a level are independent: their weight counts once.
        pull = derivatives[inside] * np.sqrt(spectra.weight[inside])[:, None]
        slowest = float(np.min(-modes[0][level].real)) * float(spectra.duration[level])
        if slowest > INDEPENDENT:
            score += pull.T @ pull
        else:
            score += pull.T @ spectra.correlation_of_bins(level, *modes, expected) @ pull
    return np.asarray(inverse @ score @ inverse, dtype=np.float64)


def best_fit(
    law: ResponseLaw, spectra: Spectra, before: NDArray[np.float64] | None = None
) -> WhittleFit | None:
    """Return the best of the fits from all starts of the law, and from the fit `before`."""
    starts = law.starts(spectra)
    fits = [maximise(law, spectra, start) for start in starts]
    if before is not None:
        fits.append(maximise(law, spectra, before))
    found = [fit for fit in fits if fit is not None]
    if not found:
        return None
    best = min(found, key=lambda fit: fit.cost)
    for _ in range(2):
        kept = own_bins(law, spectra, best.theta)
        if kept.sum() < FEWEST_BINS:
            break
        refined = maximise(law, spectra.only(kept), best.theta)
        if refined is None:
            break
        best = refined
    return replace(best, covariance=_covariance(law, best.spectra, best.theta, best.expected))


def _misfit(spectra: Spectra, expected: NDArray[np.float64], group: int = 24) -> float:
    """Mean square of (mean of power/expected - 1) in groups of bins, in its own deviations."""
    squares = []
    ratio = spectra.power / expected - 1.0
    for level in range(spectra.speed.size):
        inside = np.flatnonzero(spectra.level == level)
        for part in np.array_split(inside, max(inside.size // group, 1)):
            if part.size:
                weight = spectra.weight[part]
                squares.append(float((weight * ratio[part]).sum() ** 2 / weight.sum()))
    return float(np.mean(squares)) if squares else 0.0


def critical_interval(law: ResponseLaw, fit: WhittleFit, fastest: float) -> Uncertain:
    """
    v_c with its 95 % interval.

    The interval is symmetric in ln(v_c / v' - 1) with v' = 0.9 times the highest speed
    seen, or v_c where that is lower: the further the extrapolation, the more it is open
    towards high speeds.
    """
    value = law.critical_speed(fit.theta)
    if not math.isfinite(value):
        return Uncertain(value, math.inf, 0.0, math.inf)
    reference = 0.9 * min(fastest, value)
    slope = np.empty(fit.theta.size)
    for k in range(slope.size):
        moved = fit.theta.copy()
        moved[k] += 1e-4
        slope[k] = math.log(law.critical_speed(moved) / value) / 1e-4
    spread = math.sqrt(max(float(slope @ fit.covariance @ slope), 0.0) * max(fit.misfit, 1.0))
    beyond = value / reference - 1.0
    scaled = spread * value / (reference * beyond)
    low, high = (
        reference * (1.0 + beyond * math.exp(sign * min(NORMAL_95 * scaled, 30.0)))
        for sign in (-1.0, 1.0)
    )
    return Uncertain(value, spread * value, low, high)
