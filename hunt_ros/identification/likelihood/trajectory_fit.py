"""
The fit: maximum likelihood of the measured paths, by Fisher scoring.

With negligible process noise it is the trajectory fit by nonlinear least squares. Score
and information are kept for each cluster, so that robust variances come from the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.covariance_root import inverse_of
from hunt_ros.identification.growth_law import FELT, PAPER_TERMS, TERMS, LawPrior
from hunt_ros.identification.likelihood.damping_bias import damping_correction
from hunt_ros.identification.likelihood.path import Path
from hunt_ros.identification.likelihood.path_likelihood import (
    ALL_TERMS,
    NOISE_TERMS,
    innovations,
    sensitivities,
)

#: A prior: function of the law's coefficients, expected value, standard deviation.
Prior = tuple[Callable[[NDArray[np.float64]], float], float, float]

#: Standard deviations of the prior on d ln Q / du, forcing that rises with a power of v, and
#: on d ln Q / dw; and where they end: forcing is no other than that, it cannot stand in for
#: what the law fails to follow.
_SLOPES = np.array([3.0, 0.5])
_STEEPEST = np.array([9.0, 1.0])
#: Gain of the log likelihood below which a fit stands: a thirtieth of a deviation.
_GAIN = 1e-3
#: Largest share of the roller's line that the wheelset may feel: a line acts as it is seen, or
#: less where it is run-out of the sensor; more only by an error of the sensor.
_MOST_FELT = 3.0
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
    theta : ndarray, shape (11 + 5,)
        Law, then the noise as in `path_likelihood.innovations`.
    information : ndarray, shape (16, 16)
        Fisher information, with the priors.
    scores : ndarray, shape (clusters, 16)
        Gradient of the log likelihood of each cluster at `theta`.
    log_likelihood : float
    innovations : ndarray, shape (n, 4)
    iterations : int
    remaining : float
        Gain of the log likelihood that the last step still promises, within the bounds.
    correction : ndarray, shape (11,)
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
    """The log likelihood about a point: gradient, information, and what the paths add to them."""

    value: float
    gradient: NDArray[np.float64]
    information: NDArray[np.float64]
    scores: NDArray[np.float64]
    innovations: NDArray[np.float64]
    derivative: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Problem:
    """What is maximised: the likelihood of a path with what is known beforehand."""

    path: Path
    mean: NDArray[np.float64]
    std: NDArray[np.float64]
    priors: Sequence[Prior]

    @property
    def varied(self) -> NDArray[np.bool_]:
        """Parameters that are not held at the mean of their prior, shape (16,)."""
        varied: NDArray[np.bool_] = np.concatenate([self.std > 0.0, np.ones(3, dtype=bool)])
        return varied

    @property
    def told(self) -> NDArray[np.int64]:
        """Parameters with a normal prior of their own."""
        return np.flatnonzero(self.std > 0.0)

    def away(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance of these from the means of their priors, in deviations."""
        k = self.told
        distance: NDArray[np.float64] = (theta[k] - self.mean[k]) / self.std[k]
        return distance

    def value(self, theta: NDArray[np.float64], out: NDArray[np.float64]) -> float:
        """Negative log posterior of innovations found at theta, and never NaN."""
        value = 0.5 * float(np.sum(out[:, :2] ** 2 + out[:, 2:]))
        value += 0.5 * float(np.sum(self.away(theta) ** 2))
        for function, mean, std in self.priors:
            value += 0.5 * ((function(theta[:TERMS]) - mean) / std) ** 2
        return value if np.isfinite(value) else float('inf')

    def objective(self, theta: NDArray[np.float64]) -> float:
        """Negative log posterior."""
        return self.value(theta, innovations(theta, self.path))

    def expand(self, theta: NDArray[np.float64]) -> _Expansion:
        """Value, gradient, expected information and scores by cluster."""
        base, derivative = sensitivities(theta, self.path, self.varied)
        e, d_e, d_l = base[:, :2], derivative[:, :, :2], derivative[:, :, 2:]
        point = -np.einsum('jnc,nc->nj', d_e, e) - 0.5 * d_l.sum(axis=2).T
        scores = np.zeros((self.path.clusters, theta.size))
        np.add.at(scores, self.path.cluster, point)
        mean = (d_e + 0.5 * e[None] * d_l).reshape(theta.size, -1)
        spread = d_l.reshape(theta.size, -1)
        information = mean @ mean.T + 0.5 * spread @ spread.T
        gradient = scores.sum(axis=0)
        k = self.told
        gradient[k] -= self.away(theta) / self.std[k]
        information[k, k] += 1.0 / self.std[k] ** 2
        law = theta[:TERMS]
        for function, expected, std in self.priors:
            slope = np.zeros(theta.size)
            for j in range(PAPER_TERMS):
                h = 1e-5 * max(abs(law[j]), 0.1)
                above, below = law.copy(), law.copy()
                above[j] += h
                below[j] -= h
                slope[j] = (function(above) - function(below)) / (2.0 * h)
            if np.isfinite(slope).all():
                gradient -= slope * (function(law) - expected) / std**2
                information += np.outer(slope, slope) / std**2
        return _Expansion(self.value(theta, base), gradient, information, scores, base, d_e)


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
    return 0.5 * float(pull @ inverse_of(block) @ pull)


