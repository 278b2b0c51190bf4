"""
The fit: maximum likelihood of the measured paths, by Fisher scoring.

With negligible process noise it is the trajectory fit by nonlinear least squares. Score
and information are kept for each cluster, so that robust variances and bootstrap
replications come from the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.identification.damping_bias import damping_correction
from hunt_ros.identification.path import Path
from hunt_ros.identification.path_likelihood import NOISE_TERMS, innovations

#: A prior: function of the law's coefficients, expected value, standard deviation.
Prior = tuple[Callable[[NDArray[np.float64]], float], float, float]

#: Standard deviations of the prior on d ln Q / du, forcing that rises with a power of v, and
#: on d ln Q / dw; and where they end: forcing is no other than that, it cannot stand in for
#: what the law fails to follow.
_SLOPES = np.array([3.0, 0.5])
_STEEPEST = np.array([9.0, 1.0])
#: Gain of the log likelihood below which a fit stands: a thirtieth of a deviation.
_GAIN = 1e-3
#: Relative step of the differences: large against the steps in which the number of points of
#: the integration changes, small against a deviation.
_DIFFERENCE = 3e-4
#: Gain of the log likelihood still in reach at which a fit has converged: it is within a
#: third of a deviation of the top.
_REACHED = 0.05
#: Bounds of ln Q, ln R, ln phase noise: beyond them nothing changes any more.
_LOG_LOW, _LOG_HIGH = -32.0, 5.0


@dataclass(frozen=True, eq=False)
class TrajectoryFit:
    """
    A fitted growth law.

    Parameters
    ----------
    theta : ndarray, shape (terms + 5,)
        Law, then the noise as in `path_likelihood.innovations`.
    information : ndarray, shape (terms + 5, terms + 5)
        Fisher information, with the priors.
    scores : ndarray, shape (clusters, terms + 5)
        Gradient of the log likelihood of each cluster at `theta`.
    log_likelihood : float
    innovations : ndarray, shape (n, 4)
    iterations : int
    remaining : float
        Gain of the log likelihood that the last step still promises, within the bounds.
    correction : ndarray, shape (terms,)
        What to add to the law for the bias of the damping of its quiet motion.
    """

    theta: NDArray[np.float64]
    information: NDArray[np.float64]
    scores: NDArray[np.float64]
    log_likelihood: float
    innovations: NDArray[np.float64]
    iterations: int
    remaining: float
    correction: NDArray[np.float64]

    @property
    def converged(self) -> bool:
        """Whether the fit stands at a maximum: elsewhere its information says nothing."""
        return self.remaining < _REACHED

    @property
    def law(self) -> NDArray[np.float64]:
        """Coefficients of the growth law, freed from the bias of the damping."""
        law: NDArray[np.float64] = self.theta[:-NOISE_TERMS] + self.correction
        return law


@dataclass(frozen=True, eq=False)
class _Expansion:
    value: float
    gradient: NDArray[np.float64]
    information: NDArray[np.float64]
    scores: NDArray[np.float64]
    innovations: NDArray[np.float64]
    derivative: NDArray[np.float64]


def _objective(
    theta: NDArray[np.float64],
    path: Path,
    weight: NDArray[np.float64],
    scale: NDArray[np.float64],
    priors: Sequence[Prior],
) -> float:
    """Negative log posterior, and never NaN."""
    out = innovations(theta, path)
    value = 0.5 * float(np.sum(weight[:, None] * (out[:, :2] ** 2 + out[:, 2:])))
    value += 0.5 * float(np.sum((theta[: scale.size] / scale) ** 2))
    for function, mean, std in priors:
        value += 0.5 * ((function(theta[:-NOISE_TERMS]) - mean) / std) ** 2
    return value if np.isfinite(value) else float('inf')


def _expand(
    theta: NDArray[np.float64],
    path: Path,
    weight: NDArray[np.float64],
    scale: NDArray[np.float64],
    priors: Sequence[Prior],
    central: bool,
) -> _Expansion:
    """Value, gradient, expected information and scores by cluster, by differences."""
    n = theta.size
    base = innovations(theta, path)
    derivative = np.empty((n, *base.shape))
    for j in range(n):
        h = _DIFFERENCE * max(abs(theta[j]), 0.1)
        above, below = theta.copy(), theta.copy()
        above[j] += h
        below[j] -= h
        if central:
            derivative[j] = (innovations(above, path) - innovations(below, path)) / (2.0 * h)
        else:
            derivative[j] = (innovations(above, path) - base) / h
    e, d_e, d_l = base[:, :2], derivative[:, :, :2], derivative[:, :, 2:]
    point = -np.einsum('jnc,nc->nj', d_e, e) - 0.5 * d_l.sum(axis=2).T
    scores = np.zeros((path.clusters, n))
    np.add.at(scores, path.cluster, weight[:, None] * point)
    root = np.sqrt(weight)[None, :, None]
    mean = ((d_e + 0.5 * e[None] * d_l) * root).reshape(n, -1)
    spread = (d_l * root).reshape(n, -1)
    information = mean @ mean.T + 0.5 * spread @ spread.T
    gradient = scores.sum(axis=0)
    law = theta[:-NOISE_TERMS]
    weak = np.arange(scale.size)
    gradient[weak] -= theta[weak] / scale**2
    information[weak, weak] += 1.0 / scale**2
    for function, expected, std in priors:
        slope = np.zeros(n)
        for j in range(law.size):
            h = 1e-5 * max(abs(law[j]), 0.1)
            above, below = law.copy(), law.copy()
            above[j] += h
            below[j] -= h
            slope[j] = (function(above) - function(below)) / (2.0 * h)
        if np.isfinite(slope).all():
            gradient -= slope * (function(law) - expected) / std**2
            information += np.outer(slope, slope) / std**2
    value = _objective(theta, path, weight, scale, priors)
    return _Expansion(value, gradient, information, scores, base, d_e)


def _remaining(theta: NDArray[np.float64], at: _Expansion) -> float:
    """
    Half the squared Newton decrement over what no bound holds; inf where it cannot be told.

    References
    ----------
    Boyd, S., Vandenberghe, L., Convex Optimization (2004), Sect. 9.5.1.
    """
    if not (np.isfinite(at.information).all() and np.isfinite(at.gradient).all()):
        return float('inf')
    free = _free(theta, at.gradient)
    pull, block = at.gradient[free], at.information[np.ix_(free, free)]
    size = np.sqrt(np.maximum(np.diag(block), 1e-12))
    scaled = np.linalg.pinv(block / np.outer(size, size), rcond=1e-13, hermitian=True)
    return 0.5 * float(pull / size @ scaled @ (pull / size))


def _free(theta: NDArray[np.float64], gradient: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Parameters that no bound holds against the gradient."""
    low, high = _bounds(theta.size)
    free: NDArray[np.bool_] = ~((theta <= low) & (gradient < 0.0))
    return free & ~((theta >= high) & (gradient > 0.0))


