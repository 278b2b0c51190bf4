"""
Whittle's likelihood of a periodogram, and its maximum.

The bins of a periodogram are nearly independent, and distributed about the expected spectrum as an
exponential variable: the likelihood needs the expectation alone (Whittle 1953, J. R. Stat. Soc. B
15, 125-139). What is expected is the matter of a law.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

_F = NDArray[np.float64]

#: Of each parameter: step of its derivative, and the farthest it goes at once. Parameters are
#: logarithms, or of the order of 1.
_STEP, _FAR = 1e-5, 0.5


class Whittle:
    """
    Minus the logarithm of likelihood times prior, and where it is least.

    Parameters
    ----------
    expected : callable
        Makes of parameters, shape (p,), the expected spectrum, shape (n,); None where they have
        no meaning.
    power : ndarray, shape (n,)
        Periodogram.
    weight : ndarray, shape (n,)
        Independent windows averaged in each bin; 0: left out.
    mean, std : ndarray, shape (p,)
        Normal prior of each parameter; infinite `std`: none.
    """

    def __init__(
        self, expected: Callable[[_F], _F | None], power: _F, weight: _F, mean: _F, std: _F
    ) -> None:
        self._expected, self._power, self._weight = expected, power, weight
        self._mean, self._std = mean, std

    def cost(self, theta: _F) -> float:
        """Return -ln of likelihood times prior; infinite where there is none."""
        expected = self._expected(theta)
        if expected is None:
            return math.inf
        fit = np.sum(self._weight * (np.log(expected) + self._power / expected))
        total = float(fit) + 0.5 * float(np.sum(((theta - self._mean) / self._std) ** 2))
        return total if math.isfinite(total) else math.inf

    def slopes(self, theta: _F) -> tuple[_F, _F, _F]:
        """
        Derivatives at parameters that have a likelihood.

        Returns
        -------
        gradient : ndarray, shape (p,)
            Of the cost.
        information : ndarray, shape (p, p)
            Fisher's, with that of the prior.
        relative : ndarray, shape (p, n)
            Derivatives of ln of the spectrum.
        """
        expected = self._expected(theta)
        assert expected is not None
        relative = np.zeros((theta.size, expected.size))
        for k in range(theta.size):
            for step in (_STEP, -_STEP):
                moved = theta.copy()
                moved[k] += step
                there = self._expected(moved)
                if there is not None:
                    relative[k] = (there - expected) / (step * expected)
                    break
        gradient = relative @ (self._weight * (1.0 - self._power / expected))
        gradient += (theta - self._mean) / self._std**2
        information = (self._weight * relative) @ relative.T + np.diag(self._std**-2.0)
        return gradient, information, relative

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
