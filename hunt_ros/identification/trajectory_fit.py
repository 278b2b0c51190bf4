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

from hunt_ros.identification.path_likelihood import Path, innovations

#: A prior: function of the law's coefficients, expected value, standard deviation.
Prior = tuple[Callable[[NDArray[np.float64]], float], float, float]

#: Bounds of ln Q, ln R, ln phase noise: beyond them nothing changes any more.
_LOG_LOW, _LOG_HIGH = -32.0, 5.0


@dataclass(frozen=True, eq=False)
class TrajectoryFit:
    """
    A fitted growth law.

    Parameters
    ----------
    theta : ndarray, shape (terms + 3,)
        Law, then ln Q, ln R, ln phase noise.
    information : ndarray, shape (terms + 3, terms + 3)
        Fisher information, with the priors.
    scores : ndarray, shape (clusters, terms + 3)
        Gradient of the log likelihood of each cluster at `theta`.
    log_likelihood : float
    innovations : ndarray, shape (n, 4)
    iterations : int
    converged : bool
    """

    theta: NDArray[np.float64]
    information: NDArray[np.float64]
    scores: NDArray[np.float64]
    log_likelihood: float
    innovations: NDArray[np.float64]
    iterations: int
    converged: bool

    @property
    def law(self) -> NDArray[np.float64]:
        """Coefficients of the growth law."""
        return self.theta[:-3]


@dataclass(frozen=True, eq=False)
class _Expansion:
    value: float
    gradient: NDArray[np.float64]
    information: NDArray[np.float64]
    scores: NDArray[np.float64]
    innovations: NDArray[np.float64]


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
    value += 0.5 * float(np.sum((theta[:-3] / scale) ** 2))
    for function, mean, std in priors:
        value += 0.5 * ((function(theta[:-3]) - mean) / std) ** 2
    return value if np.isfinite(value) else float('inf')


def _expand(
    theta: NDArray[np.float64],
    path: Path,
    weight: NDArray[np.float64],
    scale: NDArray[np.float64],
    priors: Sequence[Prior],
) -> _Expansion:
    """Value, gradient, expected information and scores by cluster, by central differences."""
    n = theta.size
    base = innovations(theta, path)
    derivative = np.empty((n, *base.shape))
    for j in range(n):
        h = 1e-4 * max(abs(theta[j]), 0.1)
        above, below = theta.copy(), theta.copy()
        above[j] += h
        below[j] -= h
        derivative[j] = (innovations(above, path) - innovations(below, path)) / (2.0 * h)
    e, d_e, d_l = base[:, :2], derivative[:, :, :2], derivative[:, :, 2:]
    point = -np.einsum('jnc,nc->nj', d_e, e) - 0.5 * d_l.sum(axis=2).T
    scores = np.zeros((path.clusters, n))
    np.add.at(scores, path.cluster, weight[:, None] * point)
    root = np.sqrt(weight)[None, :, None]
    mean = ((d_e + 0.5 * e[None] * d_l) * root).reshape(n, -1)
    spread = (d_l * root).reshape(n, -1)
    information = mean @ mean.T + 0.5 * spread @ spread.T
    gradient = scores.sum(axis=0)
    law = theta[:-3]
    gradient[:-3] -= law / scale**2
    information[np.arange(n - 3), np.arange(n - 3)] += 1.0 / scale**2
    for function, expected, std in priors:
        slope = np.zeros(n)
        for j in range(n - 3):
            h = 1e-5 * max(abs(law[j]), 0.1)
            above, below = law.copy(), law.copy()
            above[j] += h
            below[j] -= h
            slope[j] = (function(above) - function(below)) / (2.0 * h)
        if np.isfinite(slope).all():
            gradient -= slope * (function(law) - expected) / std**2
            information += np.outer(slope, slope) / std**2
    value = _objective(theta, path, weight, scale, priors)
    return _Expansion(value, gradient, information, scores, base)


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
    start : ndarray, shape (terms + 3,)
        Law and log variances to start from.
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
    weight = np.ones(path.time.size) if path.weight is None else path.weight
    if cluster_weight is not None:
        weight = weight * cluster_weight[path.cluster]
    theta = np.array(start, dtype=np.float64)
    theta[-3:] = np.clip(theta[-3:], _LOG_LOW, _LOG_HIGH)
    current = _expand(theta, path, weight, scale, priors)
    damping = 1e-3
    done = False
    count = 0
    while count < iterations and not done:
        count += 1
        improved = False
        for _ in range(12):
            matrix = current.information + damping * np.diag(
                np.maximum(np.diag(current.information), 1e-9)
            )
            step = np.linalg.solve(matrix, current.gradient)
            # A law an order away from the last one has left the hill it was climbing.
            longest = np.max(np.abs(step[:-3]) / np.maximum(np.abs(theta[:-3]), 0.05 * scale))
            step *= min(1.0, 0.7 / longest) if longest > 0.0 else 1.0
            step[-3:] = np.clip(step[-3:], -1.0, 2.0)
            trial = theta + step
            trial[-3:] = np.clip(trial[-3:], _LOG_LOW, _LOG_HIGH)
            value = _objective(trial, path, weight, scale, priors)
            if value < current.value:
                improved = True
                break
            damping *= 6.0
        if not improved:
            done = True
            break
        gain = current.value - value
        theta = trial
        damping = max(damping / 8.0, 1e-9)
        current = _expand(theta, path, weight, scale, priors)
        done = gain < 1e-4
    return TrajectoryFit(
        theta,
        current.information,
        current.scores,
        -current.value,
        current.innovations,
        count,
        done,
    )
