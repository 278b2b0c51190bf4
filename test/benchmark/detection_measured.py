"""Everything that was measured of the detector, and the comparison that needs all of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from detection_kicks import Verdict
from detection_quiet import Watch, limits
from detection_steady import Reading
from detection_sweeps import Course
from detection_verdicts import Cell, cell_of, criterion_delay, own_limits


@dataclass
class Measured:
    """Everything that was measured."""

    scale: float
    refits: dict[str, int] = field(default_factory=dict)
    kicks: list[Verdict] = field(default_factory=list)
    other_kicks: list[Verdict] = field(default_factory=list)
    rig_kicks: list[Verdict] = field(default_factory=list)
    quiet: list[Watch] = field(default_factory=list)
    courses: list[Course] = field(default_factory=list)
    readings: list[Reading] = field(default_factory=list)

    def quiet_of(self, watcher: str) -> list[Watch]:
        return [one for one in self.quiet if one.watcher == watcher]

    def readings_of(self, watcher: str) -> list[Reading]:
        return [one for one in self.readings if one.task.knowledge.name == watcher]


TRUTH = 'paper: true form'


def limited_delay(one: Verdict, name: str, limit: float, own: dict[Cell, dict] | None) -> float:
    return criterion_delay(one, name, own[cell_of(one.kick)][name] if own else limit)


def missed(delays: list[float]) -> str:
    return f'{100.0 * np.mean(np.isinf(delays)):.1f} % of {len(delays)}' if delays else '-'


def disturbed_against_cfr(measured: Measured) -> tuple[list[float], list[float], list[float]]:
    """
    Delays, s, of `disturbed` and of the CFR structure, which speak as often in quiet running.

    Returns
    -------
    ours, own_limits, one_limit : lists of float
        With the kicks that found ours quiet.
    """
    known = [one for one in measured.kicks if not math.isnan(one.disturbed)]
    cells = own_limits(measured.kicks, 'disturbed_before')
    single = limits(measured.quiet_of(TRUTH), 'disturbed')['cfr_213_333']
    name = 'cfr_213_333'
    return (
        [one.disturbed for one in known],
        [limited_delay(one, name, single, cells) for one in known],
        [limited_delay(one, name, single, None) for one in known],
    )
