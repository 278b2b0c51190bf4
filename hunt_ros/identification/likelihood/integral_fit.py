"""
Where the trajectory fit starts: integral least squares.

Over a few seconds the logarithm of the amplitude changes by the integral of the growth
rate; this is linear in the law's coefficients. Noise in the regressors (r^2, r^4)
biases it, so that it gives a start and never a result.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.growth_law import monomials
from hunt_ros.identification.likelihood.path_likelihood import Path

#: Length of the integration, in steps of the envelope.
_SPAN = 4


def integral_start(path: Path, floor: float, scale: float) -> NDArray[np.float64]:
    """
    Estimate a growth law by integral least squares.

    Parameters
    ----------
    path : Path
        The measured envelope.
    floor : float
        Amplitude below which motion is noise, in units of A_ref.
    scale : float
        Largest sensible rate, 1/s: width of the weak prior that keeps directions the
        data do not show at zero.

    Returns
    -------
    ndarray, shape (6,)
    """
    amplitude = np.abs(path.phasor)
    rows: list[NDArray[np.float64]] = []
    changes: list[NDArray[np.float64]] = []
    weights: list[NDArray[np.float64]] = []
    segment = np.cumsum(path.restart)
    columns = monomials(path.u, np.nan_to_num(amplitude) ** 2)
    step = np.diff(path.time, prepend=path.time[0])
    area = np.zeros_like(columns)
    area[1:] = 0.5 * (columns[1:] + columns[:-1]) * step[1:, None]
    area = np.cumsum(area, axis=0)
    missing = np.cumsum(~np.isfinite(amplitude))
    for span in (1, _SPAN):
        if path.time.size <= span:
            continue
        head, tail = slice(None, -span), slice(span, None)
        good = (segment[head] == segment[tail]) & (missing[head] == missing[tail])
        good &= (
            np.isfinite(amplitude[head]) & (amplitude[head] > floor) & (amplitude[tail] > floor)
        )
        if not good.any():
            continue
        a, b = amplitude[head][good], amplitude[tail][good]
        rows.append((area[tail] - area[head])[good])
        changes.append(np.log(b / a))
        variance = (floor / 4.0) ** 2 * (1.0 / a**2 + 1.0 / b**2) + 0.01**2
        weights.append(1.0 / np.sqrt(variance))
    prior = np.eye(columns.shape[1]) / scale
    if not rows:
        return np.zeros(columns.shape[1])
    weight = np.concatenate(weights)
    matrix = np.concatenate([np.concatenate(rows) * weight[:, None], prior])
    right = np.concatenate([np.concatenate(changes) * weight, np.zeros(columns.shape[1])])
    solution: NDArray[np.float64] = np.linalg.lstsq(matrix, right, rcond=None)[0]
    return solution
