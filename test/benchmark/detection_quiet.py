"""Quiet running: false alarms of ours and the limits that give the criteria as few."""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import dataclass, field

import numpy as np
from detection_knowledge import Knowledge, detector_for
from detection_rigs import BENCHES, RATE_HZ
from detection_scenarios import Quiet, quiet_minutes
from tables import markdown

from hunt_ros.criteria import CRITERIA, make_criterion
from hunt_ros.detection import Output, State
from hunt_ros.samples import Record

RATIOS = (0.05, 0.1, 0.2)
ROUGHNESS = (0.0, 20e-6, 50e-6)
_ALARMS = ('escaping', 'limit_cycle')
_DISAGREE = 2  # bit of `doubts`


@dataclass(frozen=True)
class Task:
    """Quiet running and who watches it."""

    quiet: Quiet
    knowledge: Knowledge
    criteria: bool = False


@dataclass
class Watch:
    """What was said in one stretch of quiet running; lists have an entry a minute."""

    quiet: Quiet
    watcher: str
    alarms: list[int] = field(default_factory=list)
    disturbed: list[int] = field(default_factory=list)
    indices: dict[str, list[float]] = field(default_factory=dict)
    cpu_s: dict[str, float] = field(default_factory=dict)
    samples: int = 0
    rows: int = 0
    disagreeing: int = 0
    hysteresis_claimed: int = 0

    @property
    def hours(self) -> float:
        return len(self.alarms) / 60.0

    @property
    def escaped(self) -> bool:
        """The noise really threw the wheelset out, and the run ended there."""
        return len(self.alarms) < self.quiet.minutes


def schedule(bench: str, hours: float, ratios: tuple[float, ...] = RATIOS) -> list[Quiet]:
    """Return quiet running of so many hours in all over speeds, noise and roughness."""
    cells = list(itertools.product(BENCHES[bench].quiet_speeds, ratios, ROUGHNESS))
    pieces = max(1, round(hours / len(cells) / 0.3))  # of about 20 minutes: the work divides
    minutes = max(1, math.ceil(60.0 * hours / len(cells) / pieces))
    return [
        Quiet(bench, *cell, seed=100 * place + piece, minutes=minutes)
        for place, cell in enumerate(cells)
        for piece in range(pieces)
    ]


def watch(task: Task) -> Watch:
    """Run quiet, and note every word."""
    found = Watch(task.quiet, task.knowledge.name)
    detector = detector_for(task.knowledge)
    names = CRITERIA if task.criteria else ()
    criteria = {name: make_criterion(name, RATE_HZ) for name in names}
    found.indices = {name: [] for name in names}
    found.cpu_s = dict.fromkeys((*names, 'ours'), 0.0)
    for record in quiet_minutes(task.quiet):
        start = time.process_time()
        output = Output.joined([detector.update(*_samples(record, name)) for name in record])
        found.cpu_s['ours'] += time.process_time() - start
        rows = output.estimates
        disturbed = rows['state'] == State.DISTURBED
        found.alarms.append(sum(event.event in _ALARMS for event in output.events))
        found.disturbed.append(int((disturbed[1:] & ~disturbed[:-1]).sum()))
        found.hysteresis_claimed += sum(e.event == 'hysteresis_entered' for e in output.events)
        found.rows += rows.size
        found.disagreeing += int(((rows['doubts'] & _DISAGREE) != 0).sum())
        series = record['lateral']
        found.samples += len(series)
        for name, criterion in criteria.items():
            start = time.process_time()
            made = criterion.update(series.stamps_ns, series.values, task.quiet.speed)
            found.cpu_s[name] += time.process_time() - start
            index = made['index'][np.isfinite(made['index'])]
            found.indices[name].append(float(index.max()) if index.size else 0.0)
    return found


def _samples(record: Record, name: str) -> tuple[str, np.ndarray, np.ndarray]:
    return name, record[name].stamps_ns, record[name].values


def limits(watches: list[Watch], events: str = 'alarms') -> dict[str, float]:
    """
    Limit of each criterion that is exceeded in as many minutes as ours spoke in.

    Parameters
    ----------
    watches : list of Watch
        With criteria.
    events : str
        What of ours counts: 'alarms' or 'disturbed'.
    """
    ours = sum(count > 0 for one in watches for count in getattr(one, events))
    scaled = {}
    for name in CRITERIA:
        largest = sorted((x for one in watches for x in one.indices[name]), reverse=True)
        scaled[name] = largest[min(ours, len(largest) - 1)]
    return scaled


def microseconds(watches: list[Watch]) -> dict[str, float]:
    """CPU, us a lateral sample, of ours (which takes yaw, roller and speed too) and of each."""
    samples = sum(one.samples for one in watches)
    names = watches[0].cpu_s
    return {name: 1e6 * sum(one.cpu_s[name] for one in watches) / samples for name in names}


def table(watches: list[Watch]) -> str:
    """Hours and our alarms, by noise."""
    rows: list[list[object]] = []
    for ratio in RATIOS:
        some = [one for one in watches if one.quiet.ratio == ratio]
        hours = sum(one.hours for one in some)
        disturbed = sum(sum(one.disturbed) for one in some)
        alarms, escaped = sum(sum(one.alarms) for one in some), sum(one.escaped for one in some)
        row = [ratio, f'{hours:.2f}', alarms, f'{disturbed / max(hours, 1e-9):.1f}', escaped]
        rows.append(row)
    header = ['A_rms/A_u', 'hours', 'our alarms', '`disturbed` an hour', 'really escaped']
    return markdown(header, rows)
