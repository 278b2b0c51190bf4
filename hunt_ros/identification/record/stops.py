"""
Where a sensor does not measure: a spike, the end of its range, a reading that stands still.

A sine dwells at its tops, but it fills the values just below them too. Where nearly
everything that comes near the largest reading is the largest reading, the sensor has
ended and not the motion. Such stretches are taken out, as if their samples had dropped
out, and said: what they would show is an amplitude that the sensor made.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hunt_ros.errors import IdentificationError
from hunt_ros.identification.record.channels import runs
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.samples import GAP_STEPS, Record, Series, counted, smallest_step

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: A reading off the mean of its neighbours by so many times what is usual, in as many samples
#: around, is a spike where the neighbours follow on each other, to a share of it: Gaussian noise
#: does so once in 1e11 readings, and a kick, which the motion goes on from, never.
_SPIKE, _AROUND, _FOLLOW = 10.0, 64, 0.2
#: Readings at the end of the range over those in a band of the same width below it. A sine
#: has 2.4; one with its top flattened by its third harmonic as far as it stays single, 5.3.
_PILED = 8.0
#: Readings at the end of the range, and visits there, fewer than which say nothing.
_FEWEST, _VISITS = 20, 5
#: Samples of a visit, on average.
_LASTING = 5.0
#: Bands of 2^-14 to 2^-5 of all the motion: noise behind the end of the range widens it.
_FINEST, _COARSEST = 14, 5
#: Visits belong to one stretch where they are no further apart than so many usual ones.
_APART = 10.0
#: Longest time for which a sensor that measures repeats one reading, s.
_STILL_S = 1.0
#: Motion of fewer steps of the reading than this may end in a reading that stays.
_RESOLVED = 4.0


def ignoring(
    record: Record,
    number: int,
    settings: IdentificationSettings,
    names: Collection[str] = ('lateral', 'yaw'),
) -> tuple[Record, tuple[int, ...]]:
    """
    Take out the intervals of a recording that the user leaves out.

    Parameters
    ----------
    record : Record
        The channels named get NaN there.
    number : int
        Of the recording, 1 for the first.
    settings : IdentificationSettings
        For `ignore`.
    names : collection of str, optional
        Channels.

    Returns
    -------
    record : Record
    counts : tuple of int
        Samples that each interval leaves out.
    """
    channels, counts = dict(record), [0] * len(settings.ignore)
    for name in channels.keys() & set(names):
        series = channels[name]
        time, values = series.seconds(record.start_ns), series.values.copy()
        for k, (low, high, which) in enumerate(settings.ignore):
            inside = (time >= low) & (time < high) & (which in (0, number))
            values[inside] = np.nan
            counts[k] += int(inside.sum())
        if any(counts):
            channels[name] = Series(series.stamps_ns, values)
    return replace(record, channels=channels), tuple(counts)


def measuring(record: Record, warnings: list[str], saturated_m: float = 0.0) -> Record:
    """
    Take out the stretches in which the displacement sensors do not measure.

    Parameters
    ----------
    record : Record
        Channels `lateral` and `yaw` are looked at.
    warnings : list of str
        Grows by what was taken out, and why.
    saturated_m : float
        Size from which on lateral readings are at the end of the sensor's range, m; 0: not known.

    Returns
    -------
    Record
        With NaN for what was taken out.

    Raises
    ------
    IdentificationError
        If nothing is left of the lateral channel.
    """
    channels = dict(record)
    for name in ('lateral', 'yaw'):
        if name not in record:
            continue
        limit = saturated_m if name == 'lateral' else 0.0
        cleaned, said = without_stops(record[name], limit)
        if not said:
            continue
        source = record.source or 'record'
        if name == 'lateral' and not np.isfinite(cleaned.values).any():
            raise IdentificationError(f'{source}: {name} {said}: nothing of it is left')
        warnings.append(f'{source}: {name} {said}: left out')
        channels[name] = cleaned
    return replace(record, channels=channels)


def without_stops(series: Series, limit: float = 0.0) -> tuple[Series, str]:
    """
    Take out where one sensor does not measure.

    Parameters
    ----------
    series : Series
        Its readings, any unit.
    limit : float
        Size from which on they are at the end of its range; 0: looked for.

    Returns
    -------
    Series
        With NaN there.
    str
        What was found, as the end of a sentence that begins with the channel; '' for nothing.
    """
    known = series.finite()
    time, readings = known.seconds(), known.values
    if readings.size < _FEWEST or float(np.ptp(readings)) == 0.0:
        return series, ''  # a channel that is dead throughout is refused by that name
    said = []
    step, lost = float(np.median(np.diff(time))), _standing(time, readings)
    spikes = _spikes(readings) & _followed(time, step)
    if spikes.any():
        said.append(f'has {counted(int(spikes.sum()), "spike")} of one sample')
    if lost.any():
        said.append(f'is stuck at one reading for {step * lost.sum():.3g} s')
    lost |= spikes
    moves = np.flatnonzero(~lost)
    clipped = np.zeros(readings.size, dtype=bool)
    levels = []
    for sign in (1.0, -1.0):
        ends = end_of_range(sign * readings[moves], limit)
        if ends.any():
            clipped[moves] |= _stretches(time[moves], ends)
            levels.append(f'{float(np.median(readings[moves][ends])):.3g}')
    if levels:
        said.append(f'is saturated at {" and ".join(levels)} ({step * clipped.sum():.3g} s)')
    values = series.values.copy()
    values[np.flatnonzero(np.isfinite(values))[lost | clipped]] = np.nan
    return (Series(series.stamps_ns, values) if said else series), ' and '.join(said)


def _spikes(readings: Array) -> Mask:
    """Return the readings that leave their neighbours alone, which go on as if they were not."""
    off = readings[1:-1] - 0.5 * (readings[:-2] + readings[2:])
    size = np.abs(off)
    around = np.pad(size, (0, -size.size % _AROUND), mode='edge').reshape(-1, _AROUND)
    usual = np.repeat(np.median(around, axis=1), _AROUND)[: size.size]
    # The step of a reading that seldom changes is none; nor is what is small beside the motion.
    step = float(size[size > 1e-9 * size.max()].min(initial=math.inf))
    least = max(0.2 * float(np.quantile(size, 0.9)), step)
    found = size > _SPIKE * np.maximum(usual, least)
    for beside in (np.roll(off, 1), np.roll(off, -1)):
        found &= np.abs(beside + 0.5 * off) < _FOLLOW * size
    return np.pad(found, 1)


def _followed(time: Array, step: float) -> Mask:
    """Return where two samples before and two behind are in their places."""
    near = np.pad(np.diff(time) < GAP_STEPS * step, 2)
    return np.asarray(np.all([near[k : k + time.size] for k in range(4)], axis=0))


def end_of_range(values: Array, limit: float = 0.0) -> Mask:
    """
    Readings at the upper end of a sensor's range.

    A top cut by less than about four steps of the readings' resolution is not told from
    one that is whole.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Finite readings in the order of time, any unit.
    limit : float
        Size of those at the end, where it is known; 0: looked for.

    Returns
    -------
    ndarray of bool, shape (n,)
        All False where the largest readings are those of a motion that turns round.
    """
    if limit:
        return values >= limit
    nothing = np.zeros(values.size, dtype=bool)
    if values.size < _FEWEST or float(np.ptp(values)) == 0.0:
        return nothing
    top, span = float(values.max()), float(np.ptp(values))
    # No finer than the readings' own resolution, or each of their steps is a pile.
    width = max(1.01 * smallest_step(values[values > top - span / 2.0]), span / 2.0**_FINEST)
    while width <= span / 2.0**_COARSEST:
        at_end: Mask = values > top - width
        below = int(np.sum(values > top - 2.0 * width)) - int(at_end.sum())
        piled = at_end.sum() >= max(_FEWEST, _PILED * (below + 2))
        if piled and _visits(values, at_end, top - 4.0 * width):
            return at_end
        width *= 2.0
    return nothing


def _visits(values: Array, at_end: Mask, well_below: float) -> bool:
    """
    Whether a motion stays at an end, and leaves it, again and again.

    Visits last for more samples than a rounded top sampled coarsely, or a spike: of a parabola
    with five samples in a band the next lie less than a band further down, so that they would
    have been counted there. Readings that repeat need fewer. An offset of a quiet signal stays.
    """
    visits = runs(at_end)
    last = float(at_end.sum()) / len(visits)
    same = np.diff(values)[at_end[1:] & at_end[:-1]] == 0.0
    lasting = _LASTING if not same.size or np.mean(same) <= 0.5 else 0.5 * _LASTING
    left = [bool(values[a[1] : b[0]].min() < well_below) for a, b in pairwise(visits)]
    return last >= lasting and len(left) >= _VISITS - 1 and sum(left) >= 0.5 * len(left)


def _stretches(time: Array, at_end: Mask) -> Mask:
    """Join visits that follow one another into stretches: between them it is clipped too."""
    visits = runs(at_end)
    gaps = [float(time[b[0]] - time[a[1] - 1]) for a, b in pairwise(visits)]
    joined: Mask = at_end.copy()
    for (before, after), gap in zip(pairwise(visits), gaps, strict=True):
        if gap <= _APART * float(np.median(gaps)):
            joined[before[1] : after[0]] = True
    return joined


def _standing(time: Array, values: Array) -> Mask:
    """Readings that repeat for longer than any that is measured: a stuck sensor's."""
    still = np.zeros(values.size, dtype=bool)
    for first, last in runs(np.diff(values) == 0.0):
        if last - first >= _FEWEST and time[last] - time[first] >= _STILL_S:
            away = time[first] - time if first > 0 else time - time[last]
            beside = values[(away >= 0.0) & (away <= _STILL_S)]
            steps = np.abs(np.diff(beside))
            # There was motion worth several steps of the reading, and not one that died out.
            least = float(steps[steps > 0.0].min(initial=np.inf))
            still[first : last + 1] = float(np.ptp(beside)) > _RESOLVED * least
    return still
