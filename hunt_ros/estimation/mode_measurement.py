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
from hunt_ros.samples import NANOSECONDS, Record, Series

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
    told = {name: series.in_order().finite() for name, series in record.items()}
    measured = [told[name] for name in ('lateral', 'yaw', 'speed') if name in told]
    rows: list[tuple[float, ...]] = []
    if len(measured) == 3 and min(map(len, measured)) > _LEAST:
        lines = told.get('roller'), orders
        share = _SHARE * _CYCLES / frequency_hz
        least = [*(max(share * one.rate_hz, _LEAST) for one in measured[:2]), 1.0]
        for place in _places(measured, frequency_hz):
            parts = [_part(one, place, 0.5 * _CYCLES / frequency_hz) for one in measured]
            if all(len(part) >= fewest for part, fewest in zip(parts, least, strict=True)):
                rows += _row(parts, place, frequency_hz, lines)
    table = np.array(rows, dtype=np.float64).reshape(-1, 6)
    speed, amplitude, frequency, relative, real, imaginary = table.T
    return RatioPoints(speed, amplitude, frequency, relative, real + 1j * imaginary)


def _places(measured: Sequence[Series], frequency_hz: float) -> list[int]:
    """Return the middles of the windows, ns."""
    half = 0.5 * _CYCLES / frequency_hz * NANOSECONDS
    begin = max(one.stamps_ns[0] for one in measured[:2]) + half
    end = min(one.stamps_ns[-1] for one in measured[:2]) - half
    count = int((end - begin) * frequency_hz / (_STEP * NANOSECONDS))
    if count < 1:
        return []
    places = np.linspace(begin, end, min(count, MOST_WINDOWS))
    return [int(place) for place in places]


def _row(
    parts: Sequence[Series],
    centre_ns: int,
    frequency_hz: float,
    lines: tuple[Series | None, Sequence[float]],
) -> list[tuple[float, ...]]:
    """Return speed, amplitude, frequency, relative std and ratio, if they are clear of noise."""
    lateral, yaw, speed = parts
    half_s = 0.5 * _CYCLES / frequency_hz
    frequency = frequency_hz
    for _ in range(3):  # the frame turns with the motion: what is left of its turning
        found = _phasor(lateral, centre_ns, half_s, frequency, lines)
        if found is None or abs(found[0]) < _CLEAR * found[1]:
            return []
        value, std, turning = found
        used, frequency = frequency, frequency + turning
        if abs(frequency - frequency_hz) > 0.1 * frequency_hz:
            break
    seen = _phasor(yaw, centre_ns, half_s, used, lines)
    if seen is None or abs(seen[0]) < _CLEAR * seen[1]:
        return []
    ratio = seen[0] / value
    relative = math.hypot(std / abs(value), seen[1] / abs(seen[0]))
    mean = abs(float(np.mean(speed.values)))
    return [(mean, abs(value), used, relative, ratio.real, ratio.imag)]


def _part(series: Series, centre_ns: int, half_s: float) -> Series:
    """Return the samples of a window."""
    half = round(half_s * NANOSECONDS)
    first, last = np.searchsorted(series.stamps_ns, [centre_ns - half, centre_ns + half])
    return Series(series.stamps_ns[first:last], series.values[first:last])


def _phasor(
    part: Series,
    centre_ns: int,
    half_s: float,
    frequency_hz: float,
    lines: tuple[Series | None, Sequence[float]],
) -> tuple[complex, float, float] | None:
    """
    Weighted least squares in one window; None where its lines cannot be told apart.

    Returns the phasor at the middle, its standard deviation, and its turning in Hz.
    """
    time = part.seconds(centre_ns)
    x = np.clip(time / half_s, -1.0, 1.0)
    phase = 2.0 * math.pi * frequency_hz * time
    columns = [np.ones_like(x), np.cos(phase), -np.sin(phase)]
    columns += [x * columns[1], x * columns[2]]
    roller, orders = lines
    near = None if roller is None else _part(roller, centre_ns, 2.0 * half_s)
    if near is not None and len(near) > 1:
        angle = np.interp(part.stamps_ns, near.stamps_ns, near.values)
        for order in orders:
            columns += [np.cos(order * angle), np.sin(order * angle)]
    basis = np.stack(columns, axis=1)
    weight = 0.5 + 0.5 * np.cos(math.pi * x)
    information = basis.T @ (weight[:, None] * basis)
    if np.linalg.cond(information) > 1e6:
        return None
    inverse = np.linalg.inv(information)
    terms = inverse @ (basis.T @ (weight * part.values))
    variance = float(np.average((part.values - basis @ terms) ** 2, weights=weight))
    spread = inverse @ (basis.T @ (weight[:, None] ** 2 * basis)) @ inverse
    value = complex(terms[1], terms[2])
    if value == 0.0:
        return None
    std = math.sqrt(0.5 * max(variance * float(spread[1, 1] + spread[2, 2]), 0.0))
    turning = (complex(terms[3], terms[4]) / value).imag / (2.0 * math.pi * half_s)
    return value, std, turning
