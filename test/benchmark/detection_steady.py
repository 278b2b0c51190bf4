"""Amplitude in the limit cycle: ours and what the criteria's indices imply, against the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from detection_knowledge import Knowledge, detector_for
from detection_rigs import BENCHES, RATE_HZ
from detection_scenarios import recording, true_amplitude
from tables import markdown

from hunt_ros.criteria import CRITERIA, make_criterion
from hunt_ros.detection import detect
from hunt_ros.dynamics.simulation import RollerRig

_BEFORE_S, _AFTER_S, _JUDGED_S = 4.0, 50.0, 20.0
#: Index over the acceleration amplitude A (2 pi f)^2 of a steady oscillation.
_PER_PEAK = {'cfr_213_333': math.sqrt(0.5), 'uic_518': math.sqrt(0.5)}


@dataclass(frozen=True)
class Task:
    """A limit cycle and who watches it."""

    bench: str
    speed: float
    seed: int
    knowledge: Knowledge
    criteria: bool = False


@dataclass(frozen=True)
class Reading:
    """
    Relative errors of the mean amplitude, and the spread of single rows about the truth.

    Both are NaN where the detector says that the amplitude is unknown.
    """

    task: Task
    error: float
    scatter: float
    criteria: dict[str, float]


def read(task: Task) -> Reading:
    """Kick the wheelset onto its limit cycle, wait, and compare the amplitude."""
    rig = BENCHES[task.bench]
    speed = task.speed
    roller = RollerRig(rig.rig, rig.settings(speed, 8e-6, 30e-6), 30_000 + task.seed)
    blocks = [roller.advance(int(_BEFORE_S * RATE_HZ))]
    rig.kick(roller, 'y', 1.1 * rig.stable(speed))
    blocks.append(roller.advance(int(_AFTER_S * RATE_HZ)))
    record, last = recording(blocks), blocks[1]
    rows = detect(detector_for(task.knowledge), task.knowledge.received(record, task.seed))
    estimates = rows.estimates
    # Clear of the ends, where the true amplitude is not known.
    end_ns = int(last.stamps_ns[-1] - 2e9)
    inside = (estimates['stamp_ns'] > end_ns - _JUDGED_S * 1e9) & (estimates['stamp_ns'] < end_ns)
    place = np.searchsorted(last.stamps_ns, estimates['stamp_ns'][inside])
    truth = true_amplitude(rig, last)[place]
    found = estimates['lateral_amplitude'][inside]
    criteria = {}
    for name in CRITERIA if task.criteria else ():
        series = record['lateral']
        made = make_criterion(name, RATE_HZ).update(series.stamps_ns, series.values, speed)
        index = float(np.nanmean(made['index'][made['stamp_ns'] > end_ns - _JUDGED_S * 1e9]))
        turn = 2.0 * math.pi * task.knowledge.config.hunting_frequency_hz
        implied = index / (turn**2 * _PER_PEAK.get(name, 1.0))
        criteria[name] = implied / float(truth.mean()) - 1.0
    error = float(found.mean() / truth.mean() - 1.0)
    return Reading(task, error, float(np.std(found / truth)), criteria)


def worst(readings: list[Reading]) -> float:
    """Largest error, %, of any reading that was given."""
    return float(np.nanmax([abs(100.0 * one.error) for one in readings]))


def unknown(readings: list[Reading]) -> int:
    """Readings in which the amplitude was said to be unknown."""
    return sum(math.isnan(one.error) for one in readings)


def bias(readings: list[Reading]) -> float:
    """Mean error over everything, %."""
    return 100.0 * float(np.nanmean([one.error for one in readings]))


def _cell(readings: list[Reading], speed: float) -> str:
    errors = np.array([100.0 * one.error for one in readings if one.task.speed == speed])
    known = errors[np.isfinite(errors)]
    words = f'{known.mean():+.2f} ({np.abs(known).max():.2f})' if known.size else ''
    if known.size < errors.size:
        words = f'{words} {errors.size - known.size} of {errors.size} unknown'.strip()
    return words


def table(readings: list[Reading]) -> str:
    """Mean and largest error at each speed, by watcher."""
    rows: list[list[object]] = []
    speeds = sorted({one.task.speed for one in readings})
    for watcher in dict.fromkeys(one.task.knowledge.name for one in readings):
        some = [one for one in readings if one.task.knowledge.name == watcher]
        cells = [_cell(some, speed) for speed in speeds]
        rows.append([watcher, *cells, f'{100 * np.nanmean([one.scatter for one in some]):.2f}'])
    heads = [f'{speed:g} m/s, %' for speed in speeds]
    return markdown(['detector', *heads, 'scatter of a row, %'], rows)


def criterion_errors(readings: list[Reading]) -> dict[str, float]:
    """Mean error, %, of the amplitude that each criterion's index implies."""
    some = [one for one in readings if one.criteria]
    return {n: 100.0 * float(np.mean([one.criteria[n] for one in some])) for n in CRITERIA}
