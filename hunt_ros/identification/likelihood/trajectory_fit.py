"""
The fit: maximum likelihood of the measured paths, by Fisher scoring.

With negligible process noise it is the trajectory fit by nonlinear least squares. Recordings of
one rig differ: each has a gain, a scale of the speed, a critical speed, forcing and noise of its
own, whose spread is learnt from them (`spreads`). Holds at a coarse speed differ as well, by no
more than its step. What is kept of them beside their values is the information that they leave on
the law.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.covariance_root import inverse_of
from hunt_ros.dynamics.growth_law import FELT, SATURATION, TERMS
from hunt_ros.identification.likelihood.path import Path
from hunt_ros.identification.likelihood.path_likelihood import ALL_TERMS, innovations
from hunt_ros.identification.likelihood.reading import OWN, as_read

Array = NDArray[np.float64]
#: A prior: function of the law's coefficients, expected value, standard deviation.
Prior = tuple[Callable[[Array], float], float, float]

#: Deviation of ln Q, ln R and ln phase noise from what they were found to be, at most: a factor
#: of three. Of noise too small to be seen nothing else says it.
VAGUE_NOISE = 1.1
#: Gain of the log likelihood below which a fit stands: a thirtieth of a deviation.
_GAIN = 1e-3
#: Lowest and highest value of each parameter. The wheelset may feel three times the roller's line
#: at most: a line acts as it is seen, or less where it is run-out of the sensor; more only by an
#: error of the sensor.
_LOW, _HIGH = np.full(ALL_TERMS, -np.inf), np.full(ALL_TERMS, np.inf)
_LOW[SATURATION] = _LOW[FELT] = 0.0
_HIGH[FELT] = 3.0
# Forcing that rises with a power of v (d ln Q / du), and with w: free, v_n is foretold twice as
# badly from going up alone.
_HIGH[TERMS : TERMS + 2] = 9.0, 2.0
_LOW[TERMS : TERMS + 2] = -_HIGH[TERMS : TERMS + 2]
#: Gain of the log likelihood still in reach at which a fit has converged: it is within a
#: third of a deviation of the top.
_REACHED = 0.05
#: Step of the parameters by which derivatives are taken, in widths of what is known beforehand:
#: the root of the error of rounding.
_DIFFERENCE = float(np.sqrt(np.finfo(np.float64).eps))
#: Spreads of what recordings have of their own that are tried, the least of them none at all,
#: and the scale on which a larger one is less likely beforehand.
SPREADS = np.array([1.0, 1.0, 1.0, 100.0, 100.0])[:, None] * np.geomspace(1e-4, 0.1, 19)
USUAL = np.array([0.02, 0.01, 0.01, 1.0, 1.0])
#: Farthest of these that a step of the fit tries: no two recordings of one rig differ by as much.
_FARTHEST = np.array([3.0, 3.0, 3.0, 30.0, 30.0])
#: Added to matrices of unit diagonal before they are solved.
_RIDGE = 1e-13


@dataclass(frozen=True, eq=False)
class TrajectoryFit:
    """
    A fitted growth law.

    Parameters
    ----------
    theta : ndarray, shape (10 + 5,)
        Law, then the noise as in `path_likelihood.innovations`.
    information : ndarray, shape (15, 15)
        Fisher information, with the priors; what the recordings have of their own is unknown.
    log_likelihood : float
        With the priors, and the mean over what the recordings have of their own.
    innovations : ndarray, shape (n, 4)
    remaining : float
        Gain of the log likelihood that the last step still promises, within the bounds.
    beyond : float
        How far beyond its bound the saturation would go, <= 0; 0 where the bound does not hold it.
    own : ndarray, shape (recordings, 5)
        What each recording has of its own: logarithms of measured over true amplitude and of
        true over measured speed, shift of its v_c over v_ref, logarithms of its forcing Q and
        its noise R over those of the law.
    problem : Problem
        What was maximised.
    """

    theta: NDArray[np.float64]
    information: NDArray[np.float64]
    log_likelihood: float
    innovations: NDArray[np.float64]
    remaining: float
    beyond: float
    own: NDArray[np.float64]
    problem: Problem

    @property
    def converged(self) -> bool:
        """Whether the fit stands at a maximum: elsewhere its information says nothing."""
        return self.remaining < _REACHED

    @property
    def law(self) -> NDArray[np.float64]:
        """Coefficients of the growth law."""
        law: NDArray[np.float64] = self.theta[:TERMS]
        return law


@dataclass(frozen=True, eq=False)
class _Expansion:
    """
    The log likelihood about a point.

    `gradient` and `information` are those of the law, `own_slope` and `own_block` (its prior in
    it) and `cross` those of what the recordings have of their own; `scores` are the parts of the
    gradient by recording.
    """

    value: float
    gradient: Array
    information: Array
    innovations: Array
    scores: Array
    own_slope: Array
    own_block: Array
    cross: Array

    def reduced(self, damping: float = 0.0) -> tuple[Array, Array]:
        """Return gradient and information of the law where what the recordings have follows it."""
        lean = solved(self._damped(damping), self.cross.transpose(0, 2, 1))
        with np.errstate(over='ignore', invalid='ignore'):  # of a law that runs away
            gradient = self.gradient - np.einsum('rki,rk->i', lean, self.own_slope)
            return gradient, self.information - np.einsum('rjk,rki->ji', self.cross, lean)

    def follow(self, step: Array, damping: float) -> Array:
        """Return the step of what the recordings have that goes with one of the law."""
        wanted = self.own_slope - np.einsum('rjk,j->rk', self.cross, step)
        return solved(self._damped(damping), wanted[..., None])[..., 0]

    def _damped(self, damping: float) -> Array:
        """Return the blocks as Levenberg's method damps all of the problem."""
        damped: Array = self.own_block * (1.0 + damping * np.eye(OWN))
        return damped


