"""
The railway criteria: each an index, a limit, a stream.

Each standard is written as one number a moment, the *index* in m/s^2, that must
not exceed one *limit*. One pass over a record therefore answers for any scaled
limit, which is how criteria are compared at equal false-alarm rates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.compiled import F1, F2, I1, R1, compiled
from hunt_ros.criteria.acceleration import LateralAcceleration
from hunt_ros.errors import ConfigError
from hunt_ros.sensors import STANDARD_GRAVITY

#: A row a grid point: the index (m/s^2; NaN while it is not yet defined) and the verdict.
CRITERION_DTYPE = np.dtype([('stamp_ns', 'i8'), ('index', 'f8'), ('exceeded', '?')])


class Criterion(ABC):
    """
    A railway stability criterion as a streaming detector on lateral displacement.

    Feeding a record sample by sample, in any blocks or whole gives the same rows. After a gap of
    more than 50 ms, or a clock that was set back, it starts anew (index NaN until its window has
    filled again), because it must not be computed across a hole.

    Parameters
    ----------
    rate_hz : float
        Rate at which the criterion works, Hz; best the displacement sensor's own.
    scale : float
        Factor on the limit of the standard, for rigs that are no full-size vehicle.

    Attributes
    ----------
    limit : float
        The limit in force, m/s^2.
    index : float
        The latest index, m/s^2; NaN while it is not defined.
    """

    name: ClassVar[str]
    norm: ClassVar[float]  # the limit of the standard, m/s^2
    band: ClassVar[tuple[float, float]] = (0.5, 10.0)  # Hz

    def __init__(self, rate_hz: float, scale: float = 1.0) -> None:
        self.rate_hz, self.limit = float(rate_hz), self.norm * scale
        self._acceleration = LateralAcceleration(self.rate_hz, *self.band)
        self.reset()

    def reset(self) -> None:
        """Forget everything: as new."""
        self._acceleration.reset()
        self.index = np.nan
        self._clear()

    @abstractmethod
    def _clear(self) -> None:
        """Forget the window."""

    @abstractmethod
    def _indices(self, acceleration: F1, speed: F1, out: F1) -> None:
        """Write the index at each grid point of a run without gap."""

    @property
    def exceeded(self) -> bool:
        """Whether the latest index is above the limit."""
        return bool(self.index > self.limit)

    def update(
        self, stamps_ns: ArrayLike, lateral: ArrayLike, speed: ArrayLike = np.nan
    ) -> NDArray[np.void]:
        """
        Take displacement samples, and give the index at the grid points they complete.

        Parameters
        ----------
        stamps_ns : array_like of int64, shape (n,)
            Header stamps.
        lateral : array_like, shape (n,)
            y, m; not finite: missing.
        speed : array_like, shape (n,) or scalar
            Running speed, m/s; only windows measured in metres use it.

        Returns
        -------
        ndarray of CRITERION_DTYPE, shape (m,)
        """
        parts = [np.zeros(0, dtype=CRITERION_DTYPE)]
        for fresh, stamps, acceleration, speeds in self._acceleration.update(
            stamps_ns, lateral, speed
        ):
            if fresh:
                self._clear()
            index = np.empty(stamps.size)
            self._indices(acceleration, speeds, index)
            rows = np.empty(stamps.size, dtype=CRITERION_DTYPE)
            rows['stamp_ns'], rows['index'], rows['exceeded'] = stamps, index, index > self.limit
            parts.append(rows)
            if index.size:
                self.index = float(index[-1])
        return np.concatenate(parts)


@compiled
def _trend_free_rms(values: R1, ring: F1, place: I1, sums: F1, out: F1) -> None:
    """
    RMS about the straight line of the last ring.size values.

    place = [next slot, values held]; sums = [sum a, sum i a, sum a^2] with i counted
    from the oldest value. The sums are formed anew at each turn of the ring, or their
    rounding errors would add up without end.
    """
    size = ring.size
    centre = 0.5 * (size - 1)
    spread = size * (size * size - 1.0) / 12.0
    for k in range(values.size):
        oldest = ring[place[0]]
        ring[place[0]] = values[k]
        place[0] += 1
        place[1] = min(place[1] + 1, size)
        if place[0] == size:
            place[0] = 0
            sums[:] = 0.0
            for i in range(size):
                sums[0] += ring[i]
                sums[1] += i * ring[i]
                sums[2] += ring[i] * ring[i]
        else:
            sums[1] += (size - 1) * values[k] - (sums[0] - oldest)
            sums[0] += values[k] - oldest
            sums[2] += values[k] * values[k] - oldest * oldest
        slope = sums[1] - centre * sums[0]
        squares = sums[2] - sums[0] * sums[0] / size - slope * slope / spread
        out[k] = np.sqrt(max(squares, 0.0) / size) if place[1] == size else np.nan


class TrackSafetyStandards(Criterion):
    """
    49 CFR 213.333: RMS of the truck-frame lateral acceleration over two seconds.

    Truck hunting is a sustained oscillation with an RMS of the lateral acceleration of
    the truck frame, pass band 0.5 to 10 Hz, linear trend removed, above 0.3 g over a
    sliding window of 2 s. Here the acceleration is that of the wheelset, derived
    from its displacement.

    References
    ----------
    US Federal Railroad Administration, Track Safety Standards, 49 CFR 213.333, table of
    vehicle/track interaction safety limits, truck lateral acceleration and its footnotes.
    As revised by 78 FR 16052 (13 March 2013, in force 11 July 2013).
    """

    name = 'cfr_213_333'
    norm = 0.3 * STANDARD_GRAVITY

    def _clear(self) -> None:
        self._ring = np.zeros(max(round(2.0 * self.rate_hz), 3))
        self._place = np.zeros(2, dtype=np.int64)
        self._sums = np.zeros(3)

    def _indices(self, acceleration: F1, speed: F1, out: F1) -> None:
        _trend_free_rms(acceleration, self._ring, self._place, self._sums, out)


@compiled
def _lowest_of_peaks(values: R1, peaks: F1, state: F1, out: F1) -> None:
    """
    Lowest of the last n peaks: n peaks in a row exceed a limit where this one does.

    A peak is the largest |a| between two changes of sign. peaks holds the last n
    complete ones, the newest first; state = [running peak, last sign]. The running peak
    counts from the moment it rises, the complete ones hold until the next is complete.
    """
    for k in range(values.size):
        sign = 1.0 if values[k] >= 0.0 else -1.0
        if state[1] != 0.0 and sign != state[1]:
            for i in range(peaks.size - 1, 0, -1):
                peaks[i] = peaks[i - 1]
            peaks[0] = state[0]
            state[0] = 0.0
        state[1] = sign
        state[0] = max(state[0], abs(values[k]))
        lowest = state[0]
        for i in range(peaks.size - 1):
            lowest = min(lowest, peaks[i])
        out[k] = max(lowest, peaks.min())


class SixPeaks(Criterion):
    """
    Chinese practice: six consecutive peaks above 8 m/s^2 in 0.5 to 10 Hz.

    Peaks of either sign count, one each half cycle.

    References
    ----------
    GB/T 5599-2019 (in force 1 July 2020; before it GB/T 5599-1985), Specification for
    dynamic performance assessment and testing verification of rolling stock, lateral
    stability of the bogie frame.
    """

    name = 'six_peaks'
    norm = 8.0
    peaks: ClassVar[int] = 6

    def _clear(self) -> None:
        self._peaks = np.zeros(self.peaks)
        self._state = np.zeros(2)

    def _indices(self, acceleration: F1, speed: F1, out: F1) -> None:
        _lowest_of_peaks(acceleration, self._peaks, self._state, out)


class TenPeaks(SixPeaks):
    """
    High-speed interoperability: ten consecutive peaks above 8 m/s^2 in 3 to 9 Hz.

    Counted as in `SixPeaks`: half cycles.

    References
    ----------
    Commission Decision 2008/232/EC of 21 February 2008 (technical specification for
    interoperability, rolling stock of the trans-European high-speed rail system, OJ L 84,
    26.3.2008, p. 132), instability of the running gear.
    """

    name = 'ten_peaks'
    band = (3.0, 9.0)
    peaks = 10


@compiled
def _rms_over_distance(
    values: R1,
    speeds: R1,
    step_s: float,
    window_m: float,
    ring: F2,
    place: I1,
    sums: F1,
    out: F1,
) -> None:
    """
    RMS over the last `window_m` metres.

    ring[0] holds the metres run in a step, ring[1] the squares; place = [next slot,
    steps held]; sums = [metres held, sum of squares], formed anew at each turn.
    """
    size = ring.shape[1]
    for k in range(values.size):
        if place[1] == size:  # so slow that the window outgrew its memory: shorten it
            tail = place[0]
            sums[0] -= ring[0, tail]
            sums[1] -= ring[1, tail]
            place[1] -= 1
        ring[0, place[0]] = speeds[k] * step_s if speeds[k] > 0.0 else 0.0
        ring[1, place[0]] = values[k] * values[k]
        sums[0] += ring[0, place[0]]
        sums[1] += ring[1, place[0]]
        place[0] += 1
        place[1] += 1
        tail = (place[0] - place[1]) % size
        full = place[1] == size
        while place[1] > 1 and sums[0] - ring[0, tail] >= window_m:
            sums[0] -= ring[0, tail]
            sums[1] -= ring[1, tail]
            tail = (tail + 1) % size
            place[1] -= 1
        if place[0] == size:
            place[0] = 0
            sums[:] = 0.0
            for i in range(size - place[1], size):
                sums[0] += ring[0, i]
                sums[1] += ring[1, i]
        # A rounding of the metres must not make a full window look unfilled.
        full = full or sums[0] >= window_m * (1.0 - 1e-9)
        out[k] = np.sqrt(max(sums[1], 0.0) / place[1]) if full else np.nan


class SlidingRms(Criterion):
    """
    UIC 518 / EN 14363: RMS over 100 m in the band f0 -/+ 2 Hz.

    The normal method limits the sum of guiding forces, which a rig without measuring
    wheelsets does not have; this is the simplified method, on the lateral acceleration
    of the frame, whose limit is half of (12 - M/5) m/s^2, here for a bogie without mass M.
    f0 is the dominant frequency of the instability, here 2.8 Hz. The standard moves the window
    in steps of 10 m; here it moves with every sample, and takes two minutes at most. Without a
    speed the index stays undefined.

    References
    ----------
    UIC Code 518, 4th edition (September 2009), and EN 14363:2016: instability criterion,
    filtering at f0 -/+ 2 Hz and sliding RMS.
    """

    name = 'uic_518'
    norm = 6.0
    band = (0.8, 4.8)

    def _clear(self) -> None:
        self._ring = np.zeros((2, max(round(120.0 * self.rate_hz), 3)))
        self._place = np.zeros(2, dtype=np.int64)
        self._sums = np.zeros(2)

    def _indices(self, acceleration: F1, speed: F1, out: F1) -> None:
        memory = self._ring, self._place, self._sums
        _rms_over_distance(acceleration, speed, 1.0 / self.rate_hz, 100.0, *memory, out)
        out[np.isnan(speed)] = np.nan


#: Every criterion by the name a parameter file gives it.
CRITERIA: dict[str, type[Criterion]] = {
    kind.name: kind for kind in (TrackSafetyStandards, SixPeaks, TenPeaks, SlidingRms)
}


def make_criterion(name: str, rate_hz: float, scale: float = 1.0) -> Criterion:
    """
    Make a criterion by its name.

    Parameters
    ----------
    name : str
        Key of `CRITERIA`.
    rate_hz, scale : float
        As `Criterion` takes them.

    Raises
    ------
    ConfigError
        For an unknown name, or a rate that is too low for its pass band.
    """
    if name not in CRITERIA:
        raise ConfigError(f'criterion {name!r} is unknown, expected one of {", ".join(CRITERIA)}')
    return CRITERIA[name](rate_hz, scale)


@dataclass(frozen=True)
class Verdict:
    """
    A criterion that began, or ceased, to exceed its limit.

    Parameters
    ----------
    stamp_ns : int
        When.
    criterion : str
        Its name in `CRITERIA`.
    exceeded : bool
        True where it began.
    index, limit : float
        m/s^2; the index is NaN where a gap ended it.
    """

    stamp_ns: int
    criterion: str
    exceeded: bool
    index: float
    limit: float


class CriteriaPanel:
    """
    Criteria side by side, fed with the same samples.

    Parameters
    ----------
    names : sequence of str
        Keys of `CRITERIA`; none is allowed.
    rate_hz, scale : float
        As `Criterion` takes them.

    Raises
    ------
    ConfigError
        For an unknown name.
    """

    def __init__(self, names: Sequence[str], rate_hz: float, scale: float = 1.0) -> None:
        self._criteria = [make_criterion(name, rate_hz, scale) for name in names]

    def reset(self) -> None:
        """Forget everything: as new."""
        for criterion in self._criteria:
            criterion.reset()

    def update(
        self, stamps_ns: ArrayLike, lateral: ArrayLike, speed: ArrayLike = np.nan
    ) -> tuple[Verdict, ...]:
        """Take samples as `Criterion.update` does; give what changed, in the order of stamps."""
        verdicts = []
        for criterion in self._criteria:
            before = criterion.exceeded
            rows = criterion.update(stamps_ns, lateral, speed)
            above = np.concatenate([[before], rows['exceeded']])
            for row in rows[above[1:] != above[:-1]]:
                stamp_ns, index, exceeded = row.item()
                verdicts.append(
                    Verdict(stamp_ns, criterion.name, exceeded, index, criterion.limit)
                )
        return tuple(sorted(verdicts, key=lambda verdict: verdict.stamp_ns))
