"""
Centre manifold and normal form, Eqs. (8)-(25) and Appendix C, by the parametrisation method.

The paper reduces in two steps, z3, z4 = h(z1, z2, eps) and then zeta = eta + q(eta).
Both are one map x = W(eta, conj(eta), eps) with dynamics deta/dt* = R(eta, conj(eta), eps),
and substituting it into Eq. (6) gives the cohomological equation

    dW/deta R + dW/dconj(eta) conj(R) = A(eps) W + N(W),

solved here monomial by monomial, eta^a conj(eta)^b eps^c, in the grading of Eq. (C-1) on
(eps counts as two). It needs none of the printed formulas (C-7) to (C-12), some of
which are misprinted.

Where a - b = 1 the equation is singular: solvability gives the coefficient of R, and the
part of W along the eigenvector is set to zero, which is Gamma_1 = Gamma_4 = Gamma_7 =
Gamma_10 = Gamma_15 = 0 of (C-5), (C-10).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.linear_stability import (
    critical_frequency,
    critical_speed,
    eigenvalues,
    hunting_mode,
)
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.wheelset import Wheelset
from hunt_ros.errors import ConfigError

Complex = NDArray[np.complex128]
Monomial = tuple[int, int, int]

#: Resonant monomials, in the order of Eq. (22): D1, D4, D7', D10', D15'.
RESONANT: tuple[Monomial, ...] = ((1, 0, 1), (2, 1, 0), (1, 0, 2), (2, 1, 1), (3, 2, 0))

#: Least damping of the second pair, and least |l . v| of unit vectors, taken as regular.
_SMALLEST = 1e-6


@dataclass(frozen=True)
class ComplexNormalForm:
    """
    Eq. (22) with complex coefficients, in the paper's coordinate.

    deta/dt* = i omega eta + D1 eps eta + D4 eta^2 conj(eta) + D7 eps^2 eta
    + D10 eps eta^2 conj(eta) + D15 eta^3 conj(eta)^2, with eta = r exp(i theta),
    and y* = 2 r cos(theta) at first order.

    Parameters
    ----------
    critical_speed : float
        v_c, m/s.
    omega : float
        Eq. (B-1), dimensionless.
    D1, D4, D7, D10, D15 : complex
        Dimensionless; D7, D10, D15 are the primed ones.
    w101, w210 : complex
        y* components of the resonant part of W: the fundamental amplitude of y*
        is 2 r |1 + w101 eps + w210 r^2 + ...|.
    length_scale, time_scale : float
        d0, m, and 1 / omega_psi, s.
    """

    critical_speed: float
    omega: float
    D1: complex
    D4: complex
    D7: complex
    D10: complex
    D15: complex
    w101: complex
    w210: complex
    length_scale: float
    time_scale: float

    @property
    def amplitude_coordinate(self) -> NormalForm:
        """
        The real form in r = (fundamental amplitude of y) / (2 d0): compare this with measurements.

        With rho = r (1 + p eps + q r^2), p = Re w101 and q = Re w210, the growth
        rate of rho has D10 - 2 p D4 + 2 q D1 in place of D10. D1, D4, D7 and, at
        this order, Re D15 stay what they were.
        """
        p, q = self.w101.real, self.w210.real
        return NormalForm(
            critical_speed=self.critical_speed,
            D1=self.D1.real,
            D4=self.D4.real,
            D7=self.D7.real,
            D10=self.D10.real - 2.0 * p * self.D4.real + 2.0 * q * self.D1.real,
            D15=self.D15.real,
            length_scale=self.length_scale,
            time_scale=self.time_scale,
            frequency_hz=self.omega / (2.0 * math.pi * self.time_scale),
        )


def normal_form_of(rig: RigParameters) -> ComplexNormalForm:
    """
    Normal form of a rig, from Eqs. (2), (3) to Eq. (22).

    Raises
    ------
    ConfigError
        Without a Hopf point, or where the second pair of eigenvalues is critical
        too or the critical pair degenerate.
    """
    speed, omega = critical_speed(rig), critical_frequency(rig)
    w, r = _parametrise(rig, Wheelset(rig), speed, omega)
    d1, d4, d7, d10, d15 = (complex(r[monomial]) for monomial in RESONANT)
    return ComplexNormalForm(
        speed,
        omega,
        D1=d1,
        D4=d4,
        D7=d7,
        D10=d10,
        D15=d15,
        w101=complex(w[0, 1, 0, 1]),
        w210=complex(w[0, 2, 1, 0]),
        length_scale=rig.length_scale,
        time_scale=rig.time_scale,
    )


def _parametrise(
    rig: RigParameters, wheelset: Wheelset, speed: float, omega: float
) -> tuple[Complex, Complex]:
    """
    Solve the cohomological equation to grade 5.

    Returns
    -------
    w : ndarray, shape (4, 6, 6, 3)
        Coefficients of W by the powers of eta, conj(eta) and eps.
    r : ndarray, shape (6, 6, 3)
        Of R.
    """
    matrix, mode = wheelset.linear_matrix(speed), hunting_mode(rig, speed)
    found = eigenvalues(rig, speed) * rig.time_scale
    condition = np.linalg.norm(mode.adjoint) * np.linalg.norm(mode.shape)
    if found[2].real > -_SMALLEST or condition > 1.0 / _SMALLEST:
        listed = ', '.join(f'{value:.4g}' for value in found)
        raise ConfigError(f'{rig.name}: degenerate critical eigenvalues ({listed})')
    right, left = mode.shape, mode.adjoint
    damping = np.diag(np.diag(matrix) * np.array([0.0, 1.0, 0.0, 1.0]))
    w, r = np.zeros((4, 6, 6, 3), np.complex128), np.zeros((6, 6, 3), np.complex128)
    w[:, 1, 0, 0], w[:, 0, 1, 0], r[1, 0, 0] = right, right.conj(), 1j * omega
    for grade in (3, 5):
        # Of this grade only what lower ones make: its own coefficients are zero still.
        moved = _times(_slope(w), r)
        known = -moved - moved.conj().swapaxes(1, 2)  # W is real: the rest are conjugates
        known[1::2] -= _forces(w[0], w[2], wheelset)
        for a, b, c in _monomials(grade):
            # A(eps) = A + damping (1 / (1 + eps) - 1), Eq. (5)
            slowed = sum((-1) ** k * (damping @ w[:, a, b, c - k]) for k in range(1, c + 1))
            right_hand = known[:, a, b, c] + slowed
            shifted = (1j * (a - b)) * omega * np.eye(4) - matrix
            if a - b == 1:  # M W + R v = known with l . W = 0
                bordered = np.block([[shifted, right[:, None]], [left, np.zeros(1)]])
                solution = np.linalg.solve(bordered, np.append(right_hand, 0.0))
                w[:, a, b, c], r[a, b, c] = solution[:4], solution[4]
            else:
                w[:, a, b, c] = np.linalg.solve(shifted, right_hand)
            w[:, b, a, c] = w[:, a, b, c].conj()
    return w, r


def _monomials(grade: int) -> list[Monomial]:
    """All (a, b, c) with a + b + 2 c = grade and a >= b, a > 0."""
    powers = ((c, grade - 2 * c) for c in range(grade // 2, -1, -1))
    return [(degree - b, b, c) for c, degree in powers for b in range(degree // 2 + 1)]


def _times(one: Complex, other: Complex) -> Complex:
    """Product of two series, shapes (..., 6, 6, 3) and (6, 6, 3); higher powers are cut."""
    product = np.zeros_like(one)
    for a, b, c in np.argwhere(other):
        product[..., a:, b:, c:] += other[a, b, c] * one[..., : 6 - a, : 6 - b, : 3 - c]
    return product


def _slope(series: Complex) -> Complex:
    """Derivative with respect to eta of a series, shape (4, 6, 6, 3)."""
    found = np.zeros_like(series)
    found[:, :-1] = series[:, 1:] * np.arange(1.0, 6.0)[:, None, None]
    return found


def _forces(y: Complex, psi: Complex, wheelset: Wheelset) -> Complex:
    """Cubic and quintic terms of (2), (3) of two series: shape (2, 6, 6, 3)."""
    one = np.zeros_like(y)
    one[0, 0, 0] = 1.0
    of_y, of_psi = (list(accumulate([x] * 5, _times, initial=one)) for x in (y, psi))
    force = np.zeros((2, *y.shape), np.complex128)
    for order, table in ((3, wheelset.cubic), (5, wheelset.quintic)):
        for j in np.flatnonzero(table.any(axis=0)):
            force += np.multiply.outer(table[:, j], _times(of_y[order - j], of_psi[j]))
    return force
