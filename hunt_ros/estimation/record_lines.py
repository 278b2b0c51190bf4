"""
The lines in the displacement of a whole record: which one hunts, and which are forced.

Hunting is a mode: it is excited, grows and decays, and its amplitude changes. A forced line is
steady in time, as hum and motors are, or follows the speed, as all does that turns. So the
hunting is where the power of the displacement changes most, and the line does not follow the
speed. A record that is steady throughout does not tell it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.estimation.turning import unwrapped
from hunt_ros.samples import Record, Series

_F = NDArray[np.float64]

#: Where wheelsets hunt, Hz, and where lines are looked for: beyond it on both sides, in steps
#: that are small against the width of the window.
_HUNTING_HZ = (0.5, 10.0)
_GRID: _F = np.geomspace(0.3, 25.0, 120)
#: Standard deviation of the Gaussian window, periods: it tells lines a tenth apart, and follows
#: a hit that decays in a few periods.
_WINDOW = 2.0
#: A line stands so many times (power) above the middle of its surroundings, which reach from
#: `1 / _AROUND` to `_AROUND` of its frequency: noise, once smoothed by the window, does not.
_CLEAR, _AROUND = 10.0, 2.0
#: Share of the power of a forced line that changes, at most: an amplitude within 10 %.
_STEADY = 0.01
#: A line follows the speed where its steady power against the way is so many times that
#: against time: at one speed both are the same.
_FOLLOWS = 1.2
#: A line is a known one if their orders differ by less than this, relative.
_SAME = 0.05
#: Samples in a period of the highest frequency that is looked at.
_SAMPLES = 4.0


@dataclass(frozen=True)
class _Motion:
    """The displacement, even in time; weight 0 in gaps; way in m, NaN where not known."""

    rate_hz: float
    values: _F
    weight: _F
    way: _F

    def amplitude(self, frequency: float, cycles: _F) -> _F:
        """
        Return the amplitude of a line over time, one value a period, NaN in gaps.

        Parameters
        ----------
        frequency : float
            Of the line, about: sets the window, Hz.
        cycles : ndarray, shape (samples,)
            Phase of the line, in turns.
        """
        size = max(round(self.rate_hz / frequency), 1)
        count = self.values.size // size
        turned = self.values * np.exp(-2j * math.pi * cycles)
        sums = turned[: count * size].reshape(count, size).sum(axis=1)
        held = self.weight[: count * size].reshape(count, size).sum(axis=1)
        reach = math.ceil(3.0 * _WINDOW)
        if count <= 2 * reach:
            return np.full(1, math.nan)
        window = np.exp(-0.5 * (np.arange(-reach, reach + 1) / _WINDOW) ** 2)
        held = np.convolve(held, window, 'same')
        enough = held > 0.45 * size * window.sum()
        smooth = np.convolve(sums, window, 'same')
        found: _F = np.where(enough, 2.0 * np.abs(smooth) / np.maximum(held, 1e-300), math.nan)
        return found

    def against_time(self, frequency: float) -> _F:
        """Return the amplitude of the line of a frequency, Hz."""
        time = np.arange(self.values.size, dtype=np.float64) / self.rate_hz
        return self.amplitude(frequency, frequency * time)


@dataclass(frozen=True)
class _Power:
    """Power of a line, m^2: that of its mean amplitude, and what is more than that."""

    steady: float
    changing: float

    @property
    def is_steady(self) -> bool:
        """Return True if the amplitude does not change."""
        return self.changing < _STEADY * (self.steady + self.changing)

    @classmethod
    def of(cls, amplitude: _F) -> _Power:
        """Return that of an amplitude over time."""
        known = amplitude[np.isfinite(amplitude)]
        if known.size < 2:
            return cls(0.0, 0.0)
        return cls(0.5 * float(known.mean()) ** 2, 0.5 * float(known.var()))


class RecordLines:
    """
    The lines of the displacement in a record: which one is the hunting, which are forced.

    Parameters
    ----------
    record : Record
        Its lateral channel is looked at, or yaw where there is none.
    """

    def __init__(self, record: Record) -> None:
        self._motion = _motion(record)
        self._grid = _GRID[:0]
        self._powers: list[_Power] = []
        if self._motion is not None:
            self._grid = _GRID[self._motion.rate_hz > 2.5 * _GRID]
            self._powers = [
                _Power.of(self._motion.against_time(frequency))
                for frequency in self._grid.tolist()
            ]

    @property
    def hunting_hz(self) -> float | None:
        """Frequency of the mode whose power changes most, Hz; None where all is steady."""
        if self._motion is None:
            return None
        return _hunting(self._motion, self._grid, self._powers)

    def forced(self, turns_per_metre: Sequence[float] = ()) -> list[str]:
        """
        Return a sentence for each forced line.

        Parameters
        ----------
        turns_per_metre : sequence of float
            Lines that are known, and need no words.
        """
        if self._motion is None:
            return []
        return _forced(self._motion, self._grid, self._powers, turns_per_metre)


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
    angle = unwrapped(encoder.values)
    running = np.abs(_at(speed, encoder.stamps_ns.astype(np.float64)))
    step = np.diff(encoder.stamps_ns) * 1e-9
    turned, way = np.diff(angle), 0.5 * (running[1:] + running[:-1]) * step
    both = np.isfinite(turned) & np.isfinite(way) & (step > 0.0)
    covered = float(way[both].sum())
    return (
        abs(float(turned[both].sum())) / (2.0 * math.pi * covered) if covered > 0.0 else math.nan
    )


def _hunting(motion: _Motion, grid: _F, powers: list[_Power]) -> float | None:
    """Return the frequency of the mode whose power changes most, Hz; None if all is forced."""
    changing = np.array([power.changing for power in powers])
    for place in _lines(changing):
        frequency = _between(grid, changing, place)
        if not _HUNTING_HZ[0] <= frequency <= _HUNTING_HZ[1]:
            continue
        if _order(motion, frequency) is None:
            return None if powers[place].is_steady else frequency
    return None


def _forced(motion: _Motion, grid: _F, powers: list[_Power], known: Sequence[float]) -> list[str]:
    """Name the lines that are forced."""
    total = np.array([power.steady + power.changing for power in powers])
    said = []
    for place in _lines(total):
        frequency = _between(grid, total, place)
        order = _order(motion, frequency)
        # A steady line where wheelsets hunt may be a limit cycle.
        outside = not _HUNTING_HZ[0] <= frequency <= _HUNTING_HZ[1]
        if order is not None:
            if any(abs(order / one - 1.0) < _SAME for one in known):
                continue
            said.append(f'a line at {order:.3g} v Hz is forced: it follows the speed')
        elif powers[place].is_steady and outside:
            said.append(
                f'a line at {frequency:.3g} Hz is forced: neither its frequency nor its amplitude'
                ' changes'
            )
    return list(dict.fromkeys(said))


def _between(grid: _F, power: _F, place: int) -> float:
    """Return the frequency of a peak by the parabola through its three points, Hz."""
    left, top, right = np.log(np.maximum(power[place - 1 : place + 2], 1e-300)).tolist()
    bend = left - 2.0 * top + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    ratio = float(grid[1] / grid[0])
    return float(f'{grid[place] * ratio ** min(max(shift, -0.5), 0.5):.3g}')


def _lines(power: _F) -> Iterator[int]:
    """Give the places of the lines, peaks that are clear of their surroundings, largest first."""
    inner = power[1:-1]
    peaks = 1 + np.flatnonzero((inner >= power[:-2]) & (inner > power[2:]))
    for place in peaks[np.argsort(-power[peaks])].tolist():
        around = (_GRID[place] / _AROUND < _GRID) & (_GRID[place] * _AROUND > _GRID)
        if power[place] > _CLEAR * float(np.median(power[around[: power.size]])):
            yield place


def _order(motion: _Motion, frequency: float) -> float | None:
    """Return the cycles in a metre of way of a line that follows the speed, or None."""
    if not np.isfinite(motion.way).all():
        return None
    amplitude = motion.against_time(frequency)
    size = max(round(motion.rate_hz / frequency), 1)
    speed = np.diff(motion.way[::size])[: amplitude.size] * motion.rate_hz / size
    amplitude = amplitude[: speed.size]
    known = np.isfinite(amplitude) & (speed > 0.0)
    weight = amplitude[known] ** 2
    if not weight.sum() > 0.0:
        return None
    mean = float(weight @ speed[known] / weight.sum())
    time = np.arange(motion.values.size) / motion.rate_hz
    near = frequency * np.linspace(0.9, 1.1, 41)
    against_way, against_time = (
        [_Power.of(motion.amplitude(frequency, one * base)).steady for one in near]
        for base in (motion.way / mean, time)
    )
    best = int(np.argmax(against_way))
    follows = against_way[best] > _FOLLOWS * max(against_time)
    return float(near[best]) / mean if follows else None


def _motion(record: Record) -> _Motion | None:
    """Return the lateral channel, or yaw where there is none; None where it is no motion."""
    usable = [name for name in ('lateral', 'yaw') if len(record.get(name, ())) > 100]
    if not usable:
        return None
    series = record[usable[0]]
    good = np.isfinite(series.values)
    stamps, values = series.stamps_ns[good], series.values[good]
    if stamps.size < 100 or np.any(np.diff(stamps) <= 0):  # clocks that were set back
        return None
    time = (stamps - stamps[0]) * 1e-9
    trend = np.polynomial.Polynomial.fit(time, values, 1)
    step = float(np.median(np.diff(time)))
    place = np.rint(time / step).astype(np.int64)
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
    return _Motion(rate, even, weight, np.cumsum(speed) / rate)


def _at(series: Series | None, stamps_ns: _F) -> _F:
    """Return a slow channel at stamps; NaN where there is none."""
    if series is None:
        return np.full(stamps_ns.size, math.nan)
    good = np.isfinite(series.values)
    if good.sum() < 2:
        return np.full(stamps_ns.size, math.nan)
    stamps = series.stamps_ns[good].astype(np.float64)
    found: _F = np.interp(stamps_ns, stamps, series.values[good])
    return found
