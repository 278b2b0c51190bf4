"""
Windows of quiet running: what noise makes of both sensors together, as cross-spectra.

A window is twelve periods of hunting long. Each channel is averaged into cells, sixteen a period,
on a grid that both sensors share, and the known lines are taken out by the angle of the roller;
the rest, under Hann's window, becomes one cross-spectral matrix a bin.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
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
    step = 1.0 / (_CELLS * frequency_hz)
    steady = [window for grid in _grids(record, step) for window in grid.steady()]
    if len(steady) > MOST_WINDOWS:
        places = np.linspace(0, len(steady) - 1, MOST_WINDOWS).astype(np.int64)
        steady = [steady[place] for place in places]
    amplitudes: list[float] = []
    spectra: list[_C] = []
    usable: list[NDArray[np.bool_]] = []
    for _, moved, angle in steady:
        motion, free = _without_lines(moved, angle, orders)
        turned = np.fft.rfft(motion * _TAPER[:, None], axis=0)[BINS]
        amplitudes.append(math.sqrt(2.0) * float(np.std(motion[:, 0])))
        spectra.append(step * turned[:, :, None] * turned[:, None, :].conj())
        usable.append(free)
    return ResponseWindows(
        np.array([speed for speed, _, _ in steady], dtype=np.float64),
        np.array(amplitudes, dtype=np.float64),
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

    def steady(self) -> Iterator[tuple[float, _F, _F]]:
        """Yield speed, m/s, motion and angle of the windows in which the speed stands still."""
        for start in range(0, self.speed.size - WINDOW + 1, WINDOW // 2):
            part = slice(start, start + WINDOW)
            speed = abs(float(self.speed[part].mean()))
            change = float(np.ptp(self.speed[part].reshape(_PARTS, -1).mean(axis=1)))
            motion = _whole(self.motion[part]) if change < SAME_SPEED * speed else None
            if motion is not None:
                yield speed, motion, self.angle[part]


def _grids(record: Record, step_s: float) -> Iterator[_Grid]:
    """Yield the cells wherever both sensors measure; a gap as long as a window ends them."""
    if any(name not in record for name in ('lateral', 'yaw', 'speed')):
        return
    told = {name: series.in_order().finite() for name, series in record.items()}
    longest_s = WINDOW * step_s
    for start, end in _overlaps(
        *(_stretches(told[name], longest_s) for name in ('lateral', 'yaw'))
    ):
        count = int((end - start) / NANOSECONDS / step_s)
        motion, rates = [], []
        for name in ('lateral', 'yaw'):
            mean, samples = _means(told[name], start, step_s, count)
            motion.append(mean)
            filled = samples[samples > 0]
            rates.append(float(np.median(filled)) if filled.size else 0.0)
        if min(rates) < _EVEN and max(rates) > 1.2 * min(rates) + 1.0:
            continue
        middle = np.asarray(step_s * (np.arange(count) + 0.5), dtype=np.float64)
        speed, _ = _means(told['speed'], start, step_s, count)
        bare = ~np.isfinite(speed)
        speed[bare] = _between(middle[bare], told['speed'], start, longest_s)
        angle = np.full(count, math.nan)
        if 'roller' in told:
            angle = _between(middle, told['roller'], start, longest_s)
        yield _Grid(np.stack(motion, axis=1), speed, angle)


def _stretches(series: Series, longest_s: float) -> list[tuple[int, int]]:
    """Return first and last stamp of what is measured without a gap that is longer, ns."""
    stamps = series.stamps_ns
    if stamps.size < 2:
        return []
    ends = np.append(np.flatnonzero(np.diff(stamps) > longest_s * NANOSECONDS), stamps.size - 1)
    starts = np.append(0, ends[:-1] + 1)
    return [(int(stamps[a]), int(stamps[b])) for a, b in zip(starts, ends, strict=True)]


def _overlaps(
    one: Sequence[tuple[int, int]], other: Sequence[tuple[int, int]]
) -> Iterator[tuple[int, int]]:
    """Yield what lies in a stretch of either list, both in order."""
    i = k = 0
    while i < len(one) and k < len(other):
        start, end = max(one[i][0], other[k][0]), min(one[i][1], other[k][1])
        if start < end:
            yield start, end
        if one[i][1] < other[k][1]:
            i += 1
        else:
            k += 1


def _means(
    series: Series, start_ns: int, step_s: float, count: int
) -> tuple[_F, NDArray[np.int64]]:
    """Return the mean of the samples in each cell, NaN where there is none, and their number."""
    end_ns = start_ns + int(count * step_s * NANOSECONDS) + 1
    first, last = np.searchsorted(series.stamps_ns, [start_ns, end_ns])
    cell = np.floor((series.stamps_ns[first:last] - start_ns) / (step_s * NANOSECONDS))
    cell = cell.astype(np.int64)
    inside = cell < count
    values = series.values[first:last][inside]
    samples = np.bincount(cell[inside], minlength=count)
    total = np.bincount(cell[inside], weights=values, minlength=count)
    mean: _F = np.full(count, math.nan)
    np.divide(total, samples, out=mean, where=samples > 0)
    return mean, samples


def _between(wanted: _F, series: Series, start_ns: int, longest_s: float) -> _F:
    """Interpolate; NaN beyond the ends and in gaps: what was not measured does not stand still."""
    if not len(series) or not wanted.size:
        return np.full(wanted.size, math.nan)
    seconds = series.seconds(start_ns)
    found: _F = np.interp(wanted, seconds, series.values, left=math.nan, right=math.nan)
    after = np.clip(np.searchsorted(seconds, wanted), 1, max(seconds.size - 1, 1))
    if seconds.size > 1:
        found[seconds[after] - seconds[after - 1] > longest_s] = math.nan
    return found
