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
from typing import Any

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
Series = dict[Monomial, Complex]

#: Resonant monomials, in the order of Eq. (22): D1, D4, D7', D10', D15'.
RESONANT: tuple[Monomial, ...] = ((1, 0, 1), (2, 1, 0), (1, 0, 2), (2, 1, 1), (3, 2, 0))

_HIGHEST_GRADE = 5
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
        w101=complex(w[1, 0, 1][0]),
        w210=complex(w[2, 1, 0][0]),
        length_scale=rig.length_scale,
        time_scale=rig.time_scale,
    )


def _critical_vectors(rig: RigParameters, speed: float) -> tuple[Complex, Complex]:
    """Right vector with y* = 1 and left vector with l . v = 1, of the only critical pair."""
    found = eigenvalues(rig, speed) * rig.time_scale
    mode = hunting_mode(rig, speed)
    condition = np.linalg.norm(mode.adjoint) * np.linalg.norm(mode.shape)
    if found[2].real > -_SMALLEST or condition > 1.0 / _SMALLEST:
        listed = ', '.join(f'{value:.4g}' for value in found)
        raise ConfigError(f'{rig.name}: degenerate critical eigenvalues ({listed})')
    return mode.shape, mode.adjoint


def _parametrise(
    rig: RigParameters, wheelset: Wheelset, speed: float, omega: float
) -> tuple[Series, dict[Monomial, complex]]:
    """Solve the cohomological equation to grade 5; return the coefficients of W and R."""
    matrix = wheelset.linear_matrix(speed)
    right, left = _critical_vectors(rig, speed)
    damping = np.diag(np.diag(matrix) * np.array([0.0, 1.0, 0.0, 1.0]))
    w: Series = {(1, 0, 0): right, (0, 1, 0): right.conj()}
    r: dict[Monomial, complex] = {(1, 0, 0): 1j * omega}
    for grade in range(3, _HIGHEST_GRADE + 1, 2):
        forces = _forces(w, wheelset, grade)
        for monomial in _monomials(grade):
            a, b, c = monomial
            if a < b:  # W is real: the rest are conjugates
                continue
            known: NDArray[Any] = forces.get(monomial, np.zeros(4)) - _transported(w, r, monomial)
            # A(eps) = A + damping (1 / (1 + eps) - 1), Eq. (5)
            for power in range(1, c + 1):
                if (a, b, c - power) in w:
                    known = known + (-1) ** power * (damping @ w[a, b, c - power])
            shifted = (1j * (a - b)) * omega * np.eye(4) - matrix
            if a - b == 1:  # M W + R v = known with l . W = 0
                bordered = np.block([[shifted, right[:, None]], [left, np.zeros(1)]])
                solution = np.linalg.solve(bordered, np.append(known, 0.0))
                w[monomial], r[monomial] = solution[:4], complex(solution[4])
            else:
                w[monomial] = np.linalg.solve(shifted, known).astype(np.complex128)
            w[b, a, c] = w[monomial].conj()
    return w, r


def _monomials(grade: int) -> list[Monomial]:
    """All (a, b, c) with a + b + 2 c = grade and a + b > 0."""
    return [
        (grade - 2 * c - b, b, c)
        for c in range(grade // 2, -1, -1)
        for b in range(grade - 2 * c + 1)
    ]


def _transported(w: Series, r: dict[Monomial, complex], target: Monomial) -> Complex:
    """Part of dW/deta R + dW/dconj(eta) conj(R) at one monomial that is known already."""
    total = np.zeros(4, dtype=np.complex128)
    for (a, b, c), rate in r.items():
        if (a, b, c) == (1, 0, 0):
            continue
        # eta^i conj(eta)^j times the rate of eta, then of conj(eta)
        i, j, k = target[0] - a + 1, target[1] - b, target[2] - c
        if i > 0 and (i, j, k) in w and (i, j, k) != (1, 0, 0):
            total += i * rate * w[i, j, k]
        i, j, k = target[0] - b, target[1] - a + 1, target[2] - c
        if j > 0 and (i, j, k) in w and (i, j, k) != (0, 1, 0):
            total += j * rate.conjugate() * w[i, j, k]
    return total


def _forces(w: Series, wheelset: Wheelset, grade: int) -> Series:
    """Coefficients of N(W) at one grade: minus the cubic and quintic terms of (2), (3)."""
    y = {m: complex(value[0]) for m, value in w.items()}
    psi = {m: complex(value[2]) for m, value in w.items()}
    result: Series = {}
    for order, table in ((3, wheelset.cubic), (5, wheelset.quintic)):
        for j in range(order + 1):
            if order <= grade and table[:, j].any():
                product = _power_product([y] * (order - j) + [psi] * j, grade)
                for monomial, value in product.items():
                    if sum(monomial) + monomial[2] == grade:
                        force = result.setdefault(monomial, np.zeros(4, dtype=np.complex128))
                        force[1::2] -= value * table[:, j]
    return result


def _power_product(factors: list[dict[Monomial, complex]], grade: int) -> dict[Monomial, complex]:
    """Product of scalar series, truncated above a grade."""
    product = factors[0]
    for left_over, factor in zip(range(len(factors) - 2, -1, -1), factors[1:], strict=True):
        result: dict[Monomial, complex] = {}
        for (a, b, c), x in product.items():
            for (i, j, k), z in factor.items():
                # each factor still to come has grade 1 at least
                if a + b + i + j + 2 * (c + k) + left_over <= grade:
                    key = (a + i, b + j, c + k)
                    result[key] = result.get(key, 0.0) + x * z
        product = result
    return product
