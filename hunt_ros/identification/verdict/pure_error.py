"""Residuals against what they scatter by: the F tests behind the lack of fit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

#: A discrepancy is a lack of fit if chance makes it in one case of a hundred, and it is
#: more than this share of the amplitude.
_LEVEL = 0.01
_SHARE = 0.01
#: Relative distance of speeds that count as one, and fewest repeats that tell their scatter.
_SAME_SPEED, _FEWEST_REPEATS = 0.005, 5
#: Share of its variance that a direction of the residuals keeps at least: the covariance of a
#: fit is not known to better.
_LEAST_LEFT = 0.05
#: Amplitudes are not known to better than this share.
_FLOOR = 1e-4


@dataclass(frozen=True)
class LackOfFit:
    """
    Result of the test.

    Parameters
    ----------
    p : float
        Probability of a discrepancy this large if the law held; NaN where there are too
        few steady states to tell.
    share : float
        RMS of the systematic discrepancy, relative to the amplitude.
    """

    p: float = math.nan
    share: float = 0.0

    @property
    def significant(self) -> bool:
        """Whether there is a discrepancy beyond chance, however small."""
        return self.p < _LEVEL

    @property
    def flagged(self) -> bool:
        """Whether the law does not fit."""
        return self.p < _LEVEL and self.share > _SHARE


def against_curve(
    speed: NDArray[np.float64],
    residual: NDArray[np.float64],
    error: NDArray[np.float64],
    bent: NDArray[np.float64] | None = None,
) -> LackOfFit:
    """
    Regress the residuals on a cubic in the speed; what scatters about it is pure error.

    A law that was fitted to these states has bent towards them. Of each direction of the cubic
    the residuals then hold only what the fit could not take up, and count for as much.

    Parameters
    ----------
    speed : ndarray, shape (n,)
        m/s.
    residual : ndarray, shape (n,)
        ln of the measured over the expected amplitude.
    error : ndarray, shape (n,)
        Standard deviation of each that is expected of random motion.
    bent : ndarray, shape (n, k), optional
        Change of ln of each expected amplitude with k independent directions of the law's
        coefficients, by one deviation each.

    Returns
    -------
    LackOfFit

    References
    ----------
    Satterthwaite, F. E. (1946), Biometrics Bulletin 2, 110-114: degrees of freedom of a sum of
    squares of unequal variances.
    """
    x = (speed - speed.mean()) / max(float(np.ptp(speed)), 1e-9)
    basis = np.vander(x, 4)
    freedom = residual.size - 4
    pure = np.inf
    # Once for the scatter of all alike, once more with the wandering of each beside it.
    for _ in range(2):
        weight = np.ones(residual.size) if pure == np.inf else _weights(pure, error)
        rows = basis * weight[:, None]
        fitted = basis @ np.linalg.lstsq(rows, residual * weight, rcond=None)[0]
        # A floor: amplitudes are not known to better than this.
        pure = max(float(np.sum((weight * (residual - fitted)) ** 2)) / freedom, _FLOOR**2)
    left = np.ones(4)
    if bent is not None:
        directions = np.linalg.qr(basis * weight[:, None])[0]
        taken = directions.T @ (weight[:, None] * bent)
        left = np.clip(1.0 - np.linalg.svd(taken, compute_uv=False) ** 2 / pure, _LEAST_LEFT, 1.0)
        left = np.concatenate([left, np.ones(4 - left.size)])
    return _ratio(fitted, weight, left, freedom, pure)


def against_repeats(
    speed: NDArray[np.float64], residual: NDArray[np.float64], error: NDArray[np.float64]
) -> LackOfFit:
    """
    Compare the mean residual at each speed with the scatter of repeats at one speed.

    Parameters
    ----------
    speed : ndarray, shape (n,)
        m/s.
    residual : ndarray, shape (n,)
        ln of the measured over the expected amplitude.
    error : ndarray, shape (n,)
        Standard deviation of each that is expected of random motion.

    Returns
    -------
    LackOfFit
        p is NaN where speeds were not repeated often enough.

    References
    ----------
    Seber, G. A. F., Lee, A. J., Linear Regression Analysis (2003), Sect. 4.4: the F test.
    """
    order = np.argsort(speed)
    speed, residual, error = speed[order], residual[order], error[order]
    cell = np.cumsum(np.diff(speed, prepend=speed[0]) > _SAME_SPEED * speed)
    count = np.bincount(cell)
    freedom = residual.size - count.size
    if freedom < _FEWEST_REPEATS:
        return LackOfFit()
    means = (np.bincount(cell, residual) / count)[cell]
    pure = max(float(np.sum((residual - means) ** 2)) / freedom, _FLOOR**2)
    weight = _weights(pure, error)
    return _ratio(means, weight, np.ones(count.size), freedom, pure)


def _weights(pure: float, error: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Weights of states that wander, of which all together scatter by `pure`.

    A law that does not fit finds a forcing that is too strong, and would be excused by it:
    what the states wander by is a part of what they are seen to scatter by, not more.
    """
    wandering = error**2
    mean = max(float(np.mean(wandering)), _FLOOR**2)
    variance = max(pure - mean, 0.0) + wandering * min(1.0, pure / mean)
    weights: NDArray[np.float64] = np.sqrt(pure / np.maximum(variance, 1e-2 * pure))
    return weights


def _ratio(
    systematic: NDArray[np.float64],
    weight: NDArray[np.float64],
    left: NDArray[np.float64],
    freedom: int,
    pure: float,
) -> LackOfFit:
    """F test of a sum of squares whose directions have variances `left`, times `pure`."""
    ratio = float(np.sum((weight * systematic) ** 2)) / float(left.sum()) / pure
    share = float(np.sqrt(np.mean(systematic**2)))
    terms = float(left.sum() ** 2 / np.sum(left**2))
    return LackOfFit(float(stats.f.sf(ratio, terms, freedom)), share)
