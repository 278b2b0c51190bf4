"""
What a stretch of a profile would teach, and what it would risk, before it is run.

The amplitude obeys dA = (A g(A, v) + D / A) dt + sqrt(2 D) dW. Along a path its increments tell
of the growth rate g with the information A^2 dt / 2 D, so that passing the middle amplitudes
teaches and waiting on a branch does not. The draws of a posterior differ in g on a grid of speed
and amplitude; in the few directions in which they differ, knowledge is a small matrix, whatever
law they came from. Paths are stochastic, one law a path.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import F1, F2, F3, compiled
from hunt_ros.dynamics.profile import Hold
from hunt_ros.errors import IdentificationError
from hunt_ros.identification.posterior import Posterior

Array = NDArray[np.float64]

#: Columns of the states of the paths: m/s; m; whether it was quiet since hunting was last wanted;
#: whether hunting began unwanted; s since the beginning.
SPEED, AMPLITUDE, QUIET, ESCAPED, TIME = range(5)
#: Below this share of the amplitude at the fold the motion counts as quiet.
BELOW = 0.7
#: Speeds and amplitudes of the grid on which growth rates are compared.
_SPEEDS, _AMPLITUDES = 64, 72
#: The grid ends at this many times the largest limit cycle.
_ABOVE = 1.25
#: Directions in which the draws differ that are kept.
_DIRECTIONS = 12
#: Step of the paths, s, and how many have random numbers of their own.
_STEP_S, _RANDOM = 0.1, 2048
#: Draws that have all quantities, fewer than which nothing is foreseen.
_FEWEST = 40
#: Noise where none was seen: a quiet amplitude of this share of that at the fold.
_FAINT = 3e-3


@dataclass(frozen=True)
class Move:
    """
    A step of a profile, and what it is for.

    Parameters
    ----------
    step : Hold
        As the drive runs it.
    wanted : bool
        Whether a start of hunting in it is what it is for.
    """

    step: Hold
    wanted: bool = True


class Foresight:
    """
    Predicts deviations and accidents from a posterior.

    Parameters
    ----------
    posterior : Posterior
        What is known.
    speeds : sequence of float
        Where the unstable amplitude is wanted, m/s.
    low, high : float
        Speeds that may be run, m/s.
    paths : int
        Stochastic paths.
    seed : int
        Of everything random.

    Attributes
    ----------
    fold_amplitude : float
        Typical amplitude at v_n, m.
    deviations : ndarray, shape (2 + len(speeds),)
        Of v_c, v_n (m/s) and the unstable amplitudes (m) as known.
    nothing : ndarray, shape (k, k)
        What the paths have told before any is run.

    Raises
    ------
    IdentificationError
        If too few draws have a fold and a critical speed.
    """

    def __init__(
        self,
        posterior: Posterior,
        speeds: Sequence[float],
        low: float,
        high: float,
        paths: int,
        seed: int = 0,
    ) -> None:
        unstable = posterior.continued(np.asarray(speeds))[:, 0]
        quantities = np.column_stack([posterior.table[:, :3], unstable])
        rows = np.flatnonzero(np.isfinite(quantities).all(axis=1))
        if len(rows) < _FEWEST:
            raise IdentificationError(
                f'{len(rows)} of {len(quantities)} forms that the data allow have v_c and v_n,'
                f' expected {_FEWEST}'
            )
        # Far draws have a law of their own: they do not say how the near ones differ.
        rows = rows[_central(quantities[rows])]
        folds = quantities[rows, 2]
        self.fold_amplitude = float(np.median(folds))
        self._speeds = np.linspace(low - 0.05, high + 0.05, _SPEEDS)
        _, stable = posterior.law.steady_amplitudes(self._speeds)
        top = _ABOVE * float(np.nanmax(np.append(stable, 1.5 * self.fold_amplitude)))
        self._amplitudes = np.linspace(0.0, top, _AMPLITUDES)
        at = np.meshgrid(self._speeds, self._amplitudes, indexing='ij')
        growth = np.stack([posterior.drawn[k].growth_rate(*at) for k in rows])
        self._compare(growth.reshape(len(rows), -1), np.delete(quantities[rows], 2, axis=1))
        generator = np.random.default_rng(seed)
        chosen = generator.permutation(len(rows))[:paths]
        self._growth, self._folds = np.ascontiguousarray(growth[chosen]), folds[chosen]
        faint = (_FAINT * self._folds) ** 2 * np.abs(self._growth[:, 0, 0])
        self._intensity = np.fmax(posterior.intensity[rows[chosen]], faint)
        self._normal = generator.standard_normal((paths, _RANDOM, 2))

    def _compare(self, growth: Array, quantities: Array) -> None:
        """Find the directions in which the draws differ, and how the quantities follow them."""
        scale = math.sqrt(len(growth) - 1)
        spread = (growth - growth.mean(axis=0)) / scale
        own = np.linalg.eigh(spread @ spread.T)[1][:, -_DIRECTIONS:]
        #: Growth rate per unit of each direction, shape (k, cells).
        self._slopes = own.T @ spread
        centred = (quantities - quantities.mean(axis=0)) / scale
        #: Quantities per unit of each direction, shape (k, quantities).
        self._follow = own.T @ centred
        self.deviations = np.sqrt((centred**2).sum(axis=0))
        self.nothing = np.eye(len(self._slopes))

    def spread(self, information: Array) -> Array:
        """Deviations of the quantities under more information, shape (quantities,)."""
        left = np.einsum('iq,ij,jq->q', self._follow, np.linalg.inv(information), self._follow)
        found: Array = self.deviations * np.sqrt(left / (self._follow**2).sum(axis=0))
        return found

    def start(self, speed: float, amplitude: float) -> Array:
        """States of all paths at a speed, m/s, and an amplitude, m, shape (paths, 5)."""
        states = np.zeros((len(self._normal), 5))
        states[:, SPEED], states[:, AMPLITUDE] = speed, amplitude
        states[:, QUIET] = amplitude < BELOW * self.fold_amplitude
        return states

    def follow(self, states: Array, moves: Sequence[Move]) -> tuple[Array, Array]:
        """
        Go on along some steps of a profile.

        Parameters
        ----------
        states : ndarray, shape (paths, 5)
            Where to begin.
        moves : sequence of Move
            One after the other.

        Returns
        -------
        states : ndarray, shape (paths, 5)
            At the end; a path that is still growing towards hunting counts as escaped.
        information : ndarray, shape (k, k)
            Mean of what the paths tell, in the directions of the draws.
        """
        legs = np.array([_leg(move) for move in moves])
        told, states = np.zeros((_SPEEDS, _AMPLITUDES)), states.copy()
        first, second = self._speeds[:2]
        grid = np.array([first, second - first, self._amplitudes[1]])
        _follow(legs, self._growth, self._folds, self._intensity, grid, self._normal, told, states)
        weighted = self._slopes * (told.ravel() / len(states))
        return states, weighted @ self._slopes.T


def _leg(move: Move) -> tuple[float, ...]:
    step = move.step
    above, below = step.until_above_m or math.inf, step.until_below_m
    way = step.speed_mps, step.rate_mps2, step.duration_s
    return (*way, above, below, float(move.wanted))


def _central(rows: Array) -> NDArray[np.bool_]:
    """Rows whose every column is within four robust deviations of its median."""
    below, middle, above = np.percentile(rows, [15.87, 50.0, 84.13], axis=0)
    inside: NDArray[np.bool_] = (np.abs(rows - middle) <= 2.0 * (above - below)).all(axis=1)
    return inside


@compiled
def _follow(
    legs: F2,
    growth: F3,
    folds: F1,
    intensity: F1,
    grid: F1,
    normal: F3,
    told: F2,
    ends: F2,
) -> None:
    """
    Follow the paths; adds the information of each cell to `told`, and puts the ends in place.

    Parameters
    ----------
    legs : ndarray, shape (m, 6)
        Speed, m/s, rate, m/s^2, time there, s, ends above and below, m, whether hunting is
        wanted.
    growth : ndarray, shape (laws, speeds, amplitudes)
        1/s; the paths follow the laws in turn.
    folds, intensity : ndarray, shape (laws,)
        m, m^2/s.
    grid : ndarray, shape (3,)
        First speed, step of speed (m/s), step of amplitude (m).
    normal : ndarray, shape (n, steps, 2)
        Used again from the beginning where a path is longer.
    told : ndarray, shape (speeds, amplitudes)
        Grows by A^2 dt / 2 D, s^2.
    ends : ndarray, shape (n, 5)
        The states, from the beginning to the end.
    """
    last_v, last_a = growth.shape[1] - 2, growth.shape[2] - 2
    for k in range(ends.shape[0]):
        law = k % growth.shape[0]
        speed, amplitude, quiet, escaped, time = ends[k]
        push = math.sqrt(2.0 * intensity[law] * _STEP_S)
        n = int(time / _STEP_S + 0.5)
        rate = wanted = 0.0
        for target, slew, hold, above, below, wanted in legs:
            waited = 0.0
            while below <= amplitude <= above:
                if speed == target:
                    if waited >= hold:
                        break
                    waited += _STEP_S
                else:
                    way = slew * _STEP_S
                    speed += min(max(target - speed, -way), way)
                x = min(max((speed - grid[0]) / grid[1], 0.0), last_v + 0.999)
                y = min(amplitude / grid[2], last_a + 0.999)
                i, j = int(x), int(y)
                x -= i
                y -= j
                lower = (1.0 - y) * growth[law, i, j] + y * growth[law, i, j + 1]
                upper = (1.0 - y) * growth[law, i + 1, j] + y * growth[law, i + 1, j + 1]
                rate = (1.0 - x) * lower + x * upper
                told[i + int(x + 0.5), j + int(y + 0.5)] += (amplitude / push * _STEP_S) ** 2
                first, second = normal[k, n % normal.shape[1]]
                along = amplitude * math.exp(rate * _STEP_S) + push * first
                # A law that runs away at the end of what was measured is no rig's.
                amplitude = min(math.hypot(along, push * second), (last_a + 1) * grid[2])
                n += 1
                if wanted > 0.0:
                    quiet = 0.0
                elif amplitude < BELOW * folds[law]:
                    quiet = 1.0
                elif quiet > 0.0 and amplitude > folds[law]:
                    escaped = 1.0
        # What is left growing is on its way, wherever the profile ends.
        if wanted == 0.0 and quiet > 0.0 and rate > 0.0 and amplitude > 0.3 * folds[law]:
            escaped = 1.0
        ends[k, 0], ends[k, 1], ends[k, 2], ends[k, 3] = speed, amplitude, quiet, escaped
        ends[k, 4] = n * _STEP_S
