"""Criteria that limit a sliding RMS of the lateral acceleration: over time, and over distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled
from hunt_ros.criteria.base import Criterion, CriterionSettings
from hunt_ros.sensors import STANDARD_GRAVITY
from hunt_ros.settings import setting


@compiled
def _trend_free_rms(
    values: NDArray[np.float64],
    ring: NDArray[np.float64],
    place: NDArray[np.int64],
    sums: NDArray[np.float64],
    linear: bool,
    out: NDArray[np.float64],
) -> None:
    """
    RMS about the mean (or about the straight line) of the last ring.size values.

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
        if place[1] < size:
            out[k] = np.nan
            continue
        squares = sums[2] - sums[0] * sums[0] / size
        if linear:
            slope = sums[1] - centre * sums[0]
            squares -= slope * slope / spread
        out[k] = np.sqrt(max(squares, 0.0) / size)


@dataclass(frozen=True)
class TrackSafetySettings(CriterionSettings):
    """Thresholds of 49 CFR 213.333."""

    limit: float = setting(
        0.3 * STANDARD_GRAVITY, 'limit of the RMS', unit='m/s^2', low=0.0, high=1e3
    )
    window_s: float = setting(2.0, 'length of the window', unit='s', low=0.1, high=60.0)
    trend: str = setting('linear', 'what is removed in the window', choices=('linear', 'mean'))


class TrackSafetyStandards(Criterion):
    """
    49 CFR 213.333: RMS of the truck-frame lateral acceleration over two seconds.

    Truck hunting is a sustained oscillation with an RMS of the lateral acceleration of
    the truck frame, pass band 0.5 to 10 Hz, linear trend removed, above 0.3 g over a
    sliding window of 2 s. The text in force until 2013 removed the mean and allowed 0.4 g:
    ``trend='mean', limit=3.92``. Here the acceleration is that of the wheelset, derived
    from its displacement.

    References
    ----------
    US Federal Railroad Administration, Track Safety Standards, 49 CFR 213.333, table of
    vehicle/track interaction safety limits, truck lateral acceleration and its footnotes.
    As revised by 78 FR 16052 (13 March 2013, in force 11 July 2013); before that 63 FR
    34029 (22 June 1998), footnotes 3 and 4.
    """

    name = 'cfr_213_333'
    source = '49 CFR 213.333 (FRA Track Safety Standards)'
    settings_type: ClassVar[type[CriterionSettings]] = TrackSafetySettings
    settings: TrackSafetySettings

    def _clear(self) -> None:
        size = max(round(self.settings.window_s * self.rate_hz), 3)
        self._ring = np.zeros(size)
        self._place = np.zeros(2, dtype=np.int64)
        self._sums = np.zeros(3)

    def _indices(
        self, acceleration: NDArray[np.float64], speed: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        out = np.empty(acceleration.size)
        linear = self.settings.trend == 'linear'
        _trend_free_rms(acceleration, self._ring, self._place, self._sums, linear, out)
        return out


@compiled
def _rms_over_distance(
    values: NDArray[np.float64],
    speeds: NDArray[np.float64],
    step_s: float,
    window_m: float,
    ring: NDArray[np.float64],
    place: NDArray[np.int64],
    sums: NDArray[np.float64],
    out: NDArray[np.float64],
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


@dataclass(frozen=True)
class SlidingRmsSettings(CriterionSettings):
    """Thresholds of UIC 518 / EN 14363, simplified method."""

    limit: float = setting(
        6.0, 'limit of the RMS: (12 - M/5)/2 with the bogie mass M in t', unit='m/s^2', low=0.0
    )
    centre_hz: float = setting(
        2.8, 'dominant frequency f0 of the instability', unit='Hz', low=0.1, high=50.0
    )
    half_width_hz: float = setting(2.0, 'half the pass band', unit='Hz', low=0.1, high=20.0)
    low_hz: float = setting(0.0, 'lower edge; 0: f0 less half the band', unit='Hz', low=0.0)
    high_hz: float = setting(0.0, 'upper edge; 0: f0 plus half the band', unit='Hz', low=0.0)
    window_m: float = setting(100.0, 'length of the window', unit='m', low=0.1, high=1e4)
    longest_window_s: float = setting(
        120.0, 'longest time a window may take at low speed', unit='s', low=1.0, high=3600.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.low_hz == 0.0:
            low = max(self.centre_hz - self.half_width_hz, 0.1 * self.centre_hz)
            object.__setattr__(self, 'low_hz', low)
        if self.high_hz == 0.0:
            object.__setattr__(self, 'high_hz', self.centre_hz + self.half_width_hz)


class SlidingRms(Criterion):
    """
    UIC 518 / EN 14363: RMS over 100 m in the band f0 -/+ 2 Hz.

    The normal method limits the sum of guiding forces, which a rig without measuring
    wheelsets does not have; this is the simplified method, on the lateral acceleration
    of the frame, whose limit is half of (12 - M/5) m/s^2; the default is that of a bogie
    without mass, so give the limit of yours. f0 is the frequency of the instability, which
    has to be known beforehand. The standard moves the window in steps of 10 m; here it
    moves with every sample. Without a speed it stays undefined.

    References
    ----------
    UIC Code 518, 4th edition (September 2009), and EN 14363:2016: instability criterion,
    filtering at f0 -/+ 2 Hz and sliding RMS.
    """

    name = 'uic_518'
    source = 'UIC 518 (2009) / EN 14363:2016, sliding RMS, simplified method'
    settings_type: ClassVar[type[CriterionSettings]] = SlidingRmsSettings
    settings: SlidingRmsSettings

    def _clear(self) -> None:
        size = max(round(self.settings.longest_window_s * self.rate_hz), 3)
        self._ring = np.zeros((2, size))
        self._place = np.zeros(2, dtype=np.int64)
        self._sums = np.zeros(2)

    def _indices(
        self, acceleration: NDArray[np.float64], speed: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        out = np.empty(acceleration.size)
        _rms_over_distance(
            acceleration,
            speed,
            1.0 / self.rate_hz,
            self.settings.window_m,
            self._ring,
            self._place,
            self._sums,
            out,
        )
        out[np.isnan(speed)] = np.nan
        return out
