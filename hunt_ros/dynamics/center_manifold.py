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

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.complex_form import ComplexNormalForm
from hunt_ros.dynamics.linear_stability import critical_frequency, critical_speed
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.wheelset import Wheelset
from hunt_ros.errors import ConfigError

__all__ = ['ComplexNormalForm', 'normal_form_of', 'normal_forms_of']

Complex = NDArray[np.complex128]
Monomial = tuple[int, int, int]
Series = dict[Monomial, Complex]

#: Resonant monomials, in the order of Eq. (22): D1, D4, D7', D10', D15'.
RESONANT: tuple[Monomial, ...] = ((1, 0, 1), (2, 1, 0), (1, 0, 2), (2, 1, 1), (3, 2, 0))

_HIGHEST_GRADE = 5
#: Least damping of the second pair, and least |l . v| of unit vectors, taken as regular.
_SMALLEST = 1e-6


def normal_form_of(rig: RigParameters) -> ComplexNormalForm:
    """
    Normal form of a rig, from Eqs. (2), (3) to Eq. (22).

    Raises
    ------
    ConfigError
        Without a Hopf point, or where the second pair of eigenvalues is critical
        too or the critical pair degenerate.
    """
    return normal_forms_of([rig])[0]


def normal_forms_of(rigs: Sequence[RigParameters]) -> list[ComplexNormalForm]:
    """
    Normal forms of many rigs at once: one pass of array operations.

    Raises
    ------
    ConfigError
        As `normal_form_of`, naming the first rig that is at fault.
    """
    if not rigs:
        return []
    speeds = np.array([critical_speed(rig) for rig in rigs])
    omega = np.array([critical_frequency(rig) for rig in rigs])
    matrices = np.stack(
        [Wheelset(rig).linear_matrix(v) for rig, v in zip(rigs, speeds, strict=True)]
    )
    right, left = _critical_vectors(rigs, matrices, omega)
    terms = np.stack([np.hstack([Wheelset(rig).cubic, Wheelset(rig).quintic]) for rig in rigs])
    w, r = _parametrise(matrices, omega, right, left, terms)
    return [_assembled(rig, speeds[n], omega[n], w, r, n) for n, rig in enumerate(rigs)]


def _assembled(
    rig: RigParameters, speed: float, omega: float, w: Series, r: Series, n: int
) -> ComplexNormalForm:
    d1, d4, d7, d10, d15 = (complex(r[monomial][n]) for monomial in RESONANT)
    return ComplexNormalForm(
        float(speed),
        float(omega),
        D1=d1,
        D4=d4,
        D7=d7,
        D10=d10,
        D15=d15,
        w101=complex(w[1, 0, 1][n, 0]),
        w210=complex(w[2, 1, 0][n, 0]),
        length_scale=rig.length_scale,
        time_scale=rig.time_scale,
    )


def _critical_vectors(
    rigs: Sequence[RigParameters], matrices: NDArray[np.float64], omega: NDArray[np.float64]
) -> tuple[Complex, Complex]:
    """Right vectors with y* = 1 and left vectors with l . v = 1, shapes (n, 4)."""
    values, vectors = np.linalg.eig(matrices.astype(np.complex128))
    inverse = np.linalg.inv(vectors)
    place = np.argmin(np.abs(values - 1j * omega[:, None]), axis=1)
    rows = np.arange(len(rigs))
    lowest = np.sort(values.real, axis=1)[:, 1]  # the more damped pair
    norm = np.linalg.norm(inverse[rows, place], axis=1)
    for n, rig in enumerate(rigs):
        if lowest[n] > -_SMALLEST or norm[n] > 1.0 / _SMALLEST:
            found = ', '.join(f'{value:.4g}' for value in values[n])
            raise ConfigError(f'{rig.name}: degenerate critical eigenvalues ({found})')
    right = vectors[rows, :, place]
    scale = right[:, :1]
    return right / scale, inverse[rows, place] * scale


