"""
Steady-state amplitudes against speed (Fig. 6), and the critical speeds read off them.

Two amplitudes stand side by side: the paper's, the mean of the maxima of the time
history (Sect. 2.4), which holds the roughness line and the noise; and that of the
hunting component alone, which the normal form speaks of.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hunt_ros.samples import key

Direction = Literal['up', 'down', 'hold']
Bounds: TypeAlias = tuple[float | None, float | None]

#: Distance of two kinds of amplitudes, quiet and hunting, at least, in ln A.
_APART = math.log(2.5)
#: Median change of the growth, of ln A from one instant to the next, in motion that follows
#: a curve: sixteen recordings of noise had 0.11 to 0.24, twenty-eight that hunt up to 0.06. And of
#: how many it is told at least.
_SMOOTH, _FEWEST = 0.08, 5
#: Amplitude, of the median of rest, that noise does not reach (Rayleigh's: once in 10^7).
ABOVE_NOISE = 5.0


@dataclass(frozen=True)
class SteadyState:
    """
    One steady (or, along a slow ramp, nearly steady) amplitude.

    Parameters
    ----------
    speed : float
        m/s.
    amplitude, amplitude_std : float
        Of the hunting component, m; the deviation is that of the mean.
    direction : 'up', 'down' or 'hold'
        Which way the speed was going.
    cycles : int
        Hunting cycles behind the number.
    maxima, maxima_std : float
        The paper's amplitude (mean of the maxima), m; NaN where not worked out.
    kind : 'plateau' or 'ramp'
    source : str
    start_ns, end_ns : int
    """

    speed: float = field(metadata=key('speed_mps'))
    amplitude: float = field(metadata=key('amplitude_m'))
    amplitude_std: float = field(metadata=key('amplitude_std_m'))
    direction: Direction
    cycles: int
    maxima: float = field(default=math.nan, metadata=key('maxima_m'))
    maxima_std: float = field(default=math.nan, metadata=key('maxima_std_m'))
    kind: Literal['plateau', 'ramp'] = 'plateau'
    source: str = ''
    start_ns: int = field(default=0, metadata=key(''))
    end_ns: int = field(default=0, metadata=key(''))


def mean_of_maxima(
    values: NDArray[np.float64], rate_hz: float, frequency_hz: float
) -> tuple[float, float, int]:
    """
    Amplitude as the paper takes it: the mean of the maxima of the time history.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Lateral displacement at an even rate, m; NaN is left out.
    rate_hz, frequency_hz : float
        Sample rate and hunting frequency, Hz: one maximum is taken a cycle.

    Returns
    -------
    mean, std : float
        Of the maxima above the mean displacement, and the deviation of that mean, m.
    count : int
        Number of cycles; with fewer than two, mean and std are NaN.

    References
    ----------
    The paper, Sect. 2.4: "the average value of the maximum amplitude of the
    oscillation in the time history".
    """
    period = max(round(rate_hz / frequency_hz), 1)
    count = values.size // period
    if count < 2:
        return math.nan, math.nan, count
    cycles = values[: count * period].reshape(count, period)
    cycles = cycles[np.isfinite(cycles).all(axis=1)]
    if len(cycles) < 2:
        return math.nan, math.nan, len(cycles)
    maxima = cycles.max(axis=1) - float(np.mean(cycles))
    return float(maxima.mean()), standard_error(maxima), len(cycles)


def standard_error(values: NDArray[np.float64]) -> float:
    """
    Standard deviation of the mean of a correlated series.

    The integrated autocorrelation is summed up to its first negative value; a mean of
    correlated amplitudes is worth fewer values than were recorded.

    Parameters
    ----------
    values : ndarray, shape (n,)
        In the order of time.

    Returns
    -------
    float
        In the unit of the values; NaN for fewer than two.

    References
    ----------
    Sokal, A. (1997), Monte Carlo methods in statistical mechanics, Sect. 3.
    """
    n = values.size
    if n < 2:
        return math.nan
    centred = values - values.mean()
    variance = float(np.mean(centred**2))
    if variance <= 0.0:
        return 0.0
    total = 1.0
    for lag in range(1, max(2, n // 3)):
        correlation = float(np.mean(centred[lag:] * centred[:-lag])) / variance
        if correlation <= 0.0:
            break
        total += 2.0 * correlation
    return math.sqrt(variance * min(total, n) / max(n - 1, 1))


@dataclass(frozen=True)
class ObservedCriticalSpeeds:
    """
    Critical speeds as read off the jumps, Sects. 2.3 and 2.4; None where there is no jump.

    Parameters
    ----------
    v_c, v_n : float or None
        Middle between the last state before and the first after the jump on the way up,
        and down, m/s.
    step : float or None
        Distance of those two states, the larger of the two, m/s.
    threshold : float or None
        Amplitude that parts quiet from hunting states, m.
    v_c_between, v_n_between : (float or None, float or None)
        Speeds between which each lies, m/s: of the states either side of its jump (mean over
        the runs); None for a side that nothing shows.
    """

    v_c: float | None = None
    v_n: float | None = None
    step: float | None = field(default=None, metadata=key('step_mps'))
    threshold: float | None = field(default=None, metadata=key(''))
    v_c_between: Bounds = field(default=(None, None), metadata=key('v_c_between_mps'))
    v_n_between: Bounds = field(default=(None, None), metadata=key('v_n_between_mps'))

    @property
    def hysteresis_width(self) -> float | None:
        """v_c - v_n, m/s."""
        return None if self.v_c is None or self.v_n is None else self.v_c - self.v_n


def hunting_threshold(amplitudes: NDArray[np.float64]) -> float | None:
    """
    Amplitude that parts quiet from hunting, m: the split that parts the logarithms best.

    Parameters
    ----------
    amplitudes : ndarray, shape (n,)
        Amplitudes of steady states or of instants, m.

    Returns
    -------
    float or None
        None where they are all of one kind (less than a factor 2.5 apart).

    References
    ----------
    Otsu, N. (1979), IEEE Trans. Systems, Man, and Cybernetics 9, 62-66.
    """
    logs = np.sort(np.log(amplitudes[np.isfinite(amplitudes) & (amplitudes > 0.0)]))
    if logs.size < 2:
        return None
    below = np.arange(1, logs.size)
    sums = np.cumsum(logs)
    low = sums[:-1] / below
    high = (sums[-1] - sums[:-1]) / (logs.size - below)
    best = int(np.argmax(below * (logs.size - below) * (high - low) ** 2))
    middle = 0.5 * (low[best] + high[best])
    apart = high[best] - low[best] >= _APART
    # Few of one kind among many of the other: a gap parts them where no variance does.
    # Below the split a gap is one of noise, which may be as small as it likes.
    gaps = np.diff(logs)
    centres = 0.5 * (logs[1:] + logs[:-1])
    gaps = np.where(centres > middle, gaps, 0.0)
    widest = int(np.argmax(gaps))
    if gaps[widest] >= _APART:
        return float(math.exp(centres[widest]))
    return float(math.exp(middle)) if apart else None


def threshold_of_motion(amplitude: NDArray[np.float64]) -> float | None:
    """
    The same of motion as it goes on, instant by instant: None also where it is noise alone.

    Amplitudes that noise drives are of two kinds by their size (Rayleigh's distribution has small
    ones, too); but the large ones change from one instant to the next as they like, and those of
    hunting, or of a kick that dies, along a curve.

    Parameters
    ----------
    amplitude : ndarray, shape (n,)
        m, evenly in the order of time, record after record.

    Returns
    -------
    float or None
        m.
    """
    found = hunting_threshold(amplitude)
    if found is None:
        return None
    # Where hunting is rare the split lies within the noise.
    beyond = max(found, ABOVE_NOISE * float(np.nanmedian(amplitude[amplitude <= found])))
    for level in (found, beyond):
        bend = np.diff(np.log(np.where(amplitude > level, amplitude, np.nan)), 2)
        bend = np.abs(bend[np.isfinite(bend)])
        if bend.size >= _FEWEST and float(np.median(bend)) < _SMOOTH:
            return found
    return None


def observed_critical_speeds(
    states: Sequence[SteadyState], kicks: Sequence[tuple[str, int]] = ()
) -> ObservedCriticalSpeeds:
    """
    Read the critical speeds off the jumps of the amplitude.

    Parameters
    ----------
    states : sequence of SteadyState
        In the order in which they were recorded, run after run.
    kicks : sequence of (source, stamp in ns)
        A jump that followed a kick is the kick's, and is left out.

    Returns
    -------
    ObservedCriticalSpeeds
        Means over the runs where several show the jump. These are observations: noise
        throws a rig out before v_c, and a sweep overshoots both.
    """
    amplitude = np.array([state.amplitude for state in states])
    threshold = hunting_threshold(amplitude)
    if threshold is None:
        return ObservedCriticalSpeeds()
    large = max(threshold, ABOVE_NOISE * float(np.median(amplitude[amplitude <= threshold])))
    ups: list[tuple[float, float]] = []
    downs: list[tuple[float, float]] = []
    # The two speeds either side of each jump, the lower first.
    for before, after in pairwise(states):
        if before.source != after.source or _kicked(before, after, kicks):
            continue
        sides = min(before.speed, after.speed), max(before.speed, after.speed)
        if before.amplitude < large <= after.amplitude and after.direction == 'up':
            ups.append(sides)
        if before.amplitude >= large > after.amplitude and after.direction == 'down':
            downs.append(sides)
    steps = [high - low for low, high in ups + downs]
    return ObservedCriticalSpeeds(
        float(np.mean(ups)) if ups else None,
        float(np.mean(downs)) if downs else None,
        max(steps) if steps else None,
        threshold,
        _mean_sides(ups),
        _mean_sides(downs),
    )


def _mean_sides(jumps: Sequence[tuple[float, float]]) -> Bounds:
    """Mean lower and mean upper speed of jumps; None without any."""
    if not jumps:
        return None, None
    low, high = np.mean(jumps, axis=0)
    return float(low), float(high)


def _kicked(before: SteadyState, after: SteadyState, kicks: Sequence[tuple[str, int]]) -> bool:
    """Whether a kick lies between two states, or within the first."""
    return any(
        source == before.source and before.start_ns <= stamp <= after.end_ns
        for source, stamp in kicks
    )
