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
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.center_manifold import ComplexNormalForm
from hunt_ros.dynamics.collocation import Collocation, correct, floquet_multipliers
from hunt_ros.dynamics.linear_stability import critical_speed
from hunt_ros.dynamics.normal_form import NormalForm
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
    speed, amplitude : ndarray, shape (n,)
        m/s; fundamental amplitude of y, m.
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

        Guessed between neighbours on the branch, corrected by Newton's iteration. Next to a
        fold, within a step of the branch, none may be found.
        """
        x, v = self.unknowns, self.speed - speed
        found = []
        for k in np.flatnonzero(np.diff(v >= 0.0)):
            part = v[k] / (v[k] - v[k + 1])
            cycle = self.system.at_speed(x[k] + part * (x[k + 1] - x[k]), speed)
            if cycle is not None:
                found.append(cycle)
        cycles = _branch_of(self.system, np.array(found).reshape(-1, x.shape[1]))
        return cycles[np.argsort(cycles.amplitude)]

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
    y = x[:, : system.points] * system.largest
    return Branch(
        system.speed(x),
        np.abs(y @ system.to_fundamental) * system.rig.length_scale,
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


def fitted_form(
    theory: ComplexNormalForm, branch: Branch, speeds: tuple[float, float]
) -> NormalForm:
    """
    Quintic form in the amplitude coordinate that fits the limit cycles of the full model best.

    The Taylor form of `center_manifold` is exact at the Hopf point and may be far off at the fold.
    D1 is that of linear theory, which sets the time scale; D4, D7, D10 and D15
    minimise the difference of speed at given amplitude, which unlike that of
    amplitude at given speed is smooth through the fold.

    Parameters
    ----------
    theory : ComplexNormalForm
        Gives v_c, D1 and the scales.
    branch : Branch
        Of the full model.
    speeds : (float, float)
        Speeds that count, m/s.

    Returns
    -------
    NormalForm

    Raises
    ------
    ConfigError
        With fewer than eight cycles in the range.
    """
    inside = (branch.speed >= speeds[0]) & (branch.speed <= speeds[1])
    if inside.sum() < 8:
        raise ConfigError(f'{inside.sum()} limit cycles between {speeds[0]} and {speeds[1]} m/s')
    start = theory.amplitude_coordinate
    eps = branch.speed[inside] / theory.critical_speed - 1.0
    r2 = (branch.amplitude[inside] / (2.0 * theory.length_scale)) ** 2
    # An arclength step counts once: continuation crowds its points at the start.
    steps = np.hypot(np.diff(eps), np.diff(np.sqrt(r2 / r2.max())))
    weight = np.sqrt(np.gradient(np.append(0.0, np.cumsum(steps))))
    columns = np.stack([r2, eps**2, eps * r2, r2**2], axis=1)
    slope = np.full_like(eps, start.D1)  # d(growth)/d(eps): turns the equation into a speed
    for _ in range(20):
        rows = columns * (weight / slope)[:, None]
        scale = np.linalg.norm(rows, axis=0)
        solution, *_ = np.linalg.lstsq(rows / scale, -start.D1 * eps * weight / slope, rcond=None)
        d4, d7, d10, d15 = (float(x) for x in solution / scale)
        slope = np.maximum(start.D1 + 2.0 * d7 * eps + d10 * r2, 0.1 * start.D1)
    return replace(start, D4=d4, D7=d7, D10=d10, D15=d15)
