"""
Largest Lyapunov exponent of a recorded signal, with its error (Fig. 5).

No maintained library computes it that imports on all the Pythons supported here, so
it is done here: nearby points of the delay-embedded orbit are followed on their way
from near to far, and the growth of ln(distance) is divided by the time it takes.
Fitting the mean curve instead, as is often done, mixes pairs that still grow with
pairs that have saturated, and comes out 5 to 25 % low on the systems of the tests.

Neighbours of a noisy signal separate at once and then no further. A response driven by
broadband noise is no orbit at all: `surrogates` tells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import uniform_filter1d

from hunt_ros.analysis.surrogates import delay_vectors, is_nonlinear, neighbour_pairs
from hunt_ros.analysis.uniform import checked
from hunt_ros.errors import IdentificationError
from hunt_ros.samples import Uncertain

#: Near is this many times the first distance of neighbours, far this part of the distance
#: of points at random.
NEAR, FAR = 2.0, 0.2


@dataclass(frozen=True, eq=False)
class LyapunovExponent:
    """
    The largest exponent, and the curve it was read from.

    Parameters
    ----------
    exponent : Uncertain
        1/s. Its deviation is that between blocks of the record, and what it changes when
        neighbours are followed half as far. Where they do not separate exponentially (a
        limit cycle, a torus) it is the slope of `divergence` late on: zero but for noise,
        which still parts them by diffusion.
    times_s, divergence : ndarray, shape (k,)
        Mean logarithm of the distance of neighbours after a time, s.
    embedding : int
        Dimension.
    delay_s : float
        s.
    nonlinear : bool
        True where the record is more predictable than linear processes of its spectrum;
        False for a response to broadband noise, and for one that is all sharp lines.
    chaotic : bool
        True where the record is nonlinear, neighbours separate exponentially, from near
        to far, and the exponent is positive beyond its 95 % interval.
    """

    exponent: Uncertain
    times_s: NDArray[np.float64]
    divergence: NDArray[np.float64]
    embedding: int
    delay_s: float
    nonlinear: bool
    chaotic: bool


def largest_lyapunov_exponent(
    values: ArrayLike,
    rate_hz: float,
    embedding: int = 5,
    delay: int | None = None,
    follow: int | None = None,
    theiler: int | None = None,
    neighbours: int = 4,
    most_points: int = 2000,
) -> LyapunovExponent:
    """
    Largest exponent by the time neighbours take from near to far.

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
        How long neighbours are followed, samples; default: ten mean periods, or an eighth
        of the record if that is shorter.
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
    Letters A 185, 77-87; Aurell, Boffetta, Crisanti, Paladin and Vulpiani 1997, J. Phys. A
    30, 1-26 (passage times); Theiler 1986, Phys. Rev. A 34, 2427.
    """
    array = checked(values, 200, 'Lyapunov exponent')
    if float(np.ptp(array)) == 0.0:
        raise IdentificationError('Lyapunov exponent: the signal does not move')
    array = array - array.mean()
    period = _mean_period(array)
    delay = _correlation_time(array) if delay is None else delay
    theiler = max(round(period), delay) if theiler is None else theiler
    if follow is None:
        follow = max(min(round(10.0 * period), array.size // 8), 20)
    size = array.size - (embedding - 1) * delay
    usable = size - follow
    if usable < 4 * (theiler + follow) or usable < 100:
        raise IdentificationError(
            f'Lyapunov exponent: {array.size} values, expected at least'
            f' {5 * (theiler + follow) + (embedding - 1) * delay} to follow neighbours for'
            f' {follow} of them'
        )
    orbit = delay_vectors(array, embedding, delay)
    pairs = neighbour_pairs(orbit, usable, most_points, neighbours, theiler)
    if pairs.shape[0] < 50:
        raise IdentificationError('Lyapunov exponent: too few neighbours to follow')
    curves = _divergence(orbit, pairs, follow)
    times = np.arange(follow + 1) / rate_hz
    mean = np.asarray(np.mean(curves, axis=0), dtype=np.float64)
    far = math.log(FAR * math.sqrt(2.0 * float(np.sum(np.var(orbit, axis=0)))))
    separation = _separation(curves, far, round(period) if period > 3.0 else 1, rate_hz)
    exponent = _by_slope(curves, times, round(period)) if separation is None else separation
    grows = separation is not None and exponent.low > 0.0
    nonlinear = is_nonlinear(array, embedding, delay, max(round(period), 1))
    return LyapunovExponent(
        exponent, times, mean, embedding, delay / rate_hz, nonlinear, grows and nonlinear
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


def _divergence(
    orbit: NDArray[np.float64], pairs: NDArray[np.int64], follow: int
) -> NDArray[np.float64]:
    """Logarithm of the distance of each pair against time, shape (m, follow + 1)."""
    curves = np.empty((pairs.shape[0], follow + 1))
    for step in range(follow + 1):
        apart = orbit[pairs[:, 0] + step] - orbit[pairs[:, 1] + step]
        curves[:, step] = np.einsum('ij,ij->i', apart, apart)
    # Equal to rounding is as near as a recorded signal can tell.
    least = max(float(curves.max()) * 1e-24, 1e-300)
    return np.asarray(0.5 * np.log(np.maximum(curves, least)), dtype=np.float64)


def _separation(
    curves: NDArray[np.float64], far: float, period: int, rate_hz: float
) -> Uncertain | None:
    """
    Exponent from the time neighbours take from near to far; None where they do not separate.

    Near is `NEAR` times the median distance at which neighbours start: by then the
    direction of growth has been found and noise is left behind. Distances swell and
    shrink within an orbit; a mean over one period takes that out, or a pair would be
    caught far while it swells and near while it does not.
    Noise also drives neighbours apart, but by diffusion: each factor e takes e^2 times as
    long as the one before. Exponential growth takes as long for each.
    """
    near = float(np.median(curves[:, 0])) + math.log(NEAR)
    if 1 < period < curves.shape[1] // 2:
        origin = (period - 1) // 2  # the mean of the period just past
        curves = uniform_filter1d(curves, period, axis=1, origin=origin)[:, period:]
    middle = 0.5 * (near + far)
    stretches = [_passages(curves, *ends) for ends in ((near, far), (near, middle), (middle, far))]
    if far - near < 1.0 or any(stretch is None for stretch in stretches):
        return None
    whole, early, late = (_by_passages(*stretch, rate_hz) for stretch in stretches if stretch)
    arrived = float(np.mean((curves >= far).any(axis=1)))
    if late.value < 0.75 * early.value or arrived < 0.4:
        return None
    # How much it matters where far begins: the error that no number of pairs takes away.
    shift = 0.5 * (early.value - whole.value)
    return Uncertain(whole.value, math.hypot(whole.std, shift))


def _passages(
    curves: NDArray[np.float64], near: float, far: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """
    Growth of ln(distance) and time taken (steps), of each pair on its way from near to far.

    A pair that has not come far when it is left counts as far as it came. None where most
    pairs never leave the near.
    """
    left = curves >= near
    came = left.any(axis=1)
    if came.mean() < 0.5:
        return None
    rows = np.flatnonzero(came)
    begin = left.argmax(axis=1)[rows]
    arrived = curves[rows] >= far
    end = np.where(arrived.any(axis=1), arrived.argmax(axis=1), curves.shape[1] - 1)
    taken = end - begin
    used = taken > 0
    rows, begin, end, taken = rows[used], begin[used], end[used], taken[used]
    if rows.size < 50:
        return None
    growth = curves[rows, end] - curves[rows, begin]
    return growth, taken.astype(np.float64)


def _by_passages(
    growth: NDArray[np.float64], taken: NDArray[np.float64], rate_hz: float
) -> Uncertain:
    """Growth over time, all pairs together; the deviation is that between ten blocks."""
    value = float(growth.sum() / taken.sum()) * rate_hz
    parts = np.array_split(np.arange(growth.size), 10)
    each = np.array([growth[part].sum() / taken[part].sum() for part in parts]) * rate_hz
    return Uncertain(value, float(np.std(each, ddof=1)) / math.sqrt(each.size))


def _by_slope(curves: NDArray[np.float64], times: NDArray[np.float64], period: int) -> Uncertain:
    """
    Slope of the second half of the mean curve, for orbits that do not separate.

    The first half holds how noise parts neighbours that it had made look near.
    """
    begin = max(curves.shape[1] // 2, min(period, curves.shape[1] - 3))

    def slope(part: NDArray[np.int64]) -> float:
        mean = curves[part].mean(axis=0)
        return float(np.polyfit(times[begin:], mean[begin:], 1)[0])

    parts = np.array_split(np.arange(curves.shape[0]), 10)
    each = np.array([slope(part) for part in parts])
    value = slope(np.arange(curves.shape[0]))
    return Uncertain(value, float(np.std(each, ddof=1)) / math.sqrt(each.size))
