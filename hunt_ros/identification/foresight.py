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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import F1, F2, F3, compiled
from hunt_ros.dynamics.profile import Step
from hunt_ros.errors import IdentificationError
from hunt_ros.identification.posterior import Posterior

Array = NDArray[np.float64]

#: Speeds and amplitudes of the grid on which growth rates are compared.
_SPEEDS, _AMPLITUDES = 64, 72
#: The grid ends at this many times the largest limit cycle.
_ABOVE = 1.25
#: Directions in which the draws differ that are kept, and their least share of the spread.
_DIRECTIONS, _LEAST = 12, 1e-6
#: Step of the paths, s, and how long a stretch may last at most.
_STEP_S, _LONGEST_S = 0.1, 240.0
#: Draws that have all quantities, fewer than which nothing is foreseen.
_FEWEST = 40
#: Noise where none was seen: a quiet amplitude of this share of that at the fold.
_FAINT = 3e-3
#: Below this share of the amplitude at the fold the motion counts as quiet.
QUIET = 0.7
#: Relative deviation of the size of a kick, and the time after one in which nothing is seen, s.
_KICK_STD, _BLIND_S = 0.1, 1.0


@dataclass(frozen=True)
class Move:
    """
    A step of a profile, and what it is for.

    Parameters
    ----------
    step : Step
        As the drive runs it.
    wanted : bool
        Whether a start of hunting in it is what it is for.
    kick : float
        Size of a kick as soon as its speed is reached, m; 0: none.
    """

    step: Step
    wanted: bool = False
    kick: float = 0.0

    def rows(self) -> Iterator[tuple[float, ...]]:
        """Return its legs as the kernel takes them: m/s, m/s^2, s, m, m, whether wanted, m."""
        for leg in self.step.plan():
            went = leg.speed_mps, leg.rate_mps2, leg.hold_s
            yield (*went, leg.above_m, leg.below_m, float(self.wanted), self.kick)


