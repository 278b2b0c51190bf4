"""Known lines of a signal, and how they are taken out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

_F = NDArray[np.float64]
_A = NDArray[Any]


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