def _free(theta: NDArray[np.float64], gradient: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Parameters that no bound holds against the gradient."""
    low, high = _bounds()
    free: NDArray[np.bool_] = ~((theta <= low) & (gradient < 0.0))
    return free & ~((theta >= high) & (gradient > 0.0))


def _bounds() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest value of each parameter; the law itself has no bounds."""
    high = np.full(ALL_TERMS, np.inf)
    low = -high
    low[-NOISE_TERMS:] = *(-_STEEPEST), *np.full(3, _LOG_LOW)
    high[-NOISE_TERMS:] = *_STEEPEST, *np.full(3, _LOG_HIGH)
    low[FELT], high[FELT] = 0.0, _MOST_FELT
    return low, high


def fit_path(
    path: Path,
    start: NDArray[np.float64],
    prior: LawPrior,
    priors: Sequence[Prior] = (),
    iterations: int = 100,
) -> TrajectoryFit:
    """
    Fit the growth law to a path.

    Parameters
    ----------
    path : Path
        The measured envelope.
    start : ndarray, shape (16,)
        Law and noise to start from.
    prior : LawPrior
        What is known of the coefficients beforehand; those with no deviation are held.
    priors : sequence of Prior
        What is known from elsewhere.
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
    problem = _Problem(
        path,
        np.concatenate([prior.mean, np.zeros(_SLOPES.size)]),
        np.concatenate([prior.std, _SLOPES]),
        priors,
    )
    low, high = _bounds()
    theta = np.array(start, dtype=np.float64)
    held = np.flatnonzero(prior.std == 0.0)
    theta[held] = prior.mean[held]
    theta = np.clip(theta, low, high)
    current = problem.expand(theta)
    damping = 1e-3
    count = 0
    while count < iterations and _remaining(theta, current) > _GAIN:
        count += 1
        # What a bound holds stays there: a step that is cut at a bound leads nowhere.
        free = _free(theta, current.gradient) & problem.varied
        block = current.information[np.ix_(free, free)]
        stalled = True
        for _ in range(12):
            matrix = block + damping * np.diag(np.maximum(np.diag(block), 1e-9))
            step = np.zeros(theta.size)
            step[free] = np.linalg.solve(matrix, current.gradient[free])
            # A law an order away from the last one has left the hill it was climbing.
            size = np.maximum(np.abs(theta[:FELT]), 0.05 * prior.std[:FELT])
            longest = np.max(np.abs(step[:FELT]) / np.where(size > 0.0, size, np.inf))
            step *= min(1.0, 0.7 / longest) if longest > 0.0 else 1.0
            step[-3:] = np.clip(step[-3:], -3.0, 2.0)
            trial = np.clip(theta + step, low, high)
            value = problem.objective(trial)
            if value < current.value:
                # Along a curved ridge the step is in the right direction, and too short.
                while True:
                    further = np.clip(theta + 2.0 * (trial - theta), low, high)
                    beyond = problem.objective(further)
                    if not beyond < value - 0.1 * _GAIN:
                        break
                    trial, value = further, beyond
                stalled = current.value - value < 0.1 * _GAIN
                theta = trial
                damping = max(damping / 8.0, 1e-9)
                current = problem.expand(theta)
                break
            damping *= 6.0
        if stalled:
            break
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