@dataclass(frozen=True, eq=False)
class Ensemble:
    """
    Where the rig may be: one state a path.

    Parameters
    ----------
    states : ndarray, shape (n, 5)
        Speed, m/s; amplitude, m; whether it was quiet since hunting was last wanted; whether
        hunting began unwanted; s since the beginning.
    """

    states: Array

    @property
    def amplitude(self) -> Array:
        """Amplitudes, m, shape (n,)."""
        return self.states[:, 1]

    @property
    def escaped(self) -> NDArray[np.bool_]:
        """Whether hunting began unwanted, shape (n,)."""
        return self.states[:, 3] > 0.0

    @property
    def time(self) -> Array:
        """Time since the beginning, s, shape (n,)."""
        return self.states[:, 4]

    def part(self, count: int) -> Ensemble:
        """Return the first paths."""
        return Ensemble(self.states[:count])


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
        paths: int = 160,
        seed: int = 0,
    ) -> None:
        known = posterior.table[:, :3]
        unstable = posterior.continued(np.asarray(speeds))[:, 0]
        wanted = np.column_stack([known[:, :2], unstable])
        fine = np.isfinite(wanted).all(axis=1) & np.isfinite(known[:, 2])
        if fine.sum() < _FEWEST:
            raise IdentificationError(
                f'{int(fine.sum())} of {len(fine)} forms that the data allow have v_c and v_n,'
                f' expected {_FEWEST}'
            )
        # Far draws have a law of their own: they do not say how the near ones differ.
        fine[fine] = _central(np.column_stack([wanted[fine], known[fine, 2]]))
        rows = np.flatnonzero(fine)
        self.fold_amplitude = float(np.median(known[rows, 2]))
        generator = np.random.default_rng(seed)
        self._speeds = np.linspace(low - 0.05, high + 0.05, _SPEEDS)
        _, stable = posterior.law.steady_amplitudes(self._speeds)
        top = _ABOVE * float(np.nanmax(np.append(stable, 1.5 * self.fold_amplitude)))
        self._amplitudes = np.linspace(0.0, top, _AMPLITUDES)
        at = np.meshgrid(self._speeds, self._amplitudes, indexing='ij')
        growth = np.stack([posterior.drawn[k].growth_rate(*at) for k in rows])
        self._directions(growth.reshape(len(rows), -1), wanted[rows])
        chosen = generator.permutation(len(rows))[: min(len(rows), paths)]
        self._growth = np.ascontiguousarray(growth[chosen])
        self._folds = known[rows[chosen], 2]
        rest = np.abs(growth[chosen][:, 0, 0])
        faint = (_FAINT * self._folds) ** 2 * rest
        seen = posterior.intensity[rows[chosen]]
        self._intensity = np.where(seen > faint, seen, faint)
        self._normal = generator.standard_normal((paths, 2048, 2))
        self._paths = paths

    def _directions(self, growth: Array, wanted: Array) -> None:
        """Find the directions in which the draws differ, and how the quantities follow them."""
        scale = math.sqrt(len(growth) - 1)
        spread = (growth - growth.mean(axis=0)) / scale
        values, vectors = np.linalg.eigh(spread @ spread.T)
        order = np.argsort(values)[::-1][:_DIRECTIONS]
        order = order[values[order] > _LEAST * values[order[0]]]
        own = vectors[:, order]
        #: Growth rate per unit of each direction, shape (cells, k).
        self._slopes = (own.T @ spread).T
        centred = (wanted - wanted.mean(axis=0)) / scale
        #: Quantities per unit of each direction, shape (k, quantities).
        self._follow = own.T @ centred
        self.deviations = np.sqrt((centred**2).sum(axis=0))
        self.nothing = np.eye(len(order))

    def spread(self, information: Array) -> Array:
        """Deviations of the quantities under more information, shape (quantities,)."""
        covariance = np.linalg.inv(information)
        explained = np.einsum('iq,ij,jq->q', self._follow, covariance, self._follow)
        whole = np.einsum('iq,iq->q', self._follow, self._follow)
        found: Array = self.deviations * np.sqrt(explained / np.maximum(whole, 1e-300))
        return found

    def start(self, speed: float, amplitude: float) -> Ensemble:
        """Begin all paths at a speed, m/s, and an amplitude, m."""
        states = np.zeros((self._paths, 5))
        states[:, 0], states[:, 1] = speed, amplitude
        states[:, 2] = amplitude < QUIET * np.resize(self._folds, self._paths)
        return Ensemble(states)

    def follow(self, state: Ensemble, moves: Sequence[Move]) -> tuple[Ensemble, Array]:
        """
        Go on along some steps of a profile.

        Parameters
        ----------
        state : Ensemble
            Where to begin.
        moves : sequence of Move
            One after the other.

        Returns
        -------
        state : Ensemble
            At the end; a path that is still growing towards hunting counts as escaped.
        information : ndarray, shape (k, k)
            Mean of what the paths tell, in the directions of the draws.
        """
        legs = np.array([row for move in moves for row in move.rows()])
        told = np.zeros((_SPEEDS, _AMPLITUDES))
        states = state.states.copy()
        first, second = self._speeds[:2]
        grid = np.array([first, second - first, self._amplitudes[1] - self._amplitudes[0]])
        _follow(
            legs, self._growth, self._folds, self._intensity, grid, self._normal, told, states,
        )  # fmt: skip
        weight = told.ravel() / len(states)
        information = self._slopes.T @ (weight[:, None] * self._slopes)
        return Ensemble(states), information


