"""
The mode shape measured: yaw over lateral phasor, window by window of a recording.

Both sensors are fitted in the same windows, each with bias, the hunting line and its
growth, and the roughness lines at the roller's own angle; the ratio of the two hunting
phasors is the mode's, whatever drives it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.errors import HuntError
from hunt_ros.estimation.response_windows import MOST_WINDOWS
from hunt_ros.samples import Record, Series

_F = NDArray[np.float64]

#: Length of a window and distance of the windows, in periods of hunting.
_CYCLES, _STEP = 4.0, 2.0
#: Samples a window must hold, and the share of those it should.
_LEAST, _SHARE = 24, 0.6
#: The lateral line must stand this many standard deviations clear, or the ratio is biased.
_CLEAR = 8.0


@dataclass(frozen=True, eq=False)
class RatioPoints:
    """
    Yaw over lateral phasor in windows of a recording.

    Parameters
    ----------
    speed, amplitude, frequency_hz, relative_std : ndarray, shape (k,)
        Mean speed, m/s; lateral amplitude, m; Hz; standard deviation of the ratio over it.
    ratio : ndarray of complex, shape (k,)
        rad/m.
    """

    speed: _F
    amplitude: _F
    frequency_hz: _F
    relative_std: _F
    ratio: NDArray[np.complex128]


def measure_ratio(
    record: Record, frequency_hz: float, orders: Sequence[float] = (1.0, 2.0)
) -> RatioPoints:
    """
    Measure the ratio wherever both sensors show the hunting motion clear of their noise.

    Parameters
    ----------
    record : Record
        With `lateral`, `yaw` and `speed`; `roller` where there is one.
    frequency_hz : float
        Hunting frequency to within a twentieth, Hz.
    orders : sequence of float
        Known lines, in turns of the roller; removed where its angle is known.

    Returns
    -------
    RatioPoints
        Empty where the record does not show it.

    Raises
    ------
    HuntError
        For a frequency that is not positive.
    """
    if not (math.isfinite(frequency_hz) and frequency_hz > 0.0):
        raise HuntError(f'mode shape: the frequency must be positive, got {frequency_hz}')
    rows: list[tuple[float, ...]] = []
    if all(name in record and len(record[name]) for name in ('lateral', 'yaw', 'speed')):
        start = min(int(record[name].stamps_ns[0]) for name in ('lateral', 'yaw'))
        lateral, yaw = (_Channel.of(record[name], start) for name in ('lateral', 'yaw'))
        speed = _Channel.of(record['speed'], start)
        roller = _Channel.of(record['roller'], start) if 'roller' in record else None
        if min(lateral.time.size, yaw.time.size, speed.time.size) > _LEAST:
            rows = _windows(lateral, yaw, speed, roller, frequency_hz, orders)
    table = np.array(rows, dtype=np.float64).reshape(-1, 6)
    return RatioPoints(
        table[:, 0], table[:, 1], table[:, 2], table[:, 3], table[:, 4] + 1j * table[:, 5]
    )


@dataclass(frozen=True, eq=False)
class _Channel:
    """Finite samples of a channel in order, time in s."""

    time: _F
    values: _F

    @classmethod
    def of(cls, series: Series, start_ns: int) -> _Channel:
        told = series.in_order().finite()
        return cls(told.seconds(start_ns), told.values)

    def within(self, begin: float, end: float) -> slice:
        first, last = np.searchsorted(self.time, [begin, end])
        return slice(int(first), int(last))


def _windows(
    lateral: _Channel,
    yaw: _Channel,
    speed: _Channel,
    roller: _Channel | None,
    frequency_hz: float,
    orders: Sequence[float],
) -> list[tuple[float, ...]]:
    """Return speed, amplitude, frequency, relative std and ratio of each clear window."""
    length = _CYCLES / frequency_hz
    begin = max(lateral.time[0], yaw.time[0])
    end = min(lateral.time[-1], yaw.time[-1]) - length
    count = int((end - begin) * frequency_hz / _STEP)
    if count < 1:
        return []
    full = [_SHARE * length / float(np.median(np.diff(c.time))) for c in (lateral, yaw)]
    rows: list[tuple[float, ...]] = []
    for place in np.linspace(begin, end, min(count, MOST_WINDOWS)):
        here = speed.within(place, place + length)
        parts = [c.within(place, place + length) for c in (lateral, yaw)]
        sizes = [part.stop - part.start for part in parts]
        if here.stop == here.start or any(
            n < max(least, _LEAST) for n, least in zip(sizes, full, strict=True)
        ):
            continue
        centre, frequency = place + 0.5 * length, frequency_hz
        found = _phasor(lateral, parts[0], centre, frequency, roller, orders)
        for _ in range(2):  # the frame turns with the motion: what is left of its turning
            if found is None or abs(found.turning) > 0.1 * frequency_hz:
                break
            frequency = frequency_hz + found.turning
            found = _phasor(lateral, parts[0], centre, frequency, roller, orders, frequency_hz)
        if found is None or abs(found.value) < _CLEAR * found.std:
            continue
        seen = _phasor(yaw, parts[1], centre, frequency, roller, orders)
        if seen is None or abs(seen.value) < _CLEAR * seen.std:
            continue
        ratio = seen.value / found.value
        relative = math.hypot(found.std / abs(found.value), seen.std / abs(seen.value))
        mean = abs(float(np.mean(speed.values[here])))
        rows.append((mean, abs(found.value), frequency, relative, ratio.real, ratio.imag))
    return rows


@dataclass(frozen=True)
class _Phasor:
    """Phasor at the middle of a window, its standard deviation, and its turning in Hz."""

    value: complex
    std: float
    turning: float


def _phasor(
    channel: _Channel,
    part: slice,
    centre: float,
    frequency_hz: float,
    roller: _Channel | None,
    orders: Sequence[float],
    nominal_hz: float | None = None,
) -> _Phasor | None:
    """Weighted least squares in one window; None where its lines cannot be told apart."""
    time = channel.time[part] - centre
    half = 0.5 * _CYCLES / (nominal_hz or frequency_hz)
    x = time / half
    phase = 2.0 * math.pi * frequency_hz * time
    columns = [np.ones_like(x), np.cos(phase), -np.sin(phase)]
    columns += [x * columns[1], x * columns[2]]
    if roller is not None and roller.time.size > 1:
        angle = np.interp(channel.time[part], roller.time, roller.values)
        for order in orders:
            columns += [np.cos(order * angle), np.sin(order * angle)]
    basis = np.stack(columns, axis=1)
    weight = np.clip(0.5 + 0.5 * np.cos(math.pi * np.clip(x, -1.0, 1.0)), 0.0, None)
    information = basis.T @ (weight[:, None] * basis)
    if np.linalg.cond(information) > 1e6:
        return None
    inverse = np.linalg.inv(information)
    terms = inverse @ (basis.T @ (weight * channel.values[part]))
    left = channel.values[part] - basis @ terms
    variance = float(np.sum(weight * left**2) / np.sum(weight))
    spread = inverse @ (basis.T @ (weight[:, None] ** 2 * basis)) @ inverse
    value = complex(terms[1], terms[2])
    if value == 0.0:
        return None
    std = math.sqrt(0.5 * max(variance * float(spread[1, 1] + spread[2, 2]), 0.0))
    turning = (complex(terms[3], terms[4]) / value).imag / (2.0 * math.pi * half)
    base = nominal_hz or frequency_hz
    return _Phasor(value, std, turning + frequency_hz - base)
