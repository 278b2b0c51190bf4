"""
Windows of a recording at one speed: what both sensors show together, as cross-spectra.

A window is twelve periods of hunting long. Each channel is averaged into cells, sixteen a
period, and the known lines are taken out by the angle of the roller; the rest, under Hann's
window, becomes one cross-spectral matrix a bin. The samples of a cell stand where their mean stamp
is, so that sensors of any rates see one motion alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.estimation.spectrum import without_lines
from hunt_ros.samples import NANOSECONDS, Record, Series

_F = NDArray[np.float64]
_C = NDArray[np.complex128]

#: Length of a window in periods of hunting, and cells in a period.
PERIODS, _CELLS = 12, 16
WINDOW = PERIODS * _CELLS
#: Bins of a window that are kept: from 0.3 to 4 times the frequency of hunting.
BINS = np.arange(4, 4 * PERIODS + 1)
#: A known line takes this many bins with it on either side.
_LINE = 1.2
#: Windows looked at in one record: a long one is thinned evenly.
MOST_WINDOWS = 600
#: The speed of a window changes by less than this part, as in a slow sweep: the modes change by
#: as little.
SAME_SPEED = 0.02
#: Parts of a window whose mean speeds are compared: noise of a tachometer is no change.
_PARTS = 4
#: Cells of a window that may be empty, and that may repeat the one before: a sensor that stands
#: still is none.
_LOST, _REPEATED = 0.02, 0.5
#: The ratio is that of the bins so near to the hunting; known to this at least, relative, or it is
#: not clear of the noise, which biases it.
_NEAR, _CLEAR = 2, 0.17


@dataclass(frozen=True, eq=False)
class ResponseWindows:
    """
    Windows of a recording in which the speed stands still.

    Parameters
    ----------
    speed, amplitude : ndarray, shape (k,)
        Mean speed, m/s; amplitude of the lateral motion without the known lines, m.
    spectra : ndarray of complex, shape (k, bins, 2, 2)
        Cross-spectral matrices of lateral and yaw at `BINS`, two-sided: m^2 s, m rad s, rad^2 s.
    usable : ndarray of bool, shape (k, bins)
        No known line lies near the bin.
    """

    speed: _F
    amplitude: _F
    spectra: _C
    usable: NDArray[np.bool_]

    def only(self, kept: NDArray[np.bool_]) -> ResponseWindows:
        """Return some of the windows."""
        return ResponseWindows(
            self.speed[kept], self.amplitude[kept], self.spectra[kept], self.usable[kept]
        )


def joined(windows: Sequence[ResponseWindows]) -> ResponseWindows:
    """Return the windows of several recordings as those of one."""
    return ResponseWindows(
        np.concatenate([one.speed for one in windows]),
        np.concatenate([one.amplitude for one in windows]),
        np.concatenate([one.spectra for one in windows]),
        np.concatenate([one.usable for one in windows]),
    )


def measure_response(
    record: Record, frequency_hz: float, orders: Sequence[float] = (1.0, 2.0)
) -> ResponseWindows:
    """
    Take the cross-spectra of both sensors in windows that overlap by half.

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
    ResponseWindows
        Empty where a sensor is missing or stands still, or takes fewer than 16 samples a period.
    """
    told = {name: series.in_order().finite() for name, series in record.items()}
    windows = []
    if all(len(told.get(name, ())) > 1 for name in ('lateral', 'yaw', 'speed')):
        step_s = 1.0 / (_CELLS * frequency_hz)
        found = (_window(told, start, step_s, orders) for start in _starts(told, WINDOW * step_s))
        windows = [window for window in found if window is not None]
    if len(windows) > MOST_WINDOWS:
        windows = [windows[k] for k in np.linspace(0, len(windows) - 1, MOST_WINDOWS).astype(int)]
    speed, amplitude, spectra, free = zip(*windows, strict=True) if windows else ((),) * 4
    return ResponseWindows(
        np.array(speed, dtype=np.float64),
        np.array(amplitude, dtype=np.float64),
        np.array(spectra, dtype=np.complex128).reshape(-1, BINS.size, 2, 2),
        np.array(free, dtype=np.bool_).reshape(-1, BINS.size),
    )


def measured_ratio(windows: ResponseWindows, frequency_hz: float) -> tuple[_F, _F, _C, _F, _F]:
    """
    Yaw over lateral phasor of the hunting, whatever drives it.

    Parameters
    ----------
    windows : ResponseWindows
        Of motion of any size.
    frequency_hz : float
        With which they were taken.

    Returns
    -------
    tuple of ndarray, shape (n,)
        Where both sensors show it clear of their noise: mean speed, m/s; lateral amplitude, m;
        ratio, rad/m; its relative standard deviation; frequency, Hz.
    """
    near = np.abs(BINS - PERIODS) <= _NEAR
    spectra = windows.spectra[:, near]
    power = spectra[:, :, 0, 0].real
    lateral, yaw, cross = power.sum(1), spectra[:, :, 1, 1].sum(1).real, spectra[:, :, 1, 0].sum(1)
    with np.errstate(all='ignore'):
        # What of yaw is not the lateral motion times one number is noise, in all bins but one.
        noise = np.maximum(lateral * yaw / np.abs(cross) ** 2 - 1.0, 0.0)
        # Neighbouring bins of Hann's window are half a value each.
        std = np.sqrt(noise / (2 * _NEAR))
        turning = power @ BINS[near] / lateral * frequency_hz / PERIODS
        clear = windows.usable[:, near].all(1) & (std < _CLEAR)
        amplitude = 2.0 * np.sqrt(lateral * frequency_hz / PERIODS)
        found = windows.speed, amplitude, cross / lateral, std, turning
    speed, amplitude, ratio, std, turning = (one[clear] for one in found)
    return speed, amplitude, ratio, std, turning


_TAPER = np.hanning(WINDOW + 1)[:WINDOW]
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
        filled &= held >= (1.0 - _LOST) * WINDOW
    return [int(start) for start in starts[filled]]


def _window(
    told: Mapping[str, Series], start_ns: int, step_s: float, orders: Sequence[float]
) -> tuple[float, float, _C, NDArray[np.bool_]] | None:
    """Return speed, amplitude, spectra and usable bins; None where the speed changes."""
    even = step_s * np.arange(0.5, WINDOW)
    speed = _between(told['speed'], start_ns, even)
    mean, parts = abs(float(speed.mean())), speed.reshape(_PARTS, -1).mean(axis=1)
    if not float(np.ptp(parts)) < SAME_SPEED * mean:
        return None
    turned = np.empty((2, BINS.size), dtype=np.complex128)
    free = np.ones(BINS.size, dtype=np.bool_)
    for k, name in ((1, 'yaw'), (0, 'lateral')):
        cells = _cells(told[name], start_ns, even)
        if cells is None:
            return None
        seconds, moved = cells
        angle = np.full(WINDOW, math.nan)
        if len(told.get('roller', ())) > 1:
            angle = _between(told['roller'], start_ns, seconds)
        waves = []
        if np.isfinite(angle).all():
            turns = abs(float(angle[-1] - angle[0])) / (2.0 * math.pi * (WINDOW - 1))
            for order in orders:
                waves.append(np.exp(1j * order * angle))
                free &= np.abs(BINS - order * turns * WINDOW) > _LINE
        motion = without_lines(moved, seconds, waves)
        wave = np.exp(-2j * math.pi / (WINDOW * step_s) * np.outer(BINS, seconds))
        turned[k] = wave @ (motion * _TAPER)
    spectra = step_s * turned.T[:, :, None] * turned.T[:, None, :].conj()
    return mean, math.sqrt(2.0) * float(np.std(motion)), spectra, free


def _cells(series: Series, start_ns: int, even: _F) -> tuple[_F, _F] | None:
    """Return mean stamp, s, and mean of the samples of each cell; None: no motion is seen."""
    step_s = 2.0 * even[0]
    length_ns = int(WINDOW * step_s * NANOSECONDS)
    first, last = np.searchsorted(series.stamps_ns, [start_ns, start_ns + length_ns])
    seconds = (series.stamps_ns[first:last] - start_ns) / NANOSECONDS
    cell = (seconds / step_s).astype(np.int64)
    count = np.bincount(cell, minlength=WINDOW)
    held = count > 0
    if np.count_nonzero(~held) > _LOST * WINDOW:
        return None
    # The few empty cells are bridged.
    when, mean = even.copy(), np.empty(WINDOW)
    when[held], mean[held] = (
        np.bincount(cell, weights=one, minlength=WINDOW)[held] / count[held]
        for one in (seconds, series.values[first:last])
    )
    mean[~held] = np.interp(when[~held], when[held], mean[held])
    moves = np.count_nonzero(np.diff(mean)) > (1.0 - _REPEATED) * WINDOW
    return (when, mean) if moves else None


def _between(series: Series, start_ns: int, wanted: _F) -> _F:
    """Interpolate; NaN beyond the ends and in gaps: what was not measured does not stand still."""
    length_s = wanted[-1] + wanted[0]
    around = start_ns + (np.array([-1.0, 2.0]) * length_s * NANOSECONDS).astype(np.int64)
    first, last = np.searchsorted(series.stamps_ns, around)
    seconds = (series.stamps_ns[first:last] - start_ns) / NANOSECONDS
    if seconds.size < 2 or np.diff(seconds).max() > length_s:
        return np.full(WINDOW, math.nan)
    found: _F = np.interp(wanted, seconds, series.values[first:last], math.nan, math.nan)
    return found
