"""
The limit cycle as an algebraic system, and the variational equation along it.

A cycle of Eqs. (2), (3), which are odd, is given by its values at equal phases of half a
period; the equations hold at these points (Fourier collocation).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.linear_stability import critical_frequency, hunting_mode
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.wheelset import Wheelset
from hunt_ros.errors import ConfigError

Array = NDArray[np.float64]

#: Runge-Kutta steps on half a period for the variational equation.
FLOQUET_STEPS = 128
_TOLERANCE = 1e-11
_MOST_ITERATIONS = 25


class Collocation:
    """
    The algebraic system: unknowns are y and psi at the points, omega, and the speed.

    The unknown vector is scaled: y / Y, psi / Y, omega, 4 (v / v_c - 1), with Y the
    largest amplitude, so that one step length serves all.
    """

    def __init__(self, rig: RigParameters, hopf: float, largest: float, points: int) -> None:
        if points < 4 or points % 2:
            raise ConfigError(f'collocation needs an even number of points, got {points}')
        self.rig, self.hopf, self.largest, self.points = rig, hopf, largest, points
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

    def residual(self, x: Array) -> tuple[Array, Array]:
        """Equations (2), (3) at the points, the phase condition, and their Jacobian."""
        n, rig = self.points, self.rig
        y, psi, omega = x[:n] * self.largest, x[n : 2 * n] * self.largest, x[-2]
        v = (self.hopf / rig.speed_scale) * (1.0 + 0.25 * x[-1])
        forces = self.wheelset.nonlinear_forces(y, psi)
        state = np.zeros((n, 4))
        state[:, 0], state[:, 2] = y, psi
        springs = -self.wheelset.jacobian(state, self.hopf)  # columns 0 and 2 do not know v
        fy, fp, sy, sp = self.first @ y, self.first @ psi, self.second @ y, self.second @ psi
        value = np.zeros(2 * n + 1)
        value[:n] = omega**2 * sy + rig.d11 / v * omega * fy + rig.k11 * y + rig.k12 * psi
        value[n:-1] = omega**2 * sp + rig.d22 / v * omega * fp + rig.k21 * y + rig.k22 * psi
        value[:n] += forces[:, 0]
        value[n:-1] += forces[:, 1]
        value[-1] = self.to_fundamental.imag @ y
        matrix = np.zeros((2 * n + 1, 2 * n + 2))
        matrix[:n, :n] = omega**2 * self.second + rig.d11 / v * omega * self.first
        matrix[n:-1, n:-2] = omega**2 * self.second + rig.d22 / v * omega * self.first
        diagonal = np.arange(n)
        matrix[diagonal, diagonal] += springs[:, 1, 0]
        matrix[diagonal, n + diagonal] += springs[:, 1, 2]
        matrix[n + diagonal, diagonal] += springs[:, 3, 0]
        matrix[n + diagonal, n + diagonal] += springs[:, 3, 2]
        matrix[-1, :n] = self.to_fundamental.imag
        matrix[:, : 2 * n] *= self.largest
        matrix[:n, -2] = 2.0 * omega * sy + rig.d11 / v * fy
        matrix[n:-1, -2] = 2.0 * omega * sp + rig.d22 / v * fp
        slowing = -0.25 / (1.0 + 0.25 * x[-1])
        matrix[:n, -1] = rig.d11 / v * omega * fy * slowing
        matrix[n:-1, -1] = rig.d22 / v * omega * fp * slowing
        return value / self.largest, matrix / self.largest

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

    def at_speed(self, x: Array, speed: float) -> Array | None:
        """Correct a solution by Newton's iteration at a fixed speed, m/s, or None if it fails."""
        guess = x.copy()
        guess[-1] = 4.0 * (speed / self.hopf - 1.0)
        along_speed = np.zeros(len(x))
        along_speed[-1] = 1.0
        corrected = correct(self, guess, along_speed)
        return None if corrected is None else corrected[0]


def correct(system: Collocation, guess: Array, tangent: Array) -> tuple[Array, int] | None:
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


def fundamental_matrices(system: Collocation, x: Array, steps: int) -> Array:
    """
    Fundamental matrices of the variational equation at equal phases of half a period.

    Returns
    -------
    ndarray, shape (steps + 1, m, 4, 4)
        The last is minus a square root of the monodromy matrix.
    """
    phase = np.pi * np.arange(2 * steps + 1) / (2 * steps)  # steps and half steps
    jacobians = system.jacobians(x, phase)
    h = (np.pi / steps / x[:, -2])[:, None, None]
    matrices = np.empty((steps + 1, len(x), 4, 4))
    matrices[0] = np.eye(4)
    for k in range(steps):
        before = matrices[k]
        j0, j1, j2 = (jacobians[:, 2 * k + i] for i in range(3))
        a = j0 @ before
        b = j1 @ (before + 0.5 * h * a)
        c = j1 @ (before + 0.5 * h * b)
        d = j2 @ (before + h * c)
        matrices[k + 1] = before + h / 6.0 * (a + 2.0 * (b + c) + d)
    return matrices


def floquet_multipliers(system: Collocation, x: Array) -> NDArray[np.complex128]:
    """Floquet multipliers of many cycles: squares of those of the half-period map."""
    half = fundamental_matrices(system, x, FLOQUET_STEPS)[-1]
    values = np.linalg.eigvals(half).astype(np.complex128) ** 2
    order = np.argsort(np.abs(values - 1.0), axis=1)
    # The trivial multiplier is 1 to rounding: the nearest to it comes first.
    return np.asarray(np.take_along_axis(values, order, axis=1), dtype=np.complex128)