def _bounds(terms: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest value of each parameter; the law itself has no bounds."""
    high = np.full(terms, np.inf)
    low = -high
    low[-NOISE_TERMS:] = *(-_STEEPEST), *np.full(3, _LOG_LOW)
    high[-NOISE_TERMS:] = *_STEEPEST, *np.full(3, _LOG_HIGH)
    return low, high


def fit_path(
    path: Path,
    start: NDArray[np.float64],
    scale: NDArray[np.float64],
    priors: Sequence[Prior] = (),
    cluster_weight: NDArray[np.float64] | None = None,
    iterations: int = 60,
) -> TrajectoryFit:
    """
    Fit a growth law to a path.

    Parameters
    ----------
    path : Path
        The measured envelope.
    start : ndarray, shape (terms + 5,)
        Law and noise to start from.
    scale : ndarray, shape (terms,)
        Standard deviations of the weak prior on the coefficients of the law, 1/s: no mode
        that still oscillates grows faster than its own angular frequency.
    priors : sequence of Prior
        What is known from elsewhere.
    cluster_weight : ndarray, shape (clusters,), optional
        Weight of each cluster: how often the bootstrap drew it.
    iterations : int
        At most.

    Returns
    -------
    TrajectoryFit

    References
    ----------
    Fisher scoring with Levenberg's damping; the likelihood is that of the extended Kalman
    filter (Ljung, L., System Identification, 1999, Sect. 7.4).
    """
    terms = scale.size
    scale = np.concatenate([scale, _SLOPES])
    weight = np.ones(path.time.size) if path.weight is None else path.weight
    if cluster_weight is not None:
        weight = weight * cluster_weight[path.cluster]
    low, high = _bounds(terms + NOISE_TERMS)
    theta = np.clip(np.array(start, dtype=np.float64), low, high)
    # One-sided differences climb at half the cost; two-sided ones find the top.
    central = False
    current = _expand(theta, path, weight, scale, priors, central)
    damping = 1e-3
    stalled = False
    count = 0
    while count < iterations:
        if stalled or _remaining(theta, current) < _GAIN:
            if central:
                break
            central, stalled = True, False
            current = _expand(theta, path, weight, scale, priors, central)
            continue
        count += 1
        stalled = True
        # What a bound holds stays there: a step that is cut at a bound leads nowhere.
        free = _free(theta, current.gradient)
        block = current.information[np.ix_(free, free)]
        for _ in range(12):
            matrix = block + damping * np.diag(np.maximum(np.diag(block), 1e-9))
            step = np.zeros(theta.size)
            step[free] = np.linalg.solve(matrix, current.gradient[free])
            # A law an order away from the last one has left the hill it was climbing.
            size = np.maximum(np.abs(theta[:terms]), 0.05 * scale[:terms])
            longest = np.max(np.abs(step[:terms]) / size)
            step *= min(1.0, 0.7 / longest) if longest > 0.0 else 1.0
            step[-3:] = np.clip(step[-3:], -1.0, 2.0)
            trial = np.clip(theta + step, low, high)
            value = _objective(trial, path, weight, scale, priors)
            if value < current.value:
                stalled = current.value - value < 0.1 * _GAIN
                theta = trial
                damping = max(damping / 8.0, 1e-9)
                current = _expand(theta, path, weight, scale, priors, central)
                break
            damping *= 6.0
    return TrajectoryFit(
        theta,
        current.information,
        current.scores,
        -current.value,
        current.innovations,
        count,
        _remaining(theta, current),
        damping_correction(theta, path, current.derivative, current.information),
    )
