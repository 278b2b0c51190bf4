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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.linear_stability import critical_frequency, critical_speed, hunting_mode
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.wheelset import TINY, Wheelset
from hunt_ros.errors import ConfigError

Array = NDArray[np.float64]

#: Collocation points on half a period, even: odd harmonics 1 to 15.
POINTS = 16
#: Arclength step, in units in which the flange clearance and a quarter of v_c are one.
STEP = 0.02
#: Runge-Kutta steps on half a period for the variational equation.
_FLOQUET_STEPS = 128
_TOLERANCE = 1e-11
_MOST_ITERATIONS = 25
#: Speeds beyond which the branch is left, in v_c.
_SLOWEST, _FASTEST = 0.5, 1.25


class Collocation:
    """
    The algebraic system: unknowns are y and psi at the points, omega, and the speed.

    The unknown vector is scaled: y / Y, psi / Y, omega, 4 (v / v_c - 1), with Y the
    largest amplitude, so that one step length serves all.
    """

    def __init__(self, rig: RigParameters, hopf: float) -> None:
        points = self.points = POINTS
        self.rig, self.hopf = rig, hopf
        self.largest = rig.flange_clearance_m / rig.length_scale
        self.wheelset = Wheelset(rig)
        phase = np.pi * np.arange(points) / points
        orders = np.arange(-points + 1, points, 2)  # odd, points of them
        basis = np.exp(1j * np.outer(phase, orders))
        inverse = np.linalg.inv(basis)
        self.first: Array = (basis * (1j * orders) @ inverse).real
        self.second: Array = self.first @ self.first
        self.to_fundamental = inverse[orders == 1][0] * 2.0
        self.orders, self.to_harmonics = orders, inverse

    def start(self) -> tuple[Array, Array]:
        """Hopf point and the unit tangent into the branch."""
        shape = hunting_mode(self.rig, self.hopf).shape
        phase = np.exp(1j * np.pi * np.arange(self.points) / self.points)
        y, psi = phase.real, (shape[2] * phase).real
        point = np.zeros(2 * self.points + 2)
        point[-2] = critical_frequency(self.rig)
        tangent = np.concatenate([y, psi, [0.0, 0.0]])
        return point, tangent / np.linalg.norm(tangent)

    def value(self, x: NDArray[Any]) -> NDArray[Any]:
        """Equations (2), (3) at the points and the phase condition, of unknowns (2 n + 2, ...)."""
        n, rig, omega = self.points, self.rig, x[-2]
        y, psi = x[:n] * self.largest, x[n : 2 * n] * self.largest
        v = (self.hopf / rig.speed_scale) * (1.0 + 0.25 * x[-1])
        forces = self.wheelset.nonlinear_forces(y, psi)
        lateral = omega**2 * (self.second @ y) + rig.d11 / v * omega * (self.first @ y)
        yaw = omega**2 * (self.second @ psi) + rig.d22 / v * omega * (self.first @ psi)
        lateral += rig.k11 * y + rig.k12 * psi + forces[..., 0]
        yaw += rig.k21 * y + rig.k22 * psi + forces[..., 1]
        phase = (self.to_fundamental.imag @ y)[None]
        return np.concatenate([lateral, yaw, phase]) / self.largest

    def residual(self, x: Array) -> tuple[Array, Array]:
        """Return `value` of one solution and its Jacobian, by complex steps."""
        steps = x[:, None] + 1j * TINY * np.eye(x.size)
        return self.value(x), self.value(steps).imag / TINY

    def speed(self, x: Array) -> Array:
        """Running speed of one or many solutions, m/s."""
        return np.asarray(self.hopf * (1.0 + 0.25 * x[..., -1]))

    def jacobians(self, x: Array, phase: Array) -> NDArray[np.float64]:
        """Jacobians of Eq. (6) along the cycles x, at phases (rad): shape (m, phases, 4, 4)."""
        n = self.points
        interpolate = np.exp(1j * np.outer(phase, self.orders)) @ self.to_harmonics
        states = np.zeros((len(x), len(phase), 4))
        states[..., 0] = (x[:, :n] * self.largest @ interpolate.T).real
        states[..., 2] = (x[:, n : 2 * n] * self.largest @ interpolate.T).real
        return self.wheelset.jacobian(states, self.speed(x)[:, None])


def _correct(system: Collocation, guess: Array, tangent: Array) -> tuple[Array, int] | None:
    """Newton's iteration in the plane normal to the tangent, or None if it fails."""
    x = guess.copy()
    for iteration in range(_MOST_ITERATIONS):
        value, matrix = system.residual(x)
        full = np.append(value, tangent @ (x - guess))
        change = np.linalg.solve(np.vstack([matrix, tangent]), full)
        x -= change
        if not np.isfinite(x).all() or x[-1] <= -4.0:
            return None
        if np.abs(change).max() < _TOLERANCE:
            return x, iteration + 1
    return None


def _half_period_map(system: Collocation, x: Array) -> Array:
    """Map of the variational equation over half a period: minus a root of the monodromy."""
    steps = _FLOQUET_STEPS
    phase = np.pi * np.arange(2 * steps + 1) / (2 * steps)  # steps and half steps
    jacobians = system.jacobians(x, phase)
    h = (np.pi / steps / x[:, -2])[:, None, None]
    matrix = np.broadcast_to(np.eye(4), (len(x), 4, 4))
    for k in range(steps):
        j0, j1, j2 = (jacobians[:, 2 * k + i] for i in range(3))
        a = j0 @ matrix
        b = j1 @ (matrix + 0.5 * h * a)
        c = j1 @ (matrix + 0.5 * h * b)
        d = j2 @ (matrix + h * c)
        matrix = matrix + h / 6.0 * (a + 2.0 * (b + c) + d)
    return matrix


def _floquet_multipliers(system: Collocation, x: Array) -> NDArray[np.complex128]:
    """Floquet multipliers of many cycles: squares of those of the half-period map."""
    values = np.linalg.eigvals(_half_period_map(system, x)).astype(np.complex128) ** 2
    order = np.argsort(np.abs(values - 1.0), axis=1)
    # The trivial multiplier is 1 to rounding: the nearest to it comes first.
    return np.asarray(np.take_along_axis(values, order, axis=1), dtype=np.complex128)


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


def limit_cycles(rig: RigParameters) -> Branch:
    """
    Follow the branch of limit cycles that is born at the Hopf point, to the flange clearance.

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
    system = Collocation(rig, hopf)
    solutions = _follow(system)
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
        _floquet_multipliers(system, x),
        system.hopf,
        system,
        x,
    )


def _follow(system: Collocation) -> list[Array]:
    """Pseudo-arclength continuation until a bound is crossed; the Hopf point is left out."""
    point, tangent = system.start()
    solutions: list[Array] = []
    length = 0.2 * STEP
    for _ in range(4000):
        corrected = _correct(system, point + length * tangent, tangent)
        if corrected is None:
            length *= 0.5
            if length < 1e-5 * STEP:
                break
            continue
        new, iterations = corrected
        _, matrix = system.residual(new)
        bordered = np.vstack([matrix, tangent])
        direction = np.linalg.solve(bordered, np.append(np.zeros(len(tangent) - 1), 1.0))
        point, tangent = new, direction / np.linalg.norm(direction)
        solutions.append(point)
        if iterations <= 4:
            length = min(1.5 * length, STEP)
        peak = np.abs(point[: system.points]).max()
        if peak > 1.0 or not _SLOWEST <= float(system.speed(point)) / system.hopf <= _FASTEST:
            break
    return solutions
