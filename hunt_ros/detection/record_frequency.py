"""
The hunting frequency from a whole record, where nobody has said it and it is not the usual one.

Only offline: a live detector cannot know what is to come. It names such motion instead
(`motion_outside_range`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.frequencies import with_frequencies
from hunt_ros.detection.tracking import roller_diameter, shafts
from hunt_ros.estimation.turning import continuous
from hunt_ros.samples import Record, Series

_F = NDArray[np.float64]

#: Length of a piece, s, and how many of a long record are looked at.
_PIECE_S, _PIECES = 20.48, 240
#: Frequencies looked at, Hz: the slowest has four periods in a piece.
_GRID: _F = np.arange(0.2, 20.0, 0.01)
#: The line stands so many times (power) above all inside the usual range, which is stretched
#: by `_EDGE`, and above its surroundings, from `1 / _AROUND` to `_AROUND` of its frequency.
_STRONGER, _CLEAR, _EDGE, _AROUND = 4.0, 25.0, 1.1, 1.6
#: Half width of the roller's lines where its angle is not known, share of the frequency.
_ROLLER_BAND = 0.1
#: Sections of a piece in which the turning of the roller is counted.
_SECTIONS = 10
#: A line whose frequency follows the speed with more than this power is of something that
#: turns; looked at where the speed varies by more than this, as a share of it.
_TURNING, _VARIES = 0.75, 0.1
#: Within a piece: the speed changes by more than this, and the line is sharper by more than
#: this factor (power) against the way than against time.
_CHANGES, _SHARPER = 0.03, 1.3


@dataclass(frozen=True)
class _Piece:
    """An even stretch of the motion, free of trend and roller lines; speed and turning or NaN."""

    rate_hz: float
    values: _F
    speed: _F
    turning_hz: _F
    orders: tuple[float, ...]

    @property
    def power(self) -> _F:
        """Power of the piece at the frequencies of the grid."""
        window = np.hanning(self.values.size)
        size = 1 << (math.ceil(math.log2(self.values.size)) + 2)
        spectrum = np.abs(np.fft.rfft(self.values * window, size)) ** 2 / window.sum() ** 2
        at: _F = np.interp(_GRID, np.fft.rfftfreq(size, 1.0 / self.rate_hz), spectrum, right=0.0)
        return at

    def roller_lines(self) -> NDArray[np.bool_]:
        """Tell the frequencies of the grid at which the roller may turn, or half of which."""
        near = np.zeros(_GRID.size, dtype=np.bool_)
        turn = self.turning_hz
        if np.isfinite(turn).all():
            for order in self.orders:
                low = (1.0 - _ROLLER_BAND) * order * turn.min()
                near |= _between(low, (1.0 + _ROLLER_BAND) * order * turn.max())
        return near

    def sharpness(self, frequency: float) -> tuple[float, float]:
        """Return the power of the strongest line near a frequency against way and time."""
        mean = float(self.speed.mean())
        weighted = self.values * np.hanning(self.values.size)
        time = np.arange(self.values.size) / self.rate_hz
        way = np.cumsum(self.speed) / self.rate_hz / mean
        shifts = np.arange(-0.15, 0.15, 0.25 / (frequency * _PIECE_S))
        best = []
        for base in (way, time):
            turns = np.exp(-2j * math.pi * np.outer(frequency * (1.0 + shifts), base))
            best.append(float((np.abs(turns @ weighted) ** 2).max()))
        return best[0], best[1]


def frequency_for(record: Record, config: DetectorConfig) -> tuple[DetectorConfig, list[str]]:
    """
    Take the nominal frequency from a record whose hunting is not in the usual range.

    Parameters
    ----------
    record : Record
        All of it decides.
    config : DetectorConfig
        Left as it is where it names a hunting frequency.

    Returns
    -------
    config : DetectorConfig
        With the frequency that was found outside the range, or unchanged.
    remarks : list of str
        One line where it was changed.
    """
    if config.hunting_frequency_hz or config.hunting_frequency_min_hz:
        return config, []
    if config.hunting_frequency_max_hz:
        return config, []
    usual = with_frequencies(config)
    low, high = usual.hunting_frequency_min_hz, usual.hunting_frequency_max_hz
    found = _line_outside(record, config, low, high)
    if found is None:
        return config, []
    remark = (
        f'the strongest motion of the recording is at {found:.3g} Hz, outside the hunting'
        f' frequencies {low:.3g} to {high:.3g} Hz: it is taken for the hunting'
        ' (set hunting_frequency_hz if it is not)'
    )
    return replace(config, hunting_frequency_hz=found), [remark]


def _between(low: float, high: float) -> NDArray[np.bool_]:
    """Tell the frequencies of the grid within a range, Hz."""
    return (low < _GRID) & (high > _GRID)


def _line_outside(record: Record, config: DetectorConfig, low: float, high: float) -> float | None:
    """Return the frequency of the strongest line if that is outside a range, Hz."""
    inside = _between(low / _EDGE, high * _EDGE)
    pieces = list(_pieces(record, config))
    if not pieces:
        return None
    powers = []
    for piece in pieces:
        power = piece.power
        power[~inside & piece.roller_lines()] = 0.0
        power[_between(0.4 * piece.rate_hz, math.inf)] = 0.0
        powers.append(power)
    total = np.sum(powers, axis=0)
    place = _peak(total, ~inside)
    if place is None or total[place] < _STRONGER * total[inside].max():
        return None
    frequency = float(_GRID[place])
    if _turns(pieces, powers, ~inside, frequency):
        return None
    return round(frequency, 3)


def _peak(power: _F, among: NDArray[np.bool_]) -> int | None:
    """Return the place of the strongest line that is one: a peak, clear of its surroundings."""
    peaks = np.zeros(power.size, dtype=np.bool_)
    peaks[1:-1] = (power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:]) & among[1:-1]
    if not peaks.any():
        return None
    place = int(np.argmax(np.where(peaks, power, 0.0)))
    around = _between(_GRID[place] / _AROUND, _GRID[place] * _AROUND) & (power > 0.0)
    return place if power[place] > _CLEAR * float(np.median(power[around])) else None


def _turns(
    pieces: list[_Piece], powers: list[_F], among: NDArray[np.bool_], frequency: float
) -> bool:
    """Tell whether the line follows the speed, as that of something that turns does."""
    against_way, against_time = 0.0, 0.0
    speeds, lines = [], []
    for piece, power in zip(pieces, powers, strict=True):
        if not (np.isfinite(piece.speed).all() and piece.speed.min() > 0.0):
            continue
        mean = float(piece.speed.mean())
        change = float(np.ptp(piece.speed)) / mean
        place = _peak(power, among)
        if change > _CHANGES:
            way, time = piece.sharpness(frequency)
            against_way, against_time = against_way + way, against_time + time
        elif place is not None:
            speeds.append(math.log(mean))
            lines.append(math.log(float(_GRID[place])))
    if against_way > _SHARPER * against_time:
        return True
    if len(speeds) < 2 or np.ptp(speeds) < _VARIES:
        return False
    return bool(np.polyfit(speeds, lines, 1)[0] > _TURNING)


def _pieces(record: Record, config: DetectorConfig) -> Iterator[_Piece]:
    """Give half-overlapping pieces of the lateral channel, or of yaw where there is none."""
    usable = [name for name in ('lateral', 'yaw') if len(record.get(name, ())) > 100]
    if not usable:
        return
    series = record[usable[0]]
    good = np.isfinite(series.values)
    good[1:] &= np.diff(series.stamps_ns) > 0
    stamps, values = series.stamps_ns[good], series.values[good]
    if stamps.size < 100 or np.any(np.diff(stamps) <= 0):  # clocks that were set back
        return
    rate = 1e9 / float(np.median(np.diff(stamps)))
    time = (stamps - stamps[0]) * 1e-9
    length = min(_PIECE_S, 0.9 * float(time[-1]))
    starts = np.arange(0.0, float(time[-1]) - length, 0.5 * length)
    if starts.size > _PIECES:
        starts = starts[np.linspace(0, starts.size - 1, _PIECES).astype(np.intp)]
    even = np.arange(int(length * rate)) / rate
    orders = tuple(order for shaft in shafts(config) for order in shaft.orders)
    encoder = record.get('roller')
    if encoder is not None:
        encoder = continuous(encoder)
    for start in starts.tolist():
        first, last = np.searchsorted(time, [start, start + length])
        if last - first < max(0.6 * even.size, 100):
            continue
        at = start + even
        piece = np.interp(at, time[first:last], values[first:last])
        wanted = stamps[0] + at * 1e9
        roller, speed = _at(encoder, wanted), _at(record.get('speed'), wanted)
        speed = np.abs(speed)
        turning = speed / (math.pi * roller_diameter(config))
        columns = [np.ones_like(even), even]
        if np.isfinite(roller).all() and np.ptp(roller) > 0.0:
            for order in orders:
                columns += [np.cos(order * roller), np.sin(order * roller)]
            section = max(roller.size // _SECTIONS, 1)
            turns = np.abs(roller[::section] - roller[0]) / (2.0 * math.pi)
            turning = np.abs(np.diff(turns)) * rate / section
        basis = np.stack(columns, axis=1)
        piece = piece - basis @ np.linalg.lstsq(basis, piece, rcond=None)[0]
        yield _Piece(rate, piece, speed, turning, orders)


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