def _central(rows: Array) -> NDArray[np.bool_]:
    """Rows whose every column is within four robust deviations of its median."""
    below, middle, above = np.percentile(rows, [15.87, 50.0, 84.13], axis=0)
    width = np.maximum(0.5 * (above - below), 1e-12 * np.abs(middle))
    inside: NDArray[np.bool_] = (np.abs(rows - middle) <= 4.0 * width).all(axis=1)
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
    legs : ndarray, shape (m, 7)
        Rows of `Move`.
    growth : ndarray, shape (laws, speeds, amplitudes)
        1/s; the paths follow the laws in turn.
    folds, intensity : ndarray, shape (laws,)
        m, m^2/s.
    grid : ndarray, shape (3,)
        First speed, step of speed (m/s), step of amplitude (m).
    normal : ndarray, shape (at least n, steps, 2)
        Used again from the beginning where a path is longer.
    told : ndarray, shape (speeds, amplitudes)
        Grows by A^2 dt / 2 D, s^2.
    ends : ndarray, shape (n, 5)
        Speed, amplitude, quiet, escaped, time; from the beginning to the end.
    """
    last_v, last_a = growth.shape[1] - 2, growth.shape[2] - 2
    top = (last_a + 1) * grid[2]
    for k in range(ends.shape[0]):
        law = k % growth.shape[0]
        speed, amplitude, quiet, escaped = ends[k, 0], ends[k, 1], ends[k, 2], ends[k, 3]
        step = math.sqrt(2.0 * intensity[law] * _STEP_S)
        fold = folds[law]
        begun = ends[k, 4]
        n = int(begun / _STEP_S)
        rate = 0.0
        wanted = 0.0
        for leg in range(legs.shape[0]):
            target, slew, hold = legs[leg, 0], legs[leg, 1], legs[leg, 2]
            wanted = legs[leg, 5]
            blind = 0.0
            waited = 0.0
            kicked = legs[leg, 6]
            while (n + 1) * _STEP_S - begun < _LONGEST_S:
                if amplitude > legs[leg, 3] or amplitude < legs[leg, 4]:
                    break
                first = normal[k, n % normal.shape[1], 0]
                second = normal[k, n % normal.shape[1], 1]
                if speed == target and kicked > 0.0:
                    amplitude = math.hypot(amplitude, kicked * (1.0 + _KICK_STD * first))
                    kicked, blind = 0.0, _BLIND_S
                if speed == target:
                    if waited >= hold:
                        break
                    waited += _STEP_S
                elif speed < target:
                    speed = min(speed + slew * _STEP_S, target)
                else:
                    speed = max(speed - slew * _STEP_S, target)
                x = min(max((speed - grid[0]) / grid[1], 0.0), last_v + 0.999)
                y = min(amplitude / grid[2], last_a + 0.999)
                i, j = int(x), int(y)
                x -= i
                y -= j
                rate = (1.0 - x) * (
                    (1.0 - y) * growth[law, i, j] + y * growth[law, i, j + 1]
                ) + x * ((1.0 - y) * growth[law, i + 1, j] + y * growth[law, i + 1, j + 1])
                if blind > 0.0:
                    blind -= _STEP_S
                else:
                    told[i + int(x + 0.5), j + int(y + 0.5)] += (
                        amplitude * amplitude * _STEP_S / (2.0 * intensity[law])
                    )
                along = amplitude * math.exp(min(max(rate, -40.0), 40.0) * _STEP_S) + step * first
                # A law that runs away at the end of what was measured is no rig's.
                amplitude = min(math.hypot(along, step * second), top)
                n += 1
                if wanted > 0.0:
                    quiet = 0.0
                elif amplitude < QUIET * fold:
                    quiet = 1.0
                elif quiet > 0.0 and amplitude > fold:
                    escaped = 1.0
        # What is left growing is on its way, wherever the profile ends.
        if wanted == 0.0 and quiet > 0.0 and rate > 0.0 and amplitude > 0.3 * fold:
            escaped = 1.0
        ends[k, 0], ends[k, 1], ends[k, 2], ends[k, 3] = speed, amplitude, quiet, escaped
        ends[k, 4] = n * _STEP_S
