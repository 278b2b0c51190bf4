"""
Largest Lyapunov exponent of a recorded signal, with its error (Fig. 5).

No maintained library computes it that imports on all the Pythons supported here, so
it is done here: nearby points of the delay-embedded orbit are followed, and the mean
logarithm of their distance is fitted by a line where it grows like one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from hunt_ros.analysis.uniform import checked
from hunt_ros.errors import IdentificationError
from hunt_ros.samples import Uncertain


@dataclass(frozen=True, eq=False)
class LyapunovExponent:
    """
    The largest exponent, and the curve it was read from.

    Parameters
    ----------
    exponent : Uncertain
        1/s. Its deviation is that between blocks of the record.
    times_s, divergence : ndarray, shape (k,)
        Mean logarithm of the distance of neighbours after a time, s.
    fitted : (float, float)
        Times between which the line was fitted, s.
    embedding : int
        Dimension.
    delay_s : float
        s.
    chaotic : bool
        True where the exponent is positive beyond its 95 % interval and distances have
        grown by more than a factor e in the fitted stretch.
    """

    exponent: Uncertain
    times_s: NDArray[np.float64]
    divergence: NDArray[np.float64]
    fitted: tuple[float, float]
    embedding: int
    delay_s: float
    chaotic: bool


def largest_lyapunov_exponent(
    values: ArrayLike,
    rate_hz: float,
    embedding: int = 5,
    delay: int | None = None,
    follow: int | None = None,
    theiler: int | None = None,
    neighbours: int = 4,
    most_points: int = 4000,
) -> LyapunovExponent:
    """
    Largest exponent by the divergence of neighbours.

    Parameters
    ----------
    values : array_like, shape (n,)
        Uniform samples of a steady state.
    rate_hz : float
        Sample rate, Hz (1 for a map).
    embedding : int
        Dimension of the delay embedding.
    delay : int, optional
        Delay, samples; default: the first at which the autocorrelation has fallen below
        1/e (1 for a map).
    follow : int, optional
        How long neighbours are followed, samples; default: five mean periods.
    theiler : int, optional
        Neighbours must lie further apart in time than this, samples; default: one mean
        period.
    neighbours : int
        Neighbours followed from each point.
    most_points : int
        Points followed, spread over the record.

    Returns
    -------
    LyapunovExponent

    Raises
    ------
    IdentificationError
        For a record too short to follow neighbours in, or one that does not move.

    References
    ----------
    Rosenstein, Collins and De Luca 1993, Physica D 65, 117-134; Kantz 1994, Physics
    Letters A 185, 77-87; Theiler 1986, Phys. Rev. A 34, 2427.
    """
    array = checked(values, 200, 'Lyapunov exponent')
    if float(np.ptp(array)) == 0.0:
        raise IdentificationError('Lyapunov exponent: the signal does not move')
    array = array - array.mean()
    period = _mean_period(array)
    delay = _correlation_time(array) if delay is None else delay
    theiler = max(round(period), delay) if theiler is None else theiler
    follow = max(round(5.0 * period), 8) if follow is None else follow
    size = array.size - (embedding - 1) * delay
    usable = size - follow
    if usable < 4 * (theiler + follow) or usable < 100:
        raise IdentificationError(
            f'Lyapunov exponent: {array.size} values, expected at least'
            f' {5 * (theiler + follow) + (embedding - 1) * delay} to follow neighbours for'
            f' {follow} of them'
        )
    orbit = np.stack([array[k * delay : k * delay + size] for k in range(embedding)], axis=1)
    starts = np.unique(np.linspace(0, usable - 1, min(most_points, usable)).astype(np.int64))
    pairs = _neighbours(orbit, usable, starts, neighbours, theiler)
    if pairs.shape[0] < 50:
        raise IdentificationError('Lyapunov exponent: too few neighbours to follow')
    curves = _divergence(orbit, pairs, follow)
    times = np.arange(follow + 1) / rate_hz
    mean = _mean_of(curves, slice(None))
    begin, end = _growing_stretch(mean, round(period) if period > 3.0 else 0)
    slope = _slope(times, mean, begin, end)
    blocks = np.array_split(np.arange(curves.shape[0]), 10)
    slopes = np.array([_slope(times, _mean_of(curves, part), begin, end) for part in blocks])
    deviation = float(np.std(slopes, ddof=1)) / math.sqrt(slopes.size)
    # How far the line is from straight: the slopes of its two halves.
    middle = (begin + end) // 2
    if middle - begin >= 2 and end - middle >= 2:
        halves = (_slope(times, mean, begin, middle), _slope(times, mean, middle, end))
        deviation = math.hypot(deviation, 0.25 * (halves[1] - halves[0]))
    exponent = Uncertain(slope, deviation)
    grown = float(mean[end] - mean[begin])
    return LyapunovExponent(
        exponent,
        times,
        mean,
        (float(times[begin]), float(times[end])),
        embedding,
        delay / rate_hz,
        exponent.low > 0.0 and grown > 1.0,
    )


def _mean_period(array: NDArray[np.float64]) -> float:
    """Mean period, samples: the reciprocal of the mean frequency of the power spectrum."""
    power = np.abs(np.fft.rfft(array * np.hanning(array.size))) ** 2
    frequency = np.arange(power.size) / array.size
    return float(power[1:].sum() / (power[1:] @ frequency[1:]))


def _correlation_time(array: NDArray[np.float64]) -> int:
    """First lag at which the autocorrelation is below 1/e, samples."""
    size = 1 << (2 * array.size - 1).bit_length()
    power = np.abs(np.fft.rfft(array, size)) ** 2
    correlation = np.fft.irfft(power, size)[: array.size // 2]
    below = np.flatnonzero(correlation < correlation[0] / math.e)
    return max(int(below[0]), 1) if below.size else 1


def _neighbours(
    orbit: NDArray[np.float64],
    usable: int,
    starts: NDArray[np.int64],
    neighbours: int,
    theiler: int,
) -> NDArray[np.int64]:
    """Pairs (start, neighbour) further apart in time than the Theiler window, shape (m, 2)."""
    tree = cKDTree(orbit[:usable])
    # Those inside the window come first and are thrown away: ask for more than needed.
    asked = min(neighbours + 2 * theiler + 1, usable, 60 + neighbours)
    _, found = tree.query(orbit[starts], k=asked)
    pairs: list[tuple[int, int]] = []
    for start, near in zip(starts.tolist(), found, strict=True):
        apart = near[np.abs(near - start) > theiler][:neighbours]
        pairs.extend((start, int(other)) for other in apart)
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _divergence(
    orbit: NDArray[np.float64], pairs: NDArray[np.int64], follow: int
) -> NDArray[np.float64]:
    """Logarithm of the distance of each pair against time, shape (m, follow + 1)."""
    curves = np.empty((pairs.shape[0], follow + 1))
    last = orbit[:, -1]
    for step in range(follow + 1):
        # The newest coordinate alone, as Kantz does: the others repeat it later.
        curves[:, step] = np.abs(last[pairs[:, 0] + step] - last[pairs[:, 1] + step])
    with np.errstate(divide='ignore'):
        return np.log(curves)


def _mean_of(curves: NDArray[np.float64], part: slice | NDArray[np.int64]) -> NDArray[np.float64]:
    """Mean over pairs of the logarithms; a distance of exactly zero has none."""
    chosen = curves[part]
    finite = np.isfinite(chosen)
    total = np.where(finite, chosen, 0.0).sum(axis=0)
    return np.asarray(total / np.maximum(finite.sum(axis=0), 1), dtype=np.float64)


def _growing_stretch(mean: NDArray[np.float64], period: int) -> tuple[int, int]:
    """Where the curve grows in a line: past its first rise, before it saturates."""
    smooth = mean
    if period > 1 and period < mean.size // 2:
        kernel = np.ones(period) / period
        smooth = np.convolve(np.pad(mean, (period // 2, period - 1 - period // 2), 'edge'), kernel)
        smooth = smooth[period - 1 : period - 1 + mean.size]
    end_level = float(np.mean(smooth[-max(smooth.size // 8, 1) :]))
    rise = end_level - float(smooth[0])
    if rise < 1.0:
        return min(period, mean.size // 3), mean.size - 1
    begin = int(np.flatnonzero(smooth >= smooth[0] + 0.15 * rise)[0])
    end = int(np.flatnonzero(smooth >= smooth[0] + 0.7 * rise)[0])
    begin = min(begin, max(end - 3, 0))
    return begin, max(end, begin + 3) if begin + 3 < mean.size else mean.size - 1


def _slope(times: NDArray[np.float64], mean: NDArray[np.float64], begin: int, end: int) -> float:
    return float(np.polyfit(times[begin : end + 1], mean[begin : end + 1], 1)[0])