def _parametrise(
    matrices: NDArray[np.float64],
    omega: NDArray[np.float64],
    right: Complex,
    left: Complex,
    terms: NDArray[np.float64],
) -> tuple[Series, Series]:
    """Solve the cohomological equation to grade 5; return the coefficients of W and R."""
    damping = np.zeros_like(matrices)
    damping[:, 1, 1], damping[:, 3, 3] = matrices[:, 1, 1], matrices[:, 3, 3]
    w: Series = {(1, 0, 0): right, (0, 1, 0): right.conj()}
    r: Series = {(1, 0, 0): 1j * omega.astype(np.complex128)}
    for grade in range(3, _HIGHEST_GRADE + 1, 2):
        forces = _forces(w, terms, grade)
        for monomial in _monomials(grade):
            a, b, c = monomial
            if a < b:  # W is real: the rest are conjugates
                continue
            known: NDArray[Any] = forces.get(monomial, np.zeros_like(right))
            known = known - _transported(w, r, monomial)
            # A(eps) = A + damping (1 / (1 + eps) - 1), Eq. (5)
            for power in range(1, c + 1):
                lower = w.get((a, b, c - power))
                if lower is not None:
                    known = known + (-1) ** power * np.einsum('nij,nj->ni', damping, lower)
            shifted = (1j * (a - b)) * omega[:, None, None] * np.eye(4) - matrices
            if a - b == 1:
                solution: NDArray[Any] = _solve_bordered(shifted, right, left, known)
                w[monomial], r[monomial] = solution[:, :4], solution[:, 4]
            else:
                solution = np.linalg.solve(shifted, known[..., None])
                w[monomial] = solution[..., 0].astype(np.complex128)
            w[b, a, c] = w[monomial].conj()
    return w, r


def _monomials(grade: int) -> list[Monomial]:
    """All (a, b, c) with a + b + 2 c = grade and a + b > 0."""
    return [
        (grade - 2 * c - b, b, c)
        for c in range(grade // 2, -1, -1)
        for b in range(grade - 2 * c + 1)
    ]


def _transported(w: Series, r: Series, target: Monomial) -> Complex:
    """Part of dW/deta R + dW/dconj(eta) conj(R) at one monomial that is known already."""
    total = np.zeros_like(w[1, 0, 0])
    for (a, b, c), rate in r.items():
        if (a, b, c) == (1, 0, 0):
            continue
        # eta^i conj(eta)^j times the rate of eta, then of conj(eta)
        i, j, k = target[0] - a + 1, target[1] - b, target[2] - c
        if i > 0 and i + j > 0 and (i, j, k) in w and (i, j, k) != (1, 0, 0):
            total = total + i * rate[:, None] * w[i, j, k]
        i, j, k = target[0] - b, target[1] - a + 1, target[2] - c
        if j > 0 and (i, j, k) in w and (i, j, k) != (0, 1, 0):
            total = total + j * rate.conj()[:, None] * w[i, j, k]
    return total


def _forces(w: Series, terms: NDArray[np.float64], grade: int) -> Series:
    """Coefficients of N(W) at one grade: minus the cubic and quintic terms of (2), (3)."""
    y = {m: value[:, 0] for m, value in w.items()}
    psi = {m: value[:, 2] for m, value in w.items()}
    result: Series = {}
    column = 0
    for order in (3, 5):
        for j in range(order + 1):
            if order <= grade and terms[:, :, column].any():
                product = _power_product([y] * (order - j) + [psi] * j, grade)
                for monomial, value in product.items():
                    if sum(monomial) + monomial[2] == grade:
                        force = result.setdefault(monomial, np.zeros_like(w[1, 0, 0]))
                        force[:, 1::2] -= value[:, None] * terms[:, :, column]
            column += 1
    return result


def _power_product(factors: list[Series], grade: int) -> Series:
    """Product of scalar series, truncated above a grade."""
    product = factors[0]
    for left_over, factor in zip(range(len(factors) - 2, -1, -1), factors[1:], strict=True):
        result: Series = {}
        for (a, b, c), x in product.items():
            for (i, j, k), z in factor.items():
                # each factor still to come has grade 1 at least
                if a + b + i + j + 2 * (c + k) + left_over <= grade:
                    key = (a + i, b + j, c + k)
                    result[key] = result[key] + x * z if key in result else x * z
        product = result
    return product


def _solve_bordered(
    matrix: NDArray[Any], right: Complex, left: Complex, known: Complex
) -> Complex:
    """Solve M W + R v = known with l . W = 0; columns 0-3 are W, column 4 is R."""
    count = len(matrix)
    bordered = np.zeros((count, 5, 5), dtype=np.complex128)
    bordered[:, :4, :4] = matrix
    bordered[:, :4, 4] = right
    bordered[:, 4, :4] = left
    vector = np.concatenate([known, np.zeros((count, 1))], axis=1)
    return np.asarray(np.linalg.solve(bordered, vector[..., None])[..., 0], dtype=np.complex128)
