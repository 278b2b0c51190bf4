"""
The displacement of whole records, even in time or in way, as the search for lines needs it.

A line is seen through a Gaussian window: its spectrum is Gaussian too, and lets no other line in.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.estimation.turning import unwrapped
from hunt_ros.samples import Record, Series

_F = NDArray[np.float64]
_C = NDArray[np.complex128]

#: Where lines are looked for: beyond it on both sides, in steps that are small against the width
#: of the window.
GRID: _F = np.geomspace(0.3, 25.0, 120)
#: Standard deviation of the Gaussian window, periods: it tells lines a tenth apart, and follows
#: a hit that decays in a few periods.
WINDOW = 2.0
#: A line that does not stay as it is by that window may by this one: it tells lines a fortieth
#: apart, so that hunting a quarter away, which comes and goes, does not lend a hum its changes.
LONG = 8.0
#: Fewest values in a period of a line that is looked for.
_FASTEST = 2.2
#: How far the window is followed, in its standard deviations, in time and in frequency.
_REACH, _BAND = 3.0, 5.0
#: A record with fewer than one value in so many places is silence: its clock was set ahead.
_SILENT = 100
#: Between two readings of the encoder so far apart, s, nobody knows how the roller turned.
_GAP_S = 3.0
#: Samples in a period of the highest frequency that is looked at.
_SAMPLES = 8.0


class Motion:
    """
    The displacement in one record, even in time or in way.

    Parameters
    ----------
    rate : float
        Values in a second or in a metre.
    values, weight, speed : ndarray, shape (n,)
        Weight 0 in gaps; speed in m/s, NaN where it is not known.
    lowest : float
        Lowest frequency that is looked at, in cycles a second or a metre.
    """

    def __init__(self, rate: float, values: _F, weight: _F, speed: _F, lowest: float) -> None:
        self.rate, self.weight, self.speed, self.lowest = rate, weight, speed, lowest
        # What is before the start is behind the end: the longest window finds nothing there.
        least = values.size + math.ceil(2.0 * _REACH * LONG * rate / lowest)
        power = 1 << math.ceil(math.log2(least))
        self._size = next(n for n in (5 * power // 8, 3 * power // 4, power) if n >= least)
        self._spectrum = np.fft.rfft(values, self._size)
        self._held = np.fft.fft(weight, self._size)

    @property
    def values(self) -> _F:
        """The displacement, m, 0 in gaps."""
        values: _F = np.fft.irfft(self._spectrum, self._size)[: self.weight.size]
        return values

    def line(self, frequency: float, width: float = WINDOW) -> tuple[float, float, _C, _F]:
        """
        Return the line of a frequency, in cycles a second or a metre, by so wide a window.

        Returns
        -------
        centre, step : float
            What its phasors turn against, in cycles a second or a metre; their distance, s or m:
            about a period.
        phasor, speed : ndarray, shape (n,)
            m, NaN in gaps; m/s, NaN where it is not known.
        """
        periods = self.weight.size * frequency / self.rate
        if periods <= 2.0 * _REACH * width or self.rate <= _FASTEST * frequency:
            return frequency, 1.0, np.zeros(0, dtype=np.complex128), np.zeros(0)
        centre, bins, window = self._window(frequency, width)
        order = np.argsort(bins % bins.size)
        step = self._size / bins.size
        place = (np.arange(bins.size) * step).astype(np.int64)
        place = place[place < self.weight.size]
        band = np.zeros(bins.size, dtype=np.complex128)  # nothing above half the rate
        part = self._spectrum[centre + bins[0] : centre + bins[-1] + 1]
        band[: part.size] = part * window[: part.size]
        smooth = np.fft.ifft(band[order])[: place.size]
        held = np.fft.ifft((window * self._held[bins])[order])[: place.size]
        share = held.real / step
        known = np.where(share > 0.45, 2.0 * smooth / step / np.maximum(share, 0.1), math.nan)
        return centre * self.rate / self._size, step / self.rate, known, self.speed[place]

    def remove(self, frequency: float) -> None:
        """Take a line out."""
        if self.rate > _FASTEST * frequency:
            centre, bins, window = self._window(frequency)
            part = self._spectrum[centre + bins[0] : centre + bins[-1] + 1]
            part *= 1.0 - window[: part.size]

    def _window(
        self, frequency: float, width: float = WINDOW
    ) -> tuple[int, NDArray[np.int64], _F]:
        """Return the Gaussian window, as its spectrum: no other line is folded into it."""
        deviation = frequency / (2.0 * math.pi * width) * self._size / self.rate
        reach = math.ceil(_BAND * deviation)
        bins = np.arange(-reach, reach + 1)
        return (
            round(frequency * self._size / self.rate),
            bins,
            np.exp(-0.5 * (bins / deviation) ** 2),
        )

    def by_way(self) -> Motion | None:
        """Return the motion in time as one even in way; None where the way is not known."""
        way = np.cumsum(self.speed) / self.rate
        if not np.isfinite(way).all() or not way[-1] > 0.0:
            return None
        mean = float(way[-1]) * self.rate / way.size
        even = np.arange(way.size) * (mean / self.rate)
        values, weight, speed = (
            np.interp(even, way, one) for one in (self.values, self.weight, self.speed)
        )
        return Motion(self.rate / mean, values, weight, speed, self.lowest / mean)

    def by_time(self, way: Motion) -> Motion:
        """Return the motion that is even in way as one in time, the time of this one."""
        at = np.cumsum(self.speed) / self.rate
        values = np.interp(at, np.arange(way.weight.size) / way.rate, way.values)
        return Motion(self.rate, values, self.weight, self.speed, self.lowest)


def turns_per_metre(record: Record, diameter_m: float) -> float:
    """
    Return the turns of the roller in a metre of way, by its encoder or its diameter.

    Parameters
    ----------
    record : Record
        With a speed.
    diameter_m : float
        0 where it is not known.

    Returns
    -------
    float
        1/m; NaN where neither is known.
    """
    encoder, speed = record.get('roller'), record.get('speed')
    if encoder is None or speed is None or len(encoder) < 2:
        return 1.0 / (math.pi * diameter_m) if diameter_m > 0.0 else math.nan
    angle = unwrapped(encoder)
    running = np.abs(_at(speed, encoder.stamps_ns.astype(np.float64)))
    step = np.diff(encoder.stamps_ns) * 1e-9
    turned, way = np.diff(angle), 0.5 * (running[1:] + running[:-1]) * step
    both = np.isfinite(turned) & np.isfinite(way) & (step > 0.0) & (step < _GAP_S)
    covered = float(way[both].sum())
    if covered <= 0.0:
        return math.nan
    # Second by second: a run may reverse, and an encoder at rest may shake.
    second = np.unique(encoder.stamps_ns[1:][both] // 1_000_000_000, return_inverse=True)[1]
    turns = np.bincount(second, weights=turned[both])
    return float(np.abs(turns).sum()) / (2.0 * math.pi * covered)


def motion_of(record: Record) -> Motion | None:
    """
    Return the displacement of a record, thinned to what the search for lines needs.

    Parameters
    ----------
    record : Record
        Its lateral channel is looked at, or yaw where there is none.

    Returns
    -------
    Motion or None
        None where it is no motion: too few samples, clocks that were set, or nothing but silence.
    """
    usable = [name for name in ('lateral', 'yaw') if len(record.get(name, ())) > 100]
    if not usable:
        return None
    series = record[usable[0]].finite()
    stamps, values = series.stamps_ns, series.values
    if stamps.size < 100 or np.any(np.diff(stamps) <= 0):  # clocks that were set back
        return None
    time = (stamps - stamps[0]) * 1e-9
    trend = np.polynomial.Polynomial.fit(time, values, 1)
    step = float(np.median(np.diff(time)))
    place = np.rint(time / step).astype(np.int64)
    if place[-1] > _SILENT * place.size:
        return None
    weight = np.bincount(place).astype(np.float64)
    even = np.bincount(place, weights=values - trend(time))
    # Thinned to what the grid needs; the window lets no hum through.
    several = max(math.floor(1.0 / (_SAMPLES * GRID[-1] * step)), 1)
    window = np.hanning(4 * several + 1)[1:-1]
    weight = np.convolve(weight, window, 'same')[::several] / window.sum()
    even = np.convolve(even, window, 'same')[::several] / window.sum()
    rate = 1.0 / (several * step)
    at = np.arange(even.size) / rate
    speed = np.abs(_at(record.get('speed'), stamps[0] + at * 1e9))
    return Motion(rate, even, weight, speed, float(GRID[0]))


def _at(series: Series | None, stamps_ns: _F) -> _F:
    """Return a slow channel at stamps; NaN where there is none."""
    told = None if series is None else series.finite()
    if told is None or len(told) < 2:
        return np.full(stamps_ns.size, math.nan)
    return np.interp(stamps_ns, told.stamps_ns, told.values)
