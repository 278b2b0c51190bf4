"""
Spectra: how known lines are taken out, and the one likelihood.

The likelihood is Whittle's, of one channel or of several together, and its maximum.

The bins of a periodogram are nearly independent, and distributed about the expected spectrum as
an exponential variable, or those of several channels about the expected cross-spectral matrix as
a complex Wishart one: the likelihood needs the expectation alone (Whittle 1953, J. R. Stat. Soc.
B 15, 125-139). What is expected is the matter of a law: the wheelset's, a smooth one, that of a
second mode.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

_F = NDArray[np.float64]
_A = NDArray[Any]

#: Of each parameter: step of its derivative, and the farthest it goes at once. Parameters are
#: logarithms, or of the order of 1.
_STEP, _FAR = 1e-5, 0.5


def without_lines(
    values: _F, place: _F, waves: Sequence[NDArray[np.complex128]] | _A, weight: _F | float = 1.0
) -> _F:
    """
    Return values without their trend and without lines whose phase is known.

    Parameters
    ----------
    values, place : ndarray, shape (n,)
        The values, and where they are, in any units.
    waves : sequence of ndarray of complex, each of shape (n,)
        exp(i phase) of each line, or its mean over what a value is the mean of.
    weight : ndarray, shape (n,), optional
        Of each value in the least squares.

    Returns
    -------
    ndarray, shape (n,)
    """
    columns = [np.ones(values.size), place, *(part for w in waves for part in (w.real, w.imag))]
    basis = np.stack(columns, axis=1)
    weighted = basis * np.broadcast_to(weight, values.shape)[:, None]
    left: _F = values - basis @ np.linalg.lstsq(weighted, values * weight, rcond=None)[0]
    return left


class Whittle:
    """
    Minus the logarithm of likelihood times prior, and where it is least.

    Parameters
    ----------
    expected : callable
        Makes of parameters, shape (p,), the expected matrices, shape (..., n, n); None where they
        have no meaning.
    spectra : ndarray, shape (..., n, n)
        Cross-spectral matrices of n channels.
    weight : ndarray, shape (...)
        Independent windows averaged in each; 0: left out.
    mean, std : ndarray, shape (p,)
        Normal prior of each parameter; infinite `std`: none.
    """

    def __init__(
        self,
        expected: Callable[[_F], _A | None],
        spectra: _A,
        weight: _F,
        mean: _F,
        std: _F,
    ) -> None:
        self.expected, self.spectra, self.weight = expected, spectra, weight
        self._mean, self._std = mean, std

    def seen(self, theta: _F) -> _F:
        """Return the power of the spectra over that expected, shape (...): 1 on average."""
        expected = self.expected(theta)
        assert expected is not None
        seen: _F = _trace(inverse(expected), self.spectra) / expected.shape[-1]
        return seen

    def cost(self, theta: _F) -> float:
        """Return -ln of likelihood times prior; infinite where there is none."""
        expected = self.expected(theta)
        if expected is None:
            return math.inf
        size = determinant(expected).real
        if not np.all(size > 0.0):
            return math.inf
        fit = np.sum(self.weight * (np.log(size) + _trace(inverse(expected), self.spectra)))
        total = float(fit) + 0.5 * float(np.sum(((theta - self._mean) / self._std) ** 2))
        return total if math.isfinite(total) else math.inf

    def slopes(self, theta: _F) -> tuple[_F, _F, _A]:
        """
        Derivatives at parameters that have a likelihood.

        Returns
        -------
        gradient : ndarray, shape (p,)
            Of the cost.
        information : ndarray, shape (p, p)
            Fisher's, with that of the prior.
        relative : ndarray, shape (p, ..., n, n)
            S^-1 dS/dtheta: of one channel the derivative of ln S.
        """
        expected = self.expected(theta)
        assert expected is not None
        inverted = inverse(expected)
        relative = np.zeros((theta.size, *expected.shape), dtype=expected.dtype)
        for k in range(theta.size):
            for step in (_STEP, -_STEP):
                moved = theta.copy()
                moved[k] += step
                there = self.expected(moved)
                if there is not None:
                    relative[k] = _product(inverted, (there - expected) / step)
                    break
        off = _product(inverted, expected - self.spectra)
        mirrored = relative.swapaxes(-1, -2).reshape(theta.size, -1)
        weight = self.weight[..., None, None]
        gradient = (mirrored @ (weight * off).ravel()).real
        information = (mirrored @ (weight * relative).reshape(theta.size, -1).T).real
        gradient += (theta - self._mean) / self._std**2
        return gradient, information + np.diag(self._std**-2.0), relative

    def least(self, theta: _F, evaluations: int = 60) -> _F | None:
        """
        Return the parameters of least cost near others; None where those have no likelihood.

        Fisher's scoring, damped as by Levenberg and Marquardt.
        """
        cost, damping = self.cost(theta), 1e-2
        if not math.isfinite(cost):
            return None
        while evaluations > 0:
            gradient, information, _ = self.slopes(theta)
            # A parameter of no influence must not make it singular.
            scale = np.diag(np.maximum(np.diag(information), 1e-12))
            gain = 0.0
            while gain <= 0.0 and damping < 1e8 and evaluations > 0:
                step = np.linalg.solve(information + damping * scale, -gradient)
                moved = theta + np.clip(step, -_FAR, _FAR)
                gain = cost - self.cost(moved)
                evaluations -= 1
                damping = max(damping / 5.0, 1e-9) if gain > 0.0 else max(damping * 5.0, 1e-6)
            if gain > 0.0:
                theta, cost = moved, cost - gain
            if gain < 1e-4:
                break
        return theta


def determinant(matrices: _A) -> _A:
    """Return the determinants of 1 x 1 or 2 x 2 matrices: LAPACK goes matrix by matrix."""
    found: _A = matrices[..., 0, 0]
    if matrices.shape[-1] == 2:
        found = found * matrices[..., 1, 1] - matrices[..., 0, 1] * matrices[..., 1, 0]
    return found


def inverse(matrices: _A) -> _A:
    """Return the inverses of 1 x 1 or 2 x 2 matrices; not finite where there is none."""
    adjugate = np.ones_like(matrices)
    if matrices.shape[-1] == 2:
        adjugate[..., 0, 0], adjugate[..., 1, 1] = matrices[..., 1, 1], matrices[..., 0, 0]
        adjugate[..., 0, 1], adjugate[..., 1, 0] = -matrices[..., 0, 1], -matrices[..., 1, 0]
    inverted: _A = adjugate / determinant(matrices)[..., None, None]
    return inverted


def _product(one: _A, other: _A) -> _A:
    """Return the products of two matrices each."""
    product: _A = one * other if one.shape[-1] == 1 else one @ other
    return product


def _trace(one: _A, other: _A) -> _F:
    """Return the trace of the product of hermitian matrices."""
    found: _F = np.sum(one * other.swapaxes(-1, -2), axis=(-1, -2)).real
    return found
