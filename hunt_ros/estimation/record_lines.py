"""
The lines in the displacement of whole records: which one hunts, and which are forced.

Hunting is a mode: it is excited, grows and decays, and its amplitude changes. A forced line
follows the speed, as all does that turns, or it is the same at every speed, as hum and motors
are. So the hunting is where the power of the displacement changes most, and the line is not
forced. Records that are steady throughout do not tell it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.estimation.turning import unwrapped
from hunt_ros.samples import Record, Series

_F = NDArray[np.float64]
_C = NDArray[np.complex128]

#: Where wheelsets hunt, Hz.
HUNTING_HZ = (0.5, 10.0)
#: Where lines are looked for: beyond it on both sides, in steps that are small against the width
#: of the window.
_GRID: _F = np.geomspace(0.3, 25.0, 120)
#: Standard deviation of the Gaussian window, periods: it tells lines a tenth apart, and follows
#: a hit that decays in a few periods.
_WINDOW = 2.0
#: A line that does not stay as it is by that window may by this one: it tells lines a fortieth
#: apart, so that hunting a quarter away, which comes and goes, does not lend a hum its changes.
_LONG = 8.0
#: Fewest values in a period of a line that is looked for.
_FASTEST = 2.2
#: How far the window is followed, in its standard deviations, in time and in frequency.
_REACH, _BAND = 3.0, 5.0
#: A line stands so many times (power) above the middle of its surroundings, which reach from
#: `1 / _AROUND` to `_AROUND` of its frequency: noise, once smoothed by the window, does not.
_CLEAR, _AROUND = 10.0, 2.0
#: Share of the power of a forced line that changes, at most: an amplitude within 10 %.
_STEADY = 0.01
#: A line follows the speed where its power against the way is so many times that against time:
#: at one speed both are the same.
_FOLLOWS = 1.2
#: ... and where the speeds at which its power is found are so far apart (standard deviation,
#: relative): half the width of the window, so that what stays at one frequency leaves it.
_APART = 0.04
#: So near to a line that was taken out, relative, what stands out is the rest of it.
_LEFT = 0.12
#: A line is a known one if their orders differ by less than this, relative.
_SAME = 0.05
#: A record with fewer than one value in so many places is silence: its clock was set ahead.
_SILENT = 100
#: Share of the time at which a forced line may be weaker than its `lasting` power says: it is
#: there always, so that it is seen beside hunting that is stronger for most of the time.
_WEAKER = 0.2
#: Where the middles of the lower and the upper third of the speeds differ by this, relative, a
#: line whose amplitudes there differ by less than the other is no limit cycle, which grows
#: with about the root of the speed.
_FASTER, _SAME_SIZE = 0.1, 0.02
#: What is at 80 % of the time more than so many times what it is at 20 % is hunting whose
#: frequency follows the speed, as that of wheelsets does: no wheel that turns has a line that
#: grows so.
_GROWS = 10.0
#: Samples in a period of the highest frequency that is looked at.
_SAMPLES = 8.0
#: Kinds of the power of a line.
_MEAN, _CHANGING, _LASTING = range(3)


@dataclass(frozen=True)
class ForcedLine:
    """
    A line that is not hunting.

    Parameters
    ----------
    turns_per_metre : float
        Cycles in a metre of way, 1/m; NaN for a line that stays at one frequency.
    frequency_hz : float
        Of a line that stays at it, Hz; NaN for one that follows the speed.
    """

    turns_per_metre: float = math.nan
    frequency_hz: float = math.nan

    def words(self, roller: float = math.nan) -> str:
        """
        Return the line in words.

        Parameters
        ----------
        roller : float
            Turns of the roller in a metre of way, 1/m; NaN where they are not known.
        """
        if math.isfinite(self.frequency_hz):
            return (
                f'line at {self.frequency_hz:.3g} Hz: forced, not hunting'
                ' (neither speed nor time changes it)'
            )
        if math.isfinite(roller):
            times = self.turns_per_metre / roller
            return f"line at {times:.3g} times the roller's turn: forced, not hunting"
        return (
            f'line at {self.turns_per_metre:.3g} v Hz: forced, not hunting (it follows the speed)'
        )


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
        least = values.size + math.ceil(2.0 * _REACH * _LONG * rate / lowest)
        power = 1 << math.ceil(math.log2(least))
        self._size = next(n for n in (5 * power // 8, 3 * power // 4, power) if n >= least)
        self._spectrum = np.fft.rfft(values, self._size)
        self._held = np.fft.fft(weight, self._size)

    @property
    def values(self) -> _F:
        """The displacement, m, 0 in gaps."""
        values: _F = np.fft.irfft(self._spectrum, self._size)[: self.weight.size]
        return values

    def line(self, frequency: float, width: float = _WINDOW) -> tuple[float, float, _C, _F]:
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
        self, frequency: float, width: float = _WINDOW
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


def _powers(motions: Sequence[Motion], frequency: float, width: float = _WINDOW) -> _F:
    """
    Return the power of a line in all records, m^2, shape (3,).

    That of its mean amplitude, what is more than that, and what lasts.
    """
    amplitude, _ = _amplitudes(motions, frequency, width)
    known = amplitude[np.isfinite(amplitude)]
    if known.size < 2:
        return np.zeros(3)
    lasting = np.quantile(known, _WEAKER) ** 2
    return 0.5 * np.array([known.mean() ** 2, known.var(), lasting])


def _amplitudes(
    motions: Sequence[Motion], frequency: float, width: float = _WINDOW
) -> tuple[_F, _F]:
    """Return amplitude, m, NaN in gaps, and speed of a line in all records, in a row."""
    lines = [motion.line(frequency, width) for motion in motions]
    phasor, speed = (np.concatenate([np.zeros(0), *(one[k] for one in lines)]) for k in (2, 3))
    return np.abs(phasor), speed


def _is_steady(power: _F) -> bool:
    """Return True if the amplitude of a line does not change."""
    return bool(power[_CHANGING] < _STEADY * power[:_LASTING].sum())


class RecordLines:
    """
    The lines of the displacement in records of one rig: which one hunts, which are forced.

    Parameters
    ----------
    motions : sequence of Motion or None
        Of the records; None says nothing.
    hunting_hz : tuple of float
        Where the hunting is looked for, Hz.
    known : sequence of float
        Lines that are known, in turns in a metre of way: that these follow the speed need not
        be seen.

    Notes
    -----
    A line that is found forced is taken out, and the rest looked at again: it does not hide
    the others.
    """

    def __init__(
        self,
        motions: Sequence[Motion | None],
        hunting_hz: tuple[float, float] = HUNTING_HZ,
        known: Sequence[float] = (),
    ) -> None:
        self._range = hunting_hz
        self._known = known
        self._motions = [motion for motion in motions if motion is not None]
        self._follow()
        self._fixed: list[float] = []
        self._orders: list[float] = []
        while self._find_fixed() or self._find_orders():
            self._follow()

    @property
    def hunting_hz(self) -> float | None:
        """Frequency of the mode whose power changes most, Hz; None where all is steady."""
        changing = self._powers[:, _CHANGING]
        for place, frequency in self._in_range(changing, _CLEAR):
            return None if _is_steady(self._powers[place]) else frequency
        return None

    @property
    def strongest_hz(self) -> float | None:
        """
        Frequency of the hunting, Hz, also where all is steady; None where nothing is seen.

        Where all is steady the strongest line that is none of the known ones is the limit cycle.
        """
        lines = self._in_range(self._powers[:, _MEAN], 0.0)
        unknown = (hz for _, hz in lines if not self._is_known(hz / self._speed))
        return self.hunting_hz or next(unknown, None)

    def _in_range(self, power: _F, clear: float) -> Iterator[tuple[int, float]]:
        """Give place and frequency, Hz, of the lines where hunting is looked for."""
        for place in _lines(power, clear):
            frequency = _between(power, place)
            if self._range[0] <= frequency <= self._range[1]:
                yield place, frequency

    @property
    def _speed(self) -> float:
        """Median of the speeds, m/s; NaN where none is known."""
        speeds = [float(np.median(motion.speed)) for motion in self._motions]
        return float(np.median(speeds)) if speeds else math.nan

    def forced(self) -> list[ForcedLine]:
        """Return the forced lines: those that follow the speed, then those of one frequency."""
        found = [ForcedLine(turns_per_metre=order) for order in self._orders]
        return found + [ForcedLine(frequency_hz=frequency) for frequency in self._fixed]

    def unknown(self) -> list[ForcedLine]:
        """Return those of the forced lines that are none of the known ones."""
        # At one speed a known line is at one frequency.
        return [
            line
            for line in self.forced()
            if not self._is_known(line.turns_per_metre)
            and not self._is_known(line.frequency_hz / self._speed)
        ]

    def _is_known(self, order: float) -> bool:
        return any(abs(order / one - 1.0) < _SAME for one in self._known)

    def _follow(self) -> None:
        """Look at the motion as it is now, against time and against the way."""
        self._powers = np.array([_powers(self._motions, one) for one in _GRID.tolist()])
        self._ways = [motion.by_way() for motion in self._motions]

    def _find_fixed(self) -> bool:
        """Find the lines of one frequency, and take them out; return False if there is none."""

        def width(frequency: float, power: float) -> float:
            """Return the width of the window by which a line stays as it is; 0: by none."""
            stays = (one for one in (_WINDOW, _LONG) if self._stays(frequency, one))
            return next(stays, 0.0)

        return _take_out(self._motions, self._powers[:, _LASTING], 1.0, self._fixed, width)

    def _find_orders(self) -> bool:
        """Find those that follow the speed, and take them out; return False if there is none."""
        ways = [way for way in self._ways if way is not None]
        if not ways:
            return False
        # What a frequency of the grid is in way, with one mean speed of all records.
        mean = _GRID[0] / float(np.mean([way.lowest for way in ways]))
        speed = np.concatenate([way.speed for way in ways])
        slow, fast = np.percentile(speed, [1.0, 99.0]) * (0.95, 1.05)

        def width(order: float, power: float) -> float:
            """Return the width of the window if a line is that of something that turns, else 0."""
            # Over time it would be somewhere between these, or beside them.
            first, last = np.searchsorted(_GRID, [slow * order, fast * order])
            others = self._powers[max(int(first) - 1, 0) : int(last) + 1, _LASTING]
            clear = power > _FOLLOWS * others.max()
            return _WINDOW if clear and self._turns(ways, order) else 0.0

        lasting = np.array([_powers(ways, one / mean)[_LASTING] for one in _GRID.tolist()])
        found = _take_out(ways, lasting, mean, self._orders, width)
        if found:
            self._motions = [
                motion if way is None else motion.by_time(way)
                for motion, way in zip(self._motions, self._ways, strict=True)
            ]
        return found

    def _turns(self, ways: Sequence[Motion], order: float) -> bool:
        """
        Return True if a line, cycles a metre, is of something that turns.

        It is seen at speeds between which it must move, and is no hunting of the kinematic
        wavelength (Klingel, 1883), which grows out of the quiet motion and dies out again.
        """
        if self._is_known(order):
            return True
        amplitude, speed = _amplitudes(ways, order)
        known = np.isfinite(amplitude) & np.isfinite(speed)
        weight = amplitude[known] ** 2
        if not weight.sum() > 0.0:
            return False
        low, high = np.quantile(amplitude[known], [_WEAKER, 1.0 - _WEAKER])
        if high > _GROWS * low:
            return False
        mean = float(np.average(speed[known], weights=weight))
        apart = math.sqrt(float(np.average((speed[known] - mean) ** 2, weights=weight)))
        return apart > _APART * mean

    def _stays(self, frequency: float, width: float) -> bool:
        """Return True if a line is the same always, also where a limit cycle would not be."""
        if not _is_steady(_powers(self._motions, frequency, width)):
            return False
        if not self._range[0] <= frequency <= self._range[1]:
            return True
        amplitude, speed = _amplitudes(self._motions, frequency, width)
        known = np.isfinite(amplitude) & np.isfinite(speed)
        if known.sum() < 3:
            return False
        low, high = np.quantile(speed[known], [1.0 / 3.0, 2.0 / 3.0])
        slow, fast = known & (speed <= low), known & (speed >= high)
        if not np.median(speed[fast]) > (1.0 + _FASTER) * np.median(speed[slow]):
            return False
        change = float(np.mean(amplitude[fast]) / np.mean(amplitude[slow])) - 1.0
        return abs(change) < _SAME_SIZE


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
    both = np.isfinite(turned) & np.isfinite(way) & (step > 0.0)
    covered = float(way[both].sum())
    return (
        abs(float(turned[both].sum())) / (2.0 * math.pi * covered) if covered > 0.0 else math.nan
    )


def _take_out(
    motions: Sequence[Motion],
    lasting: _F,
    unit: float,
    known: list[float],
    width_of: Callable[[float, float], float],
) -> bool:
    """
    Find forced lines among the peaks of the lasting power, and take them out.

    `width_of` a line and its power is that of its window, 0 where it is not forced; what is left
    of the known ones is none. The grid is in cycles a second, a line in those of the motions.
    """
    found = []
    for place in _lines(lasting):
        line = _between(lasting, place) / unit
        if not any(abs(math.log(line / one)) < _LEFT for one in known) and (
            width := width_of(line, float(lasting[place]))
        ):
            found.append(_exact(motions, line, width))
    for line in found:
        for motion in motions:
            motion.remove(line)
    known += found
    return bool(found)


def _exact(motions: Sequence[Motion], frequency: float, width: float = _WINDOW) -> float:
    """Return the frequency of a line by how its phasors turn, in cycles a second or a metre."""
    found, weight = 0.0, 0.0
    for motion in motions:
        centre, step, phasor, _ = motion.line(frequency, width)
        # Each period counts alike: where hunting passes through the line it is the larger one.
        angle = np.angle(phasor[1:] * np.conj(phasor[:-1]))
        turn = complex(np.exp(1j * angle[np.isfinite(angle)]).sum())
        turns = math.atan2(turn.imag, turn.real) / (2.0 * math.pi)
        found += abs(turn) * (centre + turns / step)
        weight += abs(turn)
    return found / weight if weight > 0.0 else frequency


def _between(power: _F, place: int) -> float:
    """Return the frequency of a peak by the parabola through its three points, Hz."""
    left, top, right = np.log(np.maximum(power[place - 1 : place + 2], 1e-300)).tolist()
    bend = left - 2.0 * top + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    ratio = float(_GRID[1] / _GRID[0])
    return float(_GRID[place] * ratio ** min(max(shift, -0.5), 0.5))


def _lines(power: _F, clear: float = _CLEAR) -> Iterator[int]:
    """Give the places of the lines, peaks that are clear of their surroundings, largest first."""
    inner = power[1:-1]
    peaks = 1 + np.flatnonzero((inner >= power[:-2]) & (inner > power[2:]))
    for place in peaks[np.argsort(-power[peaks])].tolist():
        around = (_GRID[place] / _AROUND < _GRID) & (_GRID[place] * _AROUND > _GRID) & (power > 0)
        if power[place] > clear * float(np.median(power[around])):
            yield place


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
    several = max(math.floor(1.0 / (_SAMPLES * _GRID[-1] * step)), 1)
    window = np.hanning(4 * several + 1)[1:-1]
    weight = np.convolve(weight, window, 'same')[::several] / window.sum()
    even = np.convolve(even, window, 'same')[::several] / window.sum()
    rate = 1.0 / (several * step)
    at = np.arange(even.size) / rate
    speed = np.abs(_at(record.get('speed'), stamps[0] + at * 1e9))
    return Motion(rate, even, weight, speed, float(_GRID[0]))


def _at(series: Series | None, stamps_ns: _F) -> _F:
    """Return a slow channel at stamps; NaN where there is none."""
    told = None if series is None else series.finite()
    if told is None or len(told) < 2:
        return np.full(stamps_ns.size, math.nan)
    return np.interp(stamps_ns, told.stamps_ns, told.values)