@dataclass(frozen=True, eq=False)
class Problem:
    """
    What is maximised: the likelihood of a path with what is known beforehand.

    `mean` and `std`, shape (12,), are those of independent normal priors on the law and on how the
    forcing changes; what has no deviation is held. `priors` say what is known from elsewhere;
    `spread`, shape (5,), has standard deviations of what recordings have of their own.
    """

    path: Path
    mean: Array
    std: Array
    priors: Sequence[Prior]
    spread: Array

    def allowed(self, theta: Array) -> bool:
        """Whether no parameter is beyond its bounds."""
        return bool(((theta >= _LOW) & (theta <= _HIGH)).all())

    @property
    def widths(self) -> Array:
        """How far each parameter may go, shape (15,); 0 for what is held."""
        return np.concatenate([self.std, np.full(3, VAGUE_NOISE)])

    @property
    def told(self) -> NDArray[np.int64]:
        """Parameters with a normal prior of their own."""
        return np.flatnonzero(self.std)

    def away(self, theta: Array) -> Array:
        """Distance of these from the means of their priors, in deviations."""
        k = self.told
        distance: Array = (theta[k] - self.mean[k]) / self.std[k]
        return distance

    @property
    def differ(self) -> bool:
        """Whether recordings have something of their own."""
        return bool(self.spread.any())

    def value(self, theta: Array, own: Array, out: Array) -> float:
        """Negative log posterior of innovations found at theta, and never NaN."""
        value = 0.5 * float(np.sum(out[:, :2] ** 2 + out[:, 2:]))
        value += 0.5 * float(np.sum(self.away(theta) ** 2))
        if self.differ:
            value += 0.5 * float(np.sum((own / self.spread) ** 2))
        for function, mean, std in self.priors:
            value += 0.5 * ((function(theta[:TERMS]) - mean) / std) ** 2
        return value if np.isfinite(value) else float('inf')

    def objective(self, theta: Array, own: Array) -> float:
        """Negative log posterior."""
        parts = [
            innovations(read, part)
            for read, part in zip(as_read(theta, own), self.path.recordings, strict=True)
        ]
        return self.value(theta, own, np.concatenate(parts))

    def expand(
        self, theta: Array, own: Array, cells: NDArray[np.int64] | None = None
    ) -> _Expansion:
        """
        Value, gradient, and expected information.

        Behind the parameters stand growth rates beside the law's, one for each of `cells`, shape
        (n,): the number of that which leads to an instant, or -1.
        """
        count, parts = 0 if cells is None else int(cells.max()) + 1, self.path.recordings
        n, ends = theta.size + count, np.cumsum([part.time.size for part in parts])
        places = [None] * len(parts) if cells is None else np.split(cells, ends[:-1])
        step = _DIFFERENCE * np.concatenate(
            [self.widths, np.full(count, self.std[0]), USUAL * self.differ]
        )
        varied = np.flatnonzero(step)
        beside = np.vstack([np.zeros(step.size), np.diag(step)[varied]])
        base, scores, information = [], [], np.zeros((n, n))
        slopes, blocks = np.zeros((len(parts), OWN)), np.tile(np.eye(OWN), (len(parts), 1, 1))
        cross = np.zeros((len(parts), n, OWN))
        for r, (one, part, inside) in enumerate(zip(own, parts, places, strict=True)):
            points = np.concatenate([theta, np.zeros(count), one]) + beside
            out = innovations(as_read(points[:, :n], points[:, n:]), part, inside)
            point, whole = np.zeros(step.size), np.zeros((step.size, step.size))
            with np.errstate(over='ignore', invalid='ignore'):  # of a law that runs away
                by = (out[1:] - out[0]) / step[varied, None, None]
                e, d_e, d_l = out[0, :, :2], by[..., :2], by[..., 2:]
                point[varied] = -np.einsum('jnc,nc->j', d_e, e) - 0.5 * d_l.sum(axis=(1, 2))
                mean, wide = (x.reshape(varied.size, -1) for x in (d_e + 0.5 * e * d_l, d_l))
                # Not by the threads of a matrix product: they wait longer than they work.
                squares = [np.einsum('ik,jk->ij', x, x) for x in (mean, wide)]
                whole[np.ix_(varied, varied)] = squares[0] + 0.5 * squares[1]
            if self.differ:
                slopes[r] = point[n:] - one / self.spread**2
                blocks[r] = whole[n:, n:] + np.diag(self.spread**-2)
                cross[r] = whole[:n, n:]
            scores.append(point[:n])
            information += whole[:n, :n]
            base.append(out[0])
        gradient, k = np.sum(scores, axis=0), np.flatnonzero(self.widths)
        gradient[self.told] -= self.away(theta) / self.std[self.told]
        information[k, k] += 1.0 / self.widths[k] ** 2
        for function, expected, std in self.priors:
            values = np.array([function(theta[:TERMS] + x[:TERMS]) for x in beside])
            slope = np.zeros(step.size)
            slope[varied] = (values[1:] - values[0]) / step[varied]
            if np.isfinite(slope).all():
                gradient -= slope[:n] * (values[0] - expected) / std**2
                information += np.outer(slope[:n], slope[:n]) / std**2
        joined = np.concatenate(base)
        value = self.value(theta, own, joined)
        return _Expansion(
            value,
            gradient,
            information,
            joined,
            np.array(scores),
            slopes,
            blocks,
            cross,
        )


