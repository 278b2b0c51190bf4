"""
Limit cycles of the full model against speed, stable and unstable, through folds: Fig. 4.

Eqs. (2), (3) are odd, so a limit cycle repeats with the opposite sign after half a
period. It is represented by its values at equal phases of one half period, which is the same as
its odd harmonics up to the number of points; the equations hold at these points
(Fourier collocation), and the branch is followed by pseudo-arclength continuation
from the Hopf point. Stability is by Floquet multipliers, from the variational
equation integrated along the cycle.

The flange is not in it: a branch ends where the cycle would reach the flange.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.collocation import Collocation, correct, floquet_multipliers
from hunt_ros.dynamics.linear_stability import critical_speed
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.errors import ConfigError

Array = NDArray[np.float64]

#: Collocation points on half a period: odd harmonics 1 to 15.
POINTS = 16


@dataclass(frozen=True, eq=False)
class Branch:
    """
    Limit cycles along a branch, in the order in which it was followed from the Hopf point.

    Parameters
    ----------
    speed, amplitude, yaw_amplitude : ndarray, shape (n,)
        m/s; fundamental amplitudes of y, m, and of psi, rad.
    peak : ndarray, shape (n,)
        Largest |y|, m.
    frequency_hz : ndarray, shape (n,)
        Hz.
    multipliers : ndarray of complex128, shape (n, 4)
        Floquet multipliers of a whole period, the trivial one (1) first.
    critical_speed : float
        Of the Hopf point, m/s.
    system : Collocation
        The equations that were solved.
    unknowns : ndarray, shape (n, 2 points + 2)
        Their solutions, as `Collocation` scales them.
    """

    speed: Array
    amplitude: Array
    yaw_amplitude: Array
    peak: Array
    frequency_hz: Array
    multipliers: NDArray[np.complex128]
    critical_speed: float
    system: Collocation
    unknowns: Array

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Which cycles are stable: all multipliers but the trivial one inside the unit circle."""
        inside: NDArray[np.bool_] = np.abs(self.multipliers[:, 1:]).max(axis=1) < 1.0
        return inside

    @property
    def exponent(self) -> Array:
        """Rate at which the slowest disturbance of the amplitude grows, 1/s, shape (n,)."""
        largest = np.abs(self.multipliers[:, 1:]).max(axis=1)
        rate: Array = np.log(largest) * self.frequency_hz
        return rate

    def folds(self) -> list[tuple[float, float]]:
        """
        Saddle-nodes of limit cycles: (speed, amplitude) where the branch turns back, m/s and m.

        By a quartic through the five points about each turn.
        """
        found = []
        turn = np.flatnonzero(np.diff(np.sign(np.diff(self.speed))))
        for place in turn + 1:
            near = slice(max(0, place - 2), place + 3)
            if near.stop > len(self.speed) or near.stop - near.start < 5:
                continue
            centre = self.amplitude[place]
            scale = np.ptp(self.amplitude[near])
            quartic = np.polynomial.Polynomial.fit(
                (self.amplitude[near] - centre) / scale, self.speed[near], 4
            )
            roots = quartic.deriv().roots()
            real = roots[np.abs(roots.imag) < 1e-9].real
            best = float(real[np.argmin(np.abs(real))])
            found.append((float(quartic(best)), float(centre + scale * best)))
        return found

    @property
    def nonlinear_critical_speed(self) -> float | None:
        """v_n, m/s: the lowest fold below v_c; None without one."""
        fold = self.saddle_node()
        return None if fold is None else fold[0]

    def saddle_node(self) -> tuple[float, float] | None:
        """Return v_n, m/s, and the amplitude there, m: the lowest fold below v_c; None: none."""
        below = [fold for fold in self.folds() if fold[0] < self.critical_speed]
        return min(below, default=None)

    def at_speed(self, speed: float) -> Branch:
        """
        Limit cycles at exactly one speed, m/s, the smallest amplitude first.

        Guessed by a parabola through three neighbours on the branch, which turns with it at a
        fold, and corrected by Newton's iteration. Within some 1e-6 of a fold, relative,
        the two cycles there may not be told apart, or not be found.
        """
        found: list[Array] = []
        for guess in self._guesses(speed):
            corrected = self.system.at_speed(guess, speed)
            if corrected is None or np.abs(corrected[: self.system.points]).max() < 1e-4:
                continue  # Newton's iteration has fallen to the state of rest
            if all(np.abs(corrected - other).max() > 1e-9 for other in found):
                found.append(corrected)
        cycles = _branch_of(self.system, np.array(found).reshape(-1, self.unknowns.shape[1]))
        return cycles[np.argsort(cycles.amplitude)]

    def _guesses(self, speed: float) -> list[Array]:
        """Points of the branch at a speed, by parabolas in the arclength."""
        x, v = self.unknowns, self.speed - speed
        length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1)))
        guesses = []
        for i in range(1, len(v) - 1):
            near = slice(i - 1, i + 2)
            if np.abs(v[near]).min() > np.ptp(v[near]) or not np.ptp(v[near]):
                continue
            s = length[near] - length[i]
            # Each parabola answers for its middle, those at the ends for the ends too; the
            # parts overlap a little, so that no root falls between two.
            low = s[0] if i == 1 else 0.55 * s[0]
            high = s[2] if i == len(v) - 2 else 0.55 * s[2]
            curve = np.polynomial.polynomial.polyfit(s, v[near], 2)
            roots = np.polynomial.polynomial.polyroots(curve)
            for root in roots[np.abs(roots.imag) < 1e-12].real:
                if low <= root <= high:
                    weights = np.polynomial.polynomial.polyvander(np.array([root]), 2)[0]
                    guesses.append(weights @ np.polynomial.polynomial.polyfit(s, x[near], 2))
        return guesses

    def __getitem__(self, places: NDArray[np.intp] | slice) -> Branch:
        return _branch_of(self.system, self.unknowns[places])


