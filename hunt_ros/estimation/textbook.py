"""
The tracker beside a textbook filter, on a recording: do two programs see the same amplitude?

The second one is filterpy's KalmanFilter (Labbe, Kalman and Bayesian Filters in Python, ch. 6) on
the raw readings of one sensor: a phasor of one frequency, a bias and the known lines, each a
random walk of fixed noise. It shares no code with the tracker, tunes nothing and is not compiled:
a tracker that computes wrongly on this machine, or takes the motion for something else, differs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hunt_ros.estimation.kalman import HuntingTracker, TrackerConfig
from hunt_ros.estimation.tracker_config import Shaft
from hunt_ros.estimation.turning import continuous
from hunt_ros.samples import NANOSECONDS, Record, Series
from hunt_ros.sensors import DISPLACEMENTS, SENSORS

_F = NDArray[np.float64]

#: Readings are averaged over a cell, so many a period; compared are so many s of largest motion.
_CELLS, _LONGEST_S = 16.0, 60.0
#: Bandwidth of the textbook filter, of the frequency: it forgets in two periods, as long as the
#: tracker does; the lines and the bias wander slower by this factor.
_BANDWIDTH, _SLOWER = 0.5, 0.1
#: Compared after so many periods, in as many at least, where the amplitude is so many standard
#: deviations and changes by less than this share in a period.
_SETTLED, _CLEAR, _STEADY = 10.0, 10.0, 0.03
#: Squared differences of cells add up to 2 n times their variance where they are noise alone (von
#: Neumann, 1941), to 0.15 n times where they are motion. At 1.5 the amplitude is 0.9 deviations of
#: a cell: three of what two periods tell of it.
_WHITE = 1.5
#: What is beyond these percentiles is cut off: a spike is noise, and larger than all motion.
_USUAL = (0.5, 99.5)


def compared_amplitudes(
    record: Record, frequency_hz: float, orders: Sequence[float] = (1.0, 2.0)
) -> tuple[float, float] | None:
    """
    Return the amplitude by the tracker and by the textbook filter.

    Parameters
    ----------
    record : Record
        Its first displacement is looked at, where it moves most; lines need `roller`.
    frequency_hz : float
        Nominal hunting frequency, Hz.
    orders : sequence of float
        Known lines, in turns of the roller.

    Returns
    -------
    tuple of float, or None
        Medians of both over the same cells, m or rad; None where nothing is steady and clear of
        its noise.
    """
    told = _told(record)
    name = next(iter(told), None)
    if name is None:
        return None
    readings = _liveliest(told[name])
    rows, clear, ends, angle = _followed(record, name, readings, frequency_hz, orders)
    ours = rows[f'{name}_amplitude']
    if not clear.any():
        return None
    step_ns = _step_ns(frequency_hz)
    cell = ((readings.stamps_ns - readings.stamps_ns[0]) / step_ns).astype(np.int64)
    count = np.bincount(cell, minlength=ends.size)[: ends.size]
    mean, turned = (
        np.bincount(cell, weights=column, minlength=ends.size)[: ends.size] / np.fmax(count, 1)
        for column in (readings.values, angle)
    )
    turns = float(np.median(rows['frequency_hz'][clear])) * step_ns / NANOSECONDS
    theirs = _textbook(mean, turned, count > 0, 2.0 * math.pi * turns, orders)
    theirs /= np.sinc(turns)  # what a mean over a cell leaves of it
    return float(np.median(ours[clear])), float(np.median(theirs[clear]))


def unmoved(
    record: Record, frequency_hz: float, orders: Sequence[float] = (1.0, 2.0)
) -> dict[str, str]:
    """
    Say which displacements show nothing where another one hunts: their sensors are dead.

    Parameters
    ----------
    record : Record
        Looked at is the minute in which the other one moves most.
    frequency_hz : float
        Nominal hunting frequency, Hz.
    orders : sequence of float
        Known lines, in turns of the roller.

    Returns
    -------
    dict of str to str
        By channel what it shows, and what the other one does.
    """
    told, dead = _told(record), {}
    for moving, series in told.items():
        span = _liveliest(series)
        rows, clear, *_ = _followed(record, moving, span, frequency_hz, orders)
        for name, other in told.items() if clear.any() else ():
            here = other.between(int(span.stamps_ns[0]), int(span.stamps_ns[-1]) + 1)
            if not len(here):
                continue
            cell = (here.stamps_ns - span.stamps_ns[0]) // round(_step_ns(frequency_hz))
            count = np.fmax(np.bincount(cell), 1)
            values = np.clip(here.values, *np.percentile(here.values, _USUAL))
            means = (np.bincount(cell, weights=values) / count)[np.unique(cell)]
            if np.sum(np.diff(means) ** 2) > _WHITE * means.size * np.var(means):
                size = float(np.median(rows[f'{moving}_amplitude'][clear]))
                unit = next(sensor.unit for sensor in SENSORS if sensor.name == moving)
                dead[name] = f'shows only noise while {moving} moves by {size:.3g} {unit}'
    return dead


def _step_ns(frequency_hz: float) -> float:
    return NANOSECONDS / (_CELLS * frequency_hz)


def _told(record: Record) -> dict[str, Series]:
    """Return the displacements that have readings."""
    told = {name: record[name].in_order().finite() for name in DISPLACEMENTS if name in record}
    return {name: series for name, series in told.items() if len(series) > 1}


def _followed(
    record: Record,
    name: str,
    readings: Series,
    frequency_hz: float,
    orders: Sequence[float],
) -> tuple[NDArray[np.void], NDArray[np.bool_], NDArray[np.int64], _F]:
    """Return what the tracker says, cell by cell, where clearly, their ends, and the angle."""
    angle = np.full(len(readings), math.nan)
    if 'roller' in record:
        roller = continuous(record['roller'].in_order().finite())
        if len(roller) > 1:
            angle = np.interp(readings.stamps_ns, roller.stamps_ns, roller.values)
    step_ns = _step_ns(frequency_hz)
    count = int((readings.stamps_ns[-1] - readings.stamps_ns[0]) / step_ns)
    ends = readings.stamps_ns[0] + (np.arange(1, count + 1) * step_ns).astype(np.int64)
    config = TrackerConfig(
        frequency_hz,
        0.35 * frequency_hz,
        2.1 * frequency_hz,
        (Shaft(tuple(orders)),),
        tuple(sensor for sensor in SENSORS if sensor.name == name),
    )
    samples = readings.stamps_ns, 0, readings.values, angle, math.nan
    rows = HuntingTracker(config).update(*samples, ends)
    clear = rows[f'{name}_amplitude'] > _CLEAR * rows[f'{name}_amplitude_std']
    clear &= np.abs(rows['growth_rate']) < _STEADY * frequency_hz
    clear[: int(_SETTLED * _CELLS)] = False
    clear &= np.count_nonzero(clear) >= _SETTLED * _CELLS
    return rows, clear, ends, angle


def _liveliest(series: Series) -> Series:
    """Return the minute with the largest motion."""
    part = ((series.stamps_ns - series.stamps_ns[0]) / (_LONGEST_S * NANOSECONDS)).astype(np.int64)
    # Of a record with a year of silence in it there are few.
    minutes = np.unique(part)
    here = part == minutes[np.argmax([np.std(series.values[part == k]) for k in minutes])]
    return Series(series.stamps_ns[here], series.values[here])


def _textbook(
    values: _F, angle: _F, told: NDArray[np.bool_], turn: float, orders: Sequence[float]
) -> _F:
    """Return the amplitude in each cell; `turn`: of the phasor in one, rad."""
    from filterpy.kalman import KalmanFilter

    lines = list(orders) if np.isfinite(angle).all() else []
    kf = KalmanFilter(dim_x=3 + 2 * len(lines), dim_z=1)
    kf.F[:2, :2] = [[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]
    kf.x[2], kf.P = np.median(values[told]), kf.P * 1e4 * float(np.var(values[told]))
    kf.R *= float(np.var(values[told]))
    wander = np.full(kf.dim_x, (_SLOWER * _BANDWIDTH / _CELLS) ** 2)
    wander[:2] = (_BANDWIDTH / _CELLS) ** 2
    kf.Q = np.diag(wander) * kf.R
    amplitude = np.empty(values.size)
    for k in range(values.size):
        kf.predict()
        if told[k]:
            waves = [w(n * angle[k]) for n in lines for w in (math.cos, math.sin)]
            kf.update(values[k], H=np.array([[1.0, 0.0, 1.0, *waves]]))
        amplitude[k] = math.hypot(*kf.x[:2, 0])
    return amplitude
