"""
Windows of quiet running: what noise makes of both sensors together, as cross-spectra.

A window is twelve periods of hunting long. Each channel is averaged into cells, sixteen a period,
on a grid that both sensors share, and the known lines are taken out by the angle of the roller;
the rest, under Hann's window, becomes one cross-spectral matrix a bin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
#: Sensors of different rates see one motion alike from this many samples a cell on: with fewer
#: the cells of the slower one stand unevenly about their middle.
_EVEN = 4.0


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
        Empty where a sensor is missing or stands still, takes fewer than 16 samples a period, or
        is so slow beside the other one, of another rate, that they cannot be compared.
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


_PLACE = np.linspace(-1.0, 1.0, WINDOW)
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
    speed = _between(told['speed'], start_ns, step_s)
    mean, parts = abs(float(speed.mean())), speed.reshape(_PARTS, -1).mean(axis=1)
    if not float(np.ptp(parts)) < SAME_SPEED * mean:
        return None
    cells = [_means(told[name], start_ns, step_s) for name in ('lateral', 'yaw')]
    rates = [float(np.median(samples[samples > 0])) for _, samples in cells]
    if min(rates) < _EVEN and max(rates) > 1.2 * min(rates) + 1.0:
        return None
    moved = _whole(np.stack([values for values, _ in cells], axis=1))
    if moved is None:
        return None
    angle = np.full(WINDOW, math.nan)
    if len(told.get('roller', ())) > 1:
        angle = _between(told['roller'], start_ns, step_s)
    motion, free = _without_lines(moved, angle, orders)
    turned = np.fft.rfft(motion * _TAPER[:, None], axis=0)[BINS]
    spectra = step_s * turned[:, :, None] * turned[:, None, :].conj()
    return mean, math.sqrt(2.0) * float(np.std(motion[:, 0])), spectra, free


def _whole(motion: _F) -> _F | None:
    """Return a window with its few empty cells bridged; None: too many, or a sensor stands."""
    lost = ~np.isfinite(motion).all(axis=1)
    if np.count_nonzero(lost) > _LOST * WINDOW:
        return None
    filled = motion.copy()
    for k in range(2):
        filled[lost, k] = np.interp(_PLACE[lost], _PLACE[~lost], motion[~lost, k])
    still = np.count_nonzero(np.diff(filled, axis=0) == 0.0, axis=0)
    return filled if np.all(still < _REPEATED * WINDOW) else None


def _without_lines(motion: _F, angle: _F, orders: Sequence[float]) -> tuple[_F, NDArray[np.bool_]]:
    """Return a window without trend and known lines, and which bins no line is near."""
    columns, free = [np.ones(WINDOW), _PLACE], np.ones(BINS.size, dtype=np.bool_)
    if np.isfinite(angle).all():
        turning = abs(float(angle[-1] - angle[0])) / (2.0 * math.pi * (WINDOW - 1))
        for order in orders:
            columns += [np.cos(order * angle), np.sin(order * angle)]
            free &= np.abs(BINS - order * turning * WINDOW) > _LINE
    basis = np.stack(columns, axis=1)
    return motion - basis @ np.linalg.lstsq(basis, motion, rcond=None)[0], free


def _means(series: Series, start_ns: int, step_s: float) -> tuple[_F, NDArray[np.int64]]:
    """Return the mean of the samples in each cell, NaN where there is none, and their number."""
    step_ns = step_s * NANOSECONDS
    first, last = np.searchsorted(series.stamps_ns, [start_ns, start_ns + int(WINDOW * step_ns)])
    cell = ((series.stamps_ns[first:last] - start_ns) / step_ns).astype(np.int64)
    samples = np.bincount(cell, minlength=WINDOW)
    total = np.bincount(cell, weights=series.values[first:last], minlength=WINDOW)
    mean: _F = np.full(WINDOW, math.nan)
    np.divide(total, samples, out=mean, where=samples > 0)
    return mean, samples


def _between(series: Series, start_ns: int, step_s: float) -> _F:
    """Interpolate; NaN beyond the ends and in gaps: what was not measured does not stand still."""
    length_ns = WINDOW * step_s * NANOSECONDS
    around = [start_ns - length_ns, start_ns + 2.0 * length_ns]
    first, last = np.searchsorted(series.stamps_ns, around)
    seconds = (series.stamps_ns[first:last] - start_ns) / NANOSECONDS
    if seconds.size < 2 or np.diff(seconds).max() > WINDOW * step_s:
        return np.full(WINDOW, math.nan)
    wanted = step_s * (np.arange(WINDOW) + 0.5)
    found: _F = np.interp(wanted, seconds, series.values[first:last], math.nan, math.nan)
    return found