def limit_cycles(
    rig: RigParameters,
    speeds: tuple[float, float] | None = None,
    largest_amplitude: float | None = None,
    step: float = 0.02,
    points: int = POINTS,
) -> Branch:
    """
    Follow the branch of limit cycles that is born at the Hopf point.

    Parameters
    ----------
    rig : RigParameters
        The rig.
    speeds : (float, float), optional
        Speeds, m/s, beyond which the branch is left; default: 0.5 v_c to 1.25 v_c.
    largest_amplitude : float, optional
        Peak of y, m, at which it ends; default: the flange clearance.
    step : float
        Arclength step, in units in which the largest amplitude and a quarter of
        v_c are one.
    points : int
        Collocation points on half a period, even.

    Returns
    -------
    Branch

    Raises
    ------
    ConfigError
        Without a Hopf point, or where the continuation fails at its first step.

    References
    ----------
    W. J. F. Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria
    (2000), chapter 2 (pseudo-arclength); A. H. Nayfeh, B. Balachandran, Applied
    Nonlinear Dynamics (1995), chapter 3 (Floquet).
    """
    hopf = critical_speed(rig)
    low, high = speeds or (0.5 * hopf, 1.25 * hopf)
    roof = largest_amplitude or rig.flange_clearance_m
    system = Collocation(rig, hopf, roof / rig.length_scale, points)
    solutions = _follow(system, step, (low, high))
    if len(solutions) < 2:
        raise ConfigError(f'{rig.name}: no limit cycles found from the Hopf point at {hopf:g} m/s')
    return _branch_of(system, np.array(solutions))


def cycles_of(rig: RigParameters) -> Branch | None:
    """Return the limit cycles of a rig, or None where it has none to follow (a linear rig)."""
    if not any(rig.alpha.values()) and not any(rig.beta.values()):
        return None
    try:
        return limit_cycles(rig)
    except ConfigError:
        return None


def _branch_of(system: Collocation, x: Array) -> Branch:
    """Turn solutions, shape (m, 2 points + 2), into limit cycles with their stability."""
    n, length = system.points, system.rig.length_scale
    y, psi = x[:, :n] * system.largest, x[:, n : 2 * n] * system.largest
    return Branch(
        system.speed(x),
        np.abs(y @ system.to_fundamental) * length,
        np.abs(psi @ system.to_fundamental),
        np.abs(y).max(axis=1) * length,
        x[:, -2] / (2.0 * math.pi * system.rig.time_scale),
        floquet_multipliers(system, x),
        system.hopf,
        system,
        x,
    )


def _follow(system: Collocation, step: float, speeds: tuple[float, float]) -> list[Array]:
    """Pseudo-arclength continuation until a bound is crossed; the Hopf point is left out."""
    point, tangent = system.start()
    solutions: list[Array] = []
    length, largest = 0.2 * step, step
    for _ in range(4000):
        corrected = correct(system, point + length * tangent, tangent)
        if corrected is None:
            length *= 0.5
            if length < 1e-5 * step:
                break
            continue
        new, iterations = corrected
        _, matrix = system.residual(new)
        bordered = np.vstack([matrix, tangent])
        direction = np.linalg.solve(bordered, np.append(np.zeros(len(tangent) - 1), 1.0))
        point, tangent = new, direction / np.linalg.norm(direction)
        solutions.append(point)
        if iterations <= 4:
            length = min(1.5 * length, largest)
        peak = np.abs(point[: system.points]).max()
        if peak > 1.0 or not speeds[0] <= float(system.speed(point)) <= speeds[1]:
            break
    return solutions
