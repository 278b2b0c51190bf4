"""
The hunting mode as both sensors see it together: yaw over lateral, in windows at one speed.

A window is twelve periods of hunting long. Each channel is averaged into cells, sixteen a
period, and the known lines are taken out by the angle of the roller; the rest, under Hann's
window, becomes phasors in the bins about the hunting. The samples of a cell stand where their
mean stamp is, so that sensors of any rates see one motion alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hunt_ros.estimation.spectrum import without_lines
from hunt_ros.samples import NANOSECONDS, Record, Series

_F = NDArray[np.float64]
_C = NDArray[np.complex128]

#: Length of a window in periods of hunting, and cells in a period.
_PERIODS, _CELLS = 12, 16
_WINDOW = _PERIODS * _CELLS
#: The ratio is that of the bins so near to the hunting; known to this at least, relative, or it is
#: not clear of the noise, which biases it.
_NEAR, _CLEAR = 2, 0.17
_BINS = np.arange(_PERIODS - _NEAR, _PERIODS + _NEAR + 1)
#: A known line takes this many bins with it on either side.
_LINE = 1.2
#: The speed of a window changes by less than this part, as in a slow sweep: the modes change by
#: as little.
_SAME_SPEED = 0.02
#: Parts of a window whose mean speeds are compared: noise of a tachometer is no change.
_PARTS = 4
#: Cells of a window that may be empty, and that may repeat the one before: a sensor that stands
#: still is none.
_LOST, _REPEATED = 0.02, 0.5
#: One window: mean speed, m/s; lateral amplitude, m; yaw over lateral phasor, rad/m; its relative
#: standard deviation; frequency, Hz.
RATIO = np.dtype(
    [
        ('speed', np.float64),
        ('amplitude', np.float64),
        ('ratio', np.complex128),
        ('relative_std', np.float64),
        ('frequency_hz', np.float64),
    ]
)


def measured_ratio(
    record: Record, frequency_hz: float, orders: Sequence[float] = (1.0, 2.0)
) -> NDArray[np.void]:
    """
    Yaw over lateral phasor of the hunting, whatever drives it, in windows that overlap by half.

    Parameters
    ----------
    record : Record
        With `lateral`, `yaw` and `speed`; `roller` where there is one.
    frequency_hz : float
        Of the hunting.
    orders : sequence of float
        Known lines, in turns of the roller; removed where its angle is known.

    Returns
    -------
    ndarray of RATIO, shape (n,)
        Where both sensors show it clear of their noise; empty where one is missing or stands
        still, or takes fewer than 16 samples a period.
    """
    told = {name: series.in_order().finite() for name, series in record.items()}
    windows = []
    if all(len(told.get(name, ())) > 1 for name in ('lateral', 'yaw', 'speed')):
        step_s = 1.0 / (_CELLS * frequency_hz)
        found = (_window(told, start, step_s, orders) for start in _starts(told, _WINDOW * step_s))
        windows = [window for window in found if window is not None]
    measured = np.zeros(len(windows), dtype=RATIO)
    if not windows:
        return measured
    speed, phasors = zip(*windows, strict=True)
    lateral, yaw = np.moveaxis(np.array(phasors), 1, 0)
    power = np.abs(lateral) ** 2
    total, cross = power.sum(axis=1), np.sum(yaw * lateral.conj(), axis=1)
    with np.errstate(all='ignore'):
        # What of yaw is not the lateral motion times one number is noise, in all bins but one.
        noise = np.maximum(
            total * np.sum(np.abs(yaw) ** 2, axis=1) / np.abs(cross) ** 2 - 1.0, 0.0
        )
        # Neighbouring bins of Hann's window are half a value each.
        measured['relative_std'] = np.sqrt(noise / (2 * _NEAR))
        measured['ratio'] = cross / total
        measured['frequency_hz'] = power @ _BINS / total * frequency_hz / _PERIODS
    measured['speed'] = speed
    measured['amplitude'] = 2.0 * np.sqrt(total * frequency_hz / _PERIODS)
    return measured[measured['relative_std'] < _CLEAR]


_TAPER = np.hanning(_WINDOW + 1)[:_WINDOW]
_TAPER /= math.sqrt(float(_TAPER @ _TAPER))


def _starts(told: Mapping[str, Series], length_s: float) -> list[int]:
    """Return where windows begin, ns, in which both sensors have a sample a cell."""
    motion = [told[name].stamps_ns for name in ('lateral', 'yaw')]
    first, last = max(one[0] for one in motion), min(one[-1] for one in motion)
    length = length_s * NANOSECONDS
    count = max(int(2.0 * (last - first) / length) - 1, 0)
    starts = first + (0.5 * length * np.arange(count)).astype(np.int64)
    filled = np.ones(count, dtype=np.bool_)
    for stamps in motion:
        held = np.searchsorted(stamps, starts + int(length)) - np.searchsorted(stamps, starts)
        filled &= held >= (1.0 - _LOST) * _WINDOW
    return [int(start) for start in starts[filled]]


def _window(
    told: Mapping[str, Series], start_ns: int, step_s: float, orders: Sequence[float]
) -> tuple[float, list[_C]] | None:
    """Return speed and phasors of both; None where the speed changes or a line is near."""
    even = step_s * np.arange(0.5, _WINDOW)
    speed = _between(told['speed'], start_ns, even)
    mean, parts = abs(float(speed.mean())), speed.reshape(_PARTS, -1).mean(axis=1)
    if not float(np.ptp(parts)) < _SAME_SPEED * mean:
        return None
    phasors = []
    for name in ('lateral', 'yaw'):
        cells = _cells(told[name], start_ns, even)
        if cells is None:
            return None
        seconds, moved = cells
        angle = np.full(_WINDOW, math.nan)
        if len(told.get('roller', ())) > 1:
            angle = _between(told['roller'], start_ns, seconds)
        waves = []
        if np.isfinite(angle).all():
            turns = abs(float(angle[-1] - angle[0])) / (2.0 * math.pi * (_WINDOW - 1))
            for order in orders:
                waves.append(np.exp(1j * order * angle))
                if np.any(np.abs(_BINS - order * turns * _WINDOW) <= _LINE):
                    return None
        motion = without_lines(moved, seconds, waves)
        wave = np.exp(-2j * math.pi / (_WINDOW * step_s) * np.outer(_BINS, seconds))
        phasors.append(math.sqrt(step_s) * (wave @ (motion * _TAPER)))
    return mean, phasors


def _cells(series: Series, start_ns: int, even: _F) -> tuple[_F, _F] | None:
    """Return mean stamp, s, and mean of the samples of each cell; None: no motion is seen."""
    step_s = 2.0 * even[0]
    length_ns = int(_WINDOW * step_s * NANOSECONDS)
    first, last = np.searchsorted(series.stamps_ns, [start_ns, start_ns + length_ns])
    seconds = (series.stamps_ns[first:last] - start_ns) / NANOSECONDS
    cell = (seconds / step_s).astype(np.int64)
    count = np.bincount(cell, minlength=_WINDOW)
    held = count > 0
    if np.count_nonzero(~held) > _LOST * _WINDOW:
        return None
    # The few empty cells are bridged.
    when, mean = even.copy(), np.empty(_WINDOW)
    when[held], mean[held] = (
        np.bincount(cell, weights=one, minlength=_WINDOW)[held] / count[held]
        for one in (seconds, series.values[first:last])
    )
    mean[~held] = np.interp(when[~held], when[held], mean[held])
    moves = np.count_nonzero(np.diff(mean)) > (1.0 - _REPEATED) * _WINDOW
    return (when, mean) if moves else None


def _between(series: Series, start_ns: int, wanted: _F) -> _F:
    """Interpolate; NaN beyond the ends and in gaps: what was not measured does not stand still."""
    length_s = wanted[-1] + wanted[0]
    around = start_ns + (np.array([-1.0, 2.0]) * length_s * NANOSECONDS).astype(np.int64)
    first, last = np.searchsorted(series.stamps_ns, around)
    seconds = (series.stamps_ns[first:last] - start_ns) / NANOSECONDS
    if seconds.size < 2 or np.diff(seconds).max() > length_s:
        return np.full(_WINDOW, math.nan)
    found: _F = np.interp(wanted, seconds, series.values[first:last], math.nan, math.nan)
    return found
