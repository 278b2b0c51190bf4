"""Samples on a uniform grid, which every analysis of a whole record starts from."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.errors import IdentificationError
from hunt_ros.samples import Series

#: Largest share of a record that may lie in gaps longer than two sample steps.
MOST_MISSING = 0.2


def uniform(series: Series) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """
    Interpolate a series linearly onto a uniform grid, of its median step.

    Samples that are not finite, or whose stamp does not advance, are left out first.

    Parameters
    ----------
    series : Series
        In any order, with any gaps.

    Returns
    -------
    stamps_ns : ndarray of int64, shape (n,)
    values : ndarray, shape (n,)

    Raises
    ------
    IdentificationError
        For fewer than eight usable samples, or too much that is missing.
    """
    usable = np.isfinite(series.values)
    usable[1:] &= series.stamps_ns[1:] > np.maximum.accumulate(series.stamps_ns)[:-1]
    stamps, values = series.stamps_ns[usable], series.values[usable]
    if stamps.size < 8:
        raise IdentificationError(f'{stamps.size} usable samples, expected at least 8')
    step = float(np.median(np.diff(stamps)))
    count = int((stamps[-1] - stamps[0]) / step) + 1
    # Relative to the first stamp: nanoseconds of a wall clock do not fit a float64.
    grid = np.arange(count) * step
    times = (stamps - stamps[0]).astype(np.float64)
    gaps = np.diff(times)
    missing = float(gaps[gaps > 2.5 * step].sum()) / max(times[-1], 1.0)
    if missing > MOST_MISSING:
        raise IdentificationError(
            f'{missing:.0%} of the record lies in gaps, expected at most {MOST_MISSING:.0%}'
        )
    return stamps[0] + np.rint(grid).astype(np.int64), np.interp(grid, times, values)


def on_stamps(series: Series, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """
    Interpolate a slow channel (speed, continuous roller angle) at the stamps of another.

    Parameters
    ----------
    series : Series
        Stamps in order.
    stamps_ns : ndarray of int64, shape (n,)
        Where its values are wanted.

    Returns
    -------
    ndarray, shape (n,)
        NaN everywhere where the series has no usable sample.
    """
    usable = np.isfinite(series.values)
    if not usable.any():
        return np.full(stamps_ns.size, np.nan)
    origin = int(stamps_ns[0]) if stamps_ns.size else 0
    return np.interp(
        (stamps_ns - origin).astype(np.float64),
        (series.stamps_ns[usable] - origin).astype(np.float64),
        series.values[usable],
    )


def checked(values: ArrayLike, fewest: int, what: str) -> NDArray[np.float64]:
    """
    Return values as a finite one-dimensional array.

    Raises
    ------
    IdentificationError
        For fewer than `fewest` values, or one that is not finite.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or array.size < fewest:
        raise IdentificationError(
            f'{what}: got an array of shape {array.shape}, expected at least {fewest} values'
        )
    if not np.all(np.isfinite(array)):
        place = int(np.flatnonzero(~np.isfinite(array))[0])
        raise IdentificationError(
            f'{what}: value {array[place]} at index {place}, expected finite values'
        )
    return array
