"""
Largest Lyapunov exponent of a recorded signal, with its error (Fig. 5).

No maintained library computes it that imports on all the Pythons supported here, so
it is done here: nearby points of the delay-embedded orbit are followed on their way
from near to far, and the growth of ln(distance) is divided by the time it takes.
Fitting the mean curve instead, as is often done, mixes pairs that still grow with
pairs that have saturated, and comes out 5 to 25 % low on the systems of the tests.

Noise parts neighbours too, and the mean curve then bends: the rate at which distances grow
falls with the distance, to nothing at the size of the wandering that noise causes. Where
neighbours separate exponentially the rate is one at all distances. The two are compared
before an exponent is called one. A response driven by broadband noise is no orbit at all:
`surrogates` tells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

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
#: Part of the distance of points at random within which neighbours have room to separate.
ROOM = 0.5
#: Ranges of the distance in which growth is looked at, in ln(distance).
STEP = 0.35
#: Blocks of the record that vary independently, and the fewest pairs that make a rate known.
BLOCKS, FEWEST = 20, 50


@dataclass(frozen=True, eq=False)
class LyapunovExponent:
    """
    The largest exponent, and the curve it was read from.

    Parameters
    ----------
    exponent : Uncertain or None
        1/s. Its deviation is that between blocks of the record, and what it changes when
        neighbours are followed half as far. Where they do not separate (a limit cycle, a
        torus) it is the growth that noise leaves at the largest distances, or late on, zero
        within its deviation. None where noise parts neighbours altogether.
    reason : str
        Why there is no exponent; '' where there is one.
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

    exponent: Uncertain | None
    reason: str
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
    start = float(np.median(curves[:, 0]))
    curves = _over_periods(curves, round(period) if period > 3.0 else 1)
    growth = _growth_by_distance(curves, start, far, rate_hz)
    grows = _one_rate(growth)
    exponent = _separation(curves, start + math.log(NEAR), far, rate_hz) if grows else None
    reason = ''
    if exponent is None:
        exponent, reason = _staying(curves, growth, far, rate_hz)
    nonlinear = is_nonlinear(array, embedding, delay, max(round(period), 1))
    chaotic = grows and nonlinear and exponent is not None and exponent.low > 0.0
    return LyapunovExponent(
        exponent, reason, times, mean, embedding, delay / rate_hz, nonlinear, chaotic
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


def _over_periods(curves: NDArray[np.float64], period: int) -> NDArray[np.float64]:
    """
    Mean of each curve over the period just past.

    Distances swell and shrink within an orbit; without the mean a pair would be caught far
    while it swells and near while it does not.
    """
    if not 1 < period < curves.shape[1] // 2:
        return curves
    origin = (period - 1) // 2
    smooth = uniform_filter1d(curves, period, axis=1, origin=origin)[:, period:]
    return np.asarray(smooth, dtype=np.float64)


class _Growth(NamedTuple):
    """Growth of ln(distance) of neighbours, 1/s, in ranges of the distance, near ones first."""

    rate: NDArray[np.float64]
    std: NDArray[np.float64]
    #: ln(far / distance) in the middle of each range.
    below_far: NDArray[np.float64]


def _growth_by_distance(
    curves: NDArray[np.float64], start: float, far: float, rate_hz: float
) -> _Growth:
    """
    Rate of growth in ranges of the distance: from the start to near, and on in steps to far.

    In each range the pairs that came out of it, over the time that all spent in it; the
    deviation is that of leaving out one block of the record at a time, and never less than
    that of one block in which all come out of the range together. Ranges that hardly a pair
    has entered are left out.

    References
    ----------
    Gao, Hu, Tung and Cao 2006, Phys. Rev. E 74, 066204 (exponents that depend on scale).
    """
    near = start + math.log(NEAR)
    count = max(int((far - near) / STEP), 0)
    levels = np.concatenate([[start], np.linspace(near, max(far, near), count + 1)])
    last = curves.shape[1] - 1
    first = np.empty((curves.shape[0], levels.size), dtype=np.int64)
    first[:, 0] = 0
    for k, level in enumerate(levels[1:], start=1):
        there = curves >= level
        first[:, k] = np.where(there.any(axis=1), there.argmax(axis=1), last + 1)
    left = first[:, 1:] <= last
    spent = np.minimum(first[:, 1:], last) - np.minimum(first[:, :-1], last)
    spent = np.maximum(spent, 0)
    entered = (first[:, :-1] < last).sum(axis=0)
    known = (entered >= FEWEST) & (spent.sum(axis=0) > 0)
    known[int(np.argmin(known)) :] = known.all()
    blocks = np.array_split(np.arange(curves.shape[0]), BLOCKS)
    counts = np.stack([left[block].sum(axis=0) for block in blocks])[:, known]
    times = np.stack([spent[block].sum(axis=0) for block in blocks])[:, known] / rate_hz
    width = np.diff(levels)[known]
    total = times.sum(axis=0)
    rate = width * counts.sum(axis=0) / total
    rest = np.maximum(total - times, 1.0 / rate_hz)
    without = width * (counts.sum(axis=0) - counts) / rest
    spread = np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((without - rate) ** 2, axis=0))
    least = width * (entered[known] / BLOCKS) / total
    middle = 0.5 * (levels[1:] + levels[:-1])[known]
    return _Growth(rate, np.hypot(spread, least), far - middle)


