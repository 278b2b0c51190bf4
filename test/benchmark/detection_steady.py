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
    """Relative errors of the mean amplitude, and the spread of single rows about the truth."""

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
    """Largest error, %, of the mean over the seeds at any speed."""
    return max(abs(100.0 * mean) for mean, _ in _cells(readings).values())


def bias(readings: list[Reading]) -> float:
    """Mean error over everything, %."""
    return 100.0 * float(np.mean([one.error for one in readings]))


def _cells(readings: list[Reading]) -> dict[float, tuple[float, float]]:
    cells = {}
    for speed in sorted({one.task.speed for one in readings}):
        errors = [one.error for one in readings if one.task.speed == speed]
        cells[speed] = (float(np.mean(errors)), float(np.max(np.abs(errors))))
    return cells


def table(readings: list[Reading]) -> str:
    """Mean and largest error at each speed, by watcher."""
    rows: list[list[object]] = []
    for watcher in dict.fromkeys(one.task.knowledge.name for one in readings):
        some = [one for one in readings if one.task.knowledge.name == watcher]
        cells = [f'{100 * m:+.2f} ({100 * w:.2f})' for m, w in _cells(some).values()]
        rows.append([watcher, *cells, f'{100 * np.mean([one.scatter for one in some]):.2f}'])
    speeds = [f'{speed:g} m/s, %' for speed in sorted({one.task.speed for one in readings})]
    return markdown(['detector', *speeds, 'scatter of a row, %'], rows)


def criterion_errors(readings: list[Reading]) -> dict[str, float]:
    """Mean error, %, of the amplitude that each criterion's index implies."""
    some = [one for one in readings if one.criteria]
    return {n: 100.0 * float(np.mean([one.criteria[n] for one in some])) for n in CRITERIA}
