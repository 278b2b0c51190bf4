"""
Windows of quiet running: what noise makes of both sensors together, as cross-spectra.

A window is twelve periods of hunting long. Each channel is averaged into cells, sixteen a period,
on a grid that both sensors share, and the known lines are taken out by the angle of the roller;
the rest, under Hann's window, becomes one cross-spectral matrix a bin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
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
_MOST = 600
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
    step = 1.0 / (_CELLS * frequency_hz)
    grid = _Grid.of(record, step)
    starts = np.arange(0, grid.speed.size - WINDOW + 1, WINDOW // 2)
    if starts.size > _MOST:
        starts = starts[np.linspace(0, starts.size - 1, _MOST).astype(np.int64)]
    speeds: list[float] = []
    amplitudes: list[float] = []
    spectra: list[_C] = []
    usable: list[NDArray[np.bool_]] = []
    for start in starts:
        part = slice(int(start), int(start) + WINDOW)
        motion, v = _whole(grid.motion[part]), grid.speed[part]
        mean = abs(float(v.mean()))
        change = float(np.ptp(v.reshape(_PARTS, -1).mean(axis=1)))
        if motion is None or not change < SAME_SPEED * mean:
            continue
        motion, free = _without_lines(motion, grid.angle[part], orders)
        turned = np.fft.rfft(motion * _TAPER[:, None], axis=0)[BINS]
        speeds.append(mean)
        amplitudes.append(math.sqrt(2.0) * float(np.std(motion[:, 0])))
        spectra.append(step * turned[:, :, None] * turned[:, None, :].conj())
        usable.append(free)
    return ResponseWindows(
        np.array(speeds),
        np.array(amplitudes),
        np.array(spectra, dtype=np.complex128).reshape(-1, BINS.size, 2, 2),
        np.array(usable, dtype=np.bool_).reshape(-1, BINS.size),
    )


_PLACE = np.linspace(-1.0, 1.0, WINDOW)
_TAPER = np.hanning(WINDOW + 1)[:WINDOW]
_TAPER /= math.sqrt(float(_TAPER @ _TAPER))


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


@dataclass(frozen=True, eq=False)
class _Grid:
    """The channels in cells: motion (n, 2), speed and angle (n,); NaN where nothing is known."""

    motion: _F
    speed: _F
    angle: _F

    @classmethod
    def of(cls, record: Record, step_s: float) -> _Grid:
        """Return the cells in which both sensors measure; none where a channel is missing."""
        nothing = cls(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
        if any(
            name not in record or len(record[name]) < 2 for name in ('lateral', 'yaw', 'speed')
        ):
            return nothing
        both = [record[name].stamps_ns for name in ('lateral', 'yaw')]
        start = int(max(stamps.min() for stamps in both))
        length = (int(min(stamps.max() for stamps in both)) - start) / NANOSECONDS
        count = max(int(length / step_s), 0)
        motion, rates = [], []
        for name in ('lateral', 'yaw'):
            mean, samples = _means(*_in_order(record[name], start), step_s, count)
            motion.append(mean)
            rates.append(float(np.median(samples)) if count else 0.0)
        if min(rates) < _EVEN and max(rates) > 1.2 * min(rates) + 1.0:
            return nothing
        middle = np.asarray(step_s * (np.arange(count) + 0.5), dtype=np.float64)
        seconds, values = _in_order(record['speed'], start)
        speed, _ = _means(seconds, values, step_s, count)
        bare = ~np.isfinite(speed)
        speed[bare] = _between(middle[bare], seconds, values)
        angle = np.full(count, math.nan)
        if 'roller' in record:
            angle = _between(middle, *_in_order(record['roller'], start))
        return cls(np.stack(motion, axis=1), speed, angle)


def _in_order(series: Series, start_ns: int) -> tuple[_F, _F]:
    """Return the finite samples by their stamps, in s."""
    told = series.in_order().finite()
    return told.seconds(start_ns), told.values


def _means(seconds: _F, values: _F, step_s: float, count: int) -> tuple[_F, NDArray[np.int64]]:
    """Return the mean of the samples in each cell, NaN where there is none, and their number."""
    cell = np.floor(seconds / step_s).astype(np.int64)
    inside = (cell >= 0) & (cell < count)
    samples = np.bincount(cell[inside], minlength=count)
    total = np.bincount(cell[inside], weights=values[inside], minlength=count)
    mean: _F = np.full(count, math.nan)
    np.divide(total, samples, out=mean, where=samples > 0)
    return mean, samples


def _between(wanted: _F, seconds: _F, values: _F) -> _F:
    """Interpolate; NaN beyond the ends: what was not measured does not stand still."""
    if values.size < 2:
        return np.full(wanted.size, math.nan)
    found: _F = np.interp(wanted, seconds, values, left=math.nan, right=math.nan)
    return found