def _one_rate(growth: _Growth) -> bool:
    """
    Return True where one rate at all distances fits better than one that falls to zero at far.

    Both are lines with one coefficient: the rate itself, and its fall with ln(distance). The
    first range is left out: there neighbours still turn into the direction of growth.
    """
    rate, std, below_far = (part[1:] for part in growth)
    if rate.size < 3:
        return False

    def misfit(shape: NDArray[np.float64]) -> float:
        weighted = shape / std**2
        return float(np.sum(((rate - shape * (rate @ weighted) / (shape @ weighted)) / std) ** 2))

    return misfit(np.ones(rate.size)) < misfit(below_far)


def _staying(
    curves: NDArray[np.float64], growth: _Growth, far: float, rate_hz: float
) -> tuple[Uncertain | None, str]:
    """
    Exponent of neighbours that stay together, or None and why there is none.

    The growth of the largest distances, or the slope of the mean curve late on: noise only
    adds to either, so that the smaller is the nearer.
    """
    late = curves[:, curves.shape[1] // 2 :]
    if float(late.mean()) > far + math.log(ROOM / FAR):
        apart = FAR * math.exp(float(curves[:, 0].mean()) - far)
        return None, (
            f'no straight part: noise parts neighbours, {100.0 * apart:.0f} % of the motion'
            ' apart from the start, until they are as far as any points'
        )
    steps = np.arange(late.shape[1]) / rate_hz
    across = (steps - steps.mean()) / float(np.sum((steps - steps.mean()) ** 2))
    slopes = np.array([part.mean() for part in np.array_split(late @ across, BLOCKS)])
    slope = Uncertain(float(slopes.mean()), float(np.std(slopes, ddof=1)) / math.sqrt(slopes.size))
    exponent = min(
        slope, Uncertain(float(growth.rate[-1]), float(growth.std[-1])), key=lambda x: x.value
    )
    if exponent.low <= 0.0:
        return exponent, ''
    return None, (
        f'no straight part: the growth of distances falls from {growth.rate.max():.2g} to'
        f' {exponent.value:.2g} 1/s, as noise makes it, and not to zero'
    )


def _separation(
    curves: NDArray[np.float64], near: float, far: float, rate_hz: float
) -> Uncertain | None:
    """
    Exponent from the time neighbours take from near to far; None where too few arrive.

    Near is `NEAR` times the median distance at which neighbours start: by then the
    direction of growth has been found and noise is left behind.
    """
    middle = 0.5 * (near + far)
    stretches = [_passages(curves, *ends) for ends in ((near, far), (near, middle))]
    if any(stretch is None for stretch in stretches):
        return None
    whole, early = (_by_passages(*stretch, rate_hz) for stretch in stretches if stretch)
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