def _remaining(theta: Array, at: _Expansion) -> float:
    """
    Half the squared Newton decrement over what no bound holds; inf where it cannot be told.

    References
    ----------
    Boyd, S., Vandenberghe, L., Convex Optimization (2004), Sect. 9.5.1.
    """
    if not all(np.isfinite(one).all() for one in (at.information, at.gradient, at.own_block)):
        return float('inf')
    gradient, information = at.reduced()
    free = _free(theta, gradient)
    pull, block = gradient[free], information[np.ix_(free, free)]
    own = solved(at.own_block, at.own_slope[..., None])[..., 0]
    return 0.5 * float(pull @ inverse_of(block) @ pull + np.sum(at.own_slope * own))


def _free(theta: Array, gradient: Array) -> NDArray[np.bool_]:
    """Parameters that no bound holds against the gradient."""
    free: NDArray[np.bool_] = ~((theta <= _LOW) & (gradient < 0.0))
    return free & ~((theta >= _HIGH) & (gradient > 0.0))


def solved(matrix: Array, right: Array) -> Array:
    """Solve symmetric systems, (..., k, k): a law that runs away leaves singular ones."""
    size = np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 1e-300))[..., None]
    scaled = matrix / size / np.swapaxes(size, -1, -2) + _RIDGE * np.eye(matrix.shape[-1])
    found: Array = np.linalg.solve(scaled, right / size) / size
    return found


def log_widths(block: Array, spread: Array) -> float:
    """Logarithm of how much narrower the recordings' own is known than by its prior, summed."""
    return float(np.maximum(np.linalg.slogdet(block * spread[:, None] * spread)[1], 0.0).sum())


