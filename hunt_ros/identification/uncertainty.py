"""
Intervals: cluster-robust variances, and what they make of speeds and branches.

The residuals of one run hang together, so that variances that count samples are too
small. The sandwich of scores summed over runs (or blocks of a run) does not care how.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hunt_ros.identification.trajectory_fit import TrajectoryFit
from hunt_ros.samples import Uncertain

#: With fewer independent runs than this the intervals are widened, and say so.
ENOUGH_RUNS = 8


@dataclass(frozen=True, eq=False)
class Covariance:
    """
    Covariance of the growth law.

    Parameters
    ----------
    matrix : ndarray, shape (terms, terms)
    degrees : float
        Degrees of freedom of its variances: quantiles are Student's.
    condition_number : float
        Of the information on the law, scaled to unit diagonal.
    """

    matrix: NDArray[np.float64]
    degrees: float
    condition_number: float

    @property
    def quantile(self) -> float:
        """Student's 97.5 % quantile."""
        return float(stats.t.ppf(0.975, self.degrees))


def robust_covariance(fit: TrajectoryFit, runs: int) -> Covariance:
    """
    Cluster-robust covariance of the growth law, never below the model's own.

    Parameters
    ----------
    fit : TrajectoryFit
        With its scores by cluster.
    runs : int
        Independent runs among the clusters; with fewer than `ENOUGH_RUNS` the blocks of
        a run stand in for runs and the variances are widened.

    Returns
    -------
    Covariance

    References
    ----------
    Cameron, A. C., Miller, D. L. (2015), J. Human Resources 50, 317-372, Sects. II, VI.
    """
    terms = fit.theta.size - 3
    inverse = np.linalg.pinv(fit.information, rcond=1e-13, hermitian=True)
    active = np.flatnonzero(np.abs(fit.scores).sum(axis=1) > 0.0)
    count = active.size
    model = inverse[:terms, :terms]
    covariance: NDArray[np.float64] = model
    if count > 1:
        scores = fit.scores[active]
        scores = scores - scores.mean(axis=0)
        meat = scores.T @ scores * count / (count - 1)
        sandwich = (inverse @ meat @ inverse)[:terms, :terms]
        robust, plain = np.sqrt(np.diag(sandwich)), np.sqrt(np.diag(model))
        if np.all(robust > 0.0):
            stretch = np.maximum(plain / robust, 1.0)
            covariance = sandwich * np.outer(stretch, stretch)
    degrees = float(max(count - 1, 2))
    if runs < ENOUGH_RUNS:
        covariance = covariance * (1.0 + 0.5 / max(runs, 1))
        degrees = min(degrees, 12.0)
    diagonal = np.sqrt(np.maximum(np.diag(fit.information)[:terms], 1e-300))
    scaled = fit.information[:terms, :terms] / np.outer(diagonal, diagonal)
    return Covariance(covariance, degrees, float(np.linalg.cond(scaled)))


def jacobian(
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    point: NDArray[np.float64],
    widths: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Derivative of a vector function by central differences over a tenth of `widths`."""
    columns = []
    for j in range(point.size):
        step = max(0.1 * float(widths[j]), 1e-7 * max(abs(float(point[j])), 1e-3))
        above, below = point.copy(), point.copy()
        above[j] += step
        below[j] -= step
        columns.append((function(above) - function(below)) / (2.0 * step))
    return np.stack(columns, axis=-1)


def draws(
    centre: NDArray[np.float64], covariance: Covariance, count: int, seed: int
) -> NDArray[np.float64]:
    """Student draws of the law, shape (count, terms): normal ones over a chi-square."""
    generator = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(covariance.matrix)
    root = vectors * np.sqrt(np.clip(values, 0.0, None))
    normal = generator.standard_normal((count, centre.size))
    degrees = covariance.degrees
    scale = np.sqrt(degrees / generator.chisquare(degrees, count))
    drawn: NDArray[np.float64] = centre + (normal * scale[:, None]) @ root.T
    return drawn


def summary(
    value: float, sample: NDArray[np.float64], extra_std: float = 0.0, least: float = 0.8
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
        Independent deviation to add (scale and resolution of the speed).
    least : float
        Share of the draws that must have the quantity.

    Returns
    -------
    Uncertain or None
        None where too many draws say that there is no such quantity.
    """
    known = sample[np.isfinite(sample)]
    if not math.isfinite(value) or known.size < least * sample.size:
        return None
    low, high = (float(x) for x in np.percentile(known, [2.5, 97.5]))
    # Half-widths add in squares with what does not come from the fit.
    below = math.hypot(max(value - low, 0.0), 1.96 * extra_std)
    above = math.hypot(max(high - value, 0.0), 1.96 * extra_std)
    quartiles = np.percentile(known, [15.87, 84.13])
    std = math.hypot(0.5 * float(quartiles[1] - quartiles[0]), extra_std)
    return Uncertain(value, std, value - below, value + above)