def _held(own: Array) -> Array:
    """Return what recordings have of their own within what exponentials can take."""
    held: Array = np.clip(own, -_FARTHEST, _FARTHEST)
    return held


def usual_spread(path: Path) -> Array:
    """Return how far recordings differ as is usual, or the holds of one with a coarse speed."""
    if not path.hold_std:
        return USUAL * (len(path.recordings) > 1)
    # They are of one recording, and differ by no more than the steps of the reading.
    spread: Array = SPREADS[:, 0].copy()
    spread[2] = path.hold_std
    return spread


def fit_path(
    problem: Problem, start: Array, iterations: int = 300, own: Array | None = None
) -> TrajectoryFit:
    """
    Fit the growth law to a path.

    Parameters
    ----------
    problem : Problem
        The measured envelope, and what is known beforehand.
    start : ndarray, shape (15,)
        Law and noise to start from.
    iterations : int
        At most.
    own : ndarray, shape (recordings, 5), optional
        What the recordings have of their own, to start from.

    Returns
    -------
    TrajectoryFit

    References
    ----------
    Fisher scoring with Levenberg's damping; the likelihood is that of the extended Kalman
    filter (Ljung, L., System Identification, 1999, Sect. 7.4).
    """
    theta = np.array(start, dtype=np.float64)
    held = np.flatnonzero(problem.std == 0.0)
    theta[held] = problem.mean[held]
    theta = np.clip(theta, _LOW, _HIGH)
    own = np.zeros((len(problem.path.recordings), OWN)) if own is None else own
    current = problem.expand(theta, own)
    damping = 1e-3
    for _ in range(iterations):
        if _remaining(theta, current) <= _GAIN:
            break
        stalled = True
        for _ in range(12):
            gradient, information = current.reduced(damping)
            # What a bound holds stays there: a step that is cut at a bound leads nowhere.
            free = _free(theta, gradient) & (problem.widths > 0.0)
            block = information[np.ix_(free, free)]
            matrix = block + damping * np.diag(np.maximum(np.diag(block), 1e-9))
            step = np.zeros(theta.size)
            step[free] = np.linalg.solve(matrix, gradient[free])
            # A law an order away from the last one has left the hill it was climbing.
            size = np.maximum(np.abs(theta[:SATURATION]), 0.05 * problem.std[:SATURATION])
            longest = np.max(np.abs(step[:SATURATION]) / np.where(size > 0.0, size, np.inf))
            step *= min(1.0, 0.7 / longest) if longest > 0.0 else 1.0
            step[-3:] = np.clip(step[-3:], -3.0, 2.0)
            trial = np.clip(theta + step, _LOW, _HIGH)
            moved = np.zeros(own.shape)
            if problem.differ:
                moved = _held(own + current.follow(trial - theta, damping)) - own
            value = problem.objective(trial, own + moved)
            if value < current.value:
                # Along a curved ridge the step is in the right direction, and too short.
                while True:
                    further = np.clip(theta + 2.0 * (trial - theta), _LOW, _HIGH)
                    more = _held(own + 2.0 * moved) - own
                    beyond = problem.objective(further, own + more)
                    if not beyond < value - 0.1 * _GAIN:
                        break
                    trial, value, moved = further, beyond, more
                # A short step gains little: only a full one that does so has nothing left to gain.
                stalled = current.value - value < 0.1 * _GAIN and damping <= 1e-3
                theta, own = trial, own + moved
                damping = max(damping / 8.0, 1e-9)
                current = problem.expand(theta, own)
                break
            damping *= 6.0
        if stalled:
            break
    unknown = 0.0
    if problem.differ:
        known = bool(np.isfinite(current.own_block).all())
        unknown = 0.5 * log_widths(current.own_block, problem.spread) if known else float('inf')
    gradient, information = current.reduced()
    onward = 0.0
    if theta[SATURATION] <= 0.0 and np.isfinite(information).all():
        onward = float(inverse_of(information)[SATURATION] @ gradient)
    return TrajectoryFit(
        theta,
        information,
        -current.value - unknown,
        current.innovations,
        _remaining(theta, current),
        min(onward, 0.0),
        own,
        problem,
    )
