"""Kicks: what the detector and the criteria say of them, against what really came of them."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from zlib import crc32

import numpy as np
from detection_knowledge import Knowledge, detector_for
from detection_rigs import BENCHES, RATE_HZ, WAYS
from detection_scenarios import Kick, Outcome, kicked

from hunt_ros.criteria import CRITERIA, make_criterion
from hunt_ros.detection import State, detect

RATIOS = (0.02, 0.05, 0.1, 0.2)
FACTORS = (0.8, 0.95, 1.05, 1.2, 2.0)
NEAR = (0.95, 1.05)
ROUGHNESS = (0.0, 20e-6)
#: Ways and roughness of a kick, taken in turn by the seeds.
VARIANTS = tuple(itertools.product(WAYS, ROUGHNESS))
#: When decisions are compared with what came of them, s after the kick.
WAITS = (0.4, 1.0, 2.0)
HUNTING = (State.ESCAPING, State.LIMIT_CYCLE)
#: Before this the criteria's filters and our noise floor have not settled, ns.
SETTLED_NS = 5_000_000_000
#: Samples a row of ours, 10 ms.
EACH = 5


@dataclass(frozen=True)
class Task:
    """A kick and who watches it; `clones` wheelsets tell the true chance where there are any."""

    kick: Kick
    knowledge: Knowledge
    criteria: bool = False
    clones: int = 0


@dataclass(frozen=True)
class Verdict:
    """
    What was said of one kick; times in s after it, inf where never.

    `probability`, `hunting` and `foretold` (the true chance, where it was asked for) are at
    `WAITS`; `disturbed` is NaN where the detector was not quiet when the kick came.
    `indices` is the running maximum of each criterion's index after the kick, 100 a second,
    `indices_before` its maximum in the quiet running before.
    """

    kick: Kick
    watcher: str
    escaped: bool
    foretold: tuple[float, ...]
    disturbed: float
    alarm: float
    alarm_probability: float
    alarms_before: int
    disturbed_before: int
    probability: tuple[float, ...]
    hunting: tuple[bool, ...]
    indices: dict[str, np.ndarray]
    indices_before: dict[str, float]


def schedule(
    bench: str,
    critical: dict[tuple[str, float, str, float], float],
    seeds: int,
    ratios: tuple[float, ...] = RATIOS,
    near: int = 3,
) -> list[Kick]:
    """Return kicks of every speed, ratio and factor; those near critical `near` times as many."""
    kicks = []
    for speed, ratio, factor in itertools.product(BENCHES[bench].kick_speeds, ratios, FACTORS):
        for number in range(seeds * (near if factor in NEAR else 1)):
            way, roughness = VARIANTS[number % len(VARIANTS)]
            size = critical[bench, speed, way, roughness]
            # A seed of its own for every kick: none shares its noise with another.
            seed = crc32(f'{bench} {speed} {ratio} {factor} {number}'.encode())
            kicks.append(Kick(bench, speed, ratio, factor, way, roughness, size, seed))
    return kicks


def judge(task: Task) -> Verdict:
    """Make a kick, and let it be watched."""
    kick = task.kick
    clones = task.clones if kick.factor in NEAR and kick.roughness == 0.0 else 0
    outcome = kicked(kick, WAITS, clones)
    detector = detector_for(task.knowledge)
    received = task.knowledge.received(outcome.record, kick.seed)
    rows = detect(detector, received).estimates
    since = (rows['stamp_ns'] - outcome.kick_ns) * 1e-9
    after = since >= 0.0
    hunting = np.isin(rows['state'], HUNTING)
    disturbed = rows['state'] != State.QUIET
    settled = ~after & (rows['stamp_ns'] > SETTLED_NS)
    first = np.flatnonzero(after & disturbed)
    alarm = np.flatnonzero(after & hunting)
    p = rows['escape_probability']
    at = np.searchsorted(since, WAITS)
    known = not after[0] and rows['state'][~after][-1] == State.QUIET
    moved = float(since[first[0]]) if first.size else math.inf
    indices, before = _indices(outcome, kick.speed) if task.criteria else ({}, {})
    return Verdict(
        kick,
        task.knowledge.name,
        outcome.escaped,
        outcome.foretold,
        moved if known else math.nan,
        float(since[alarm[0]]) if alarm.size else math.inf,
        float(p[alarm[0]]) if alarm.size else math.nan,
        _onsets(hunting & settled),
        _onsets(disturbed & settled),
        tuple(float(value) for value in p[at]),
        tuple(bool(hunting[after & (since <= wait)].any()) for wait in WAITS),
        indices,
        before,
    )


def _onsets(on: np.ndarray) -> int:
    return int((on[1:] & ~on[:-1]).sum())


def _indices(outcome: Outcome, speed: float) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    series = outcome.record['lateral']
    after, before = {}, {}
    for name in CRITERIA:
        rows = make_criterion(name, RATE_HZ).update(series.stamps_ns, series.values, speed)
        index = np.nan_to_num(rows['index'])
        late = rows['stamp_ns'] >= outcome.kick_ns
        before[name] = float(index[~late & (rows['stamp_ns'] > SETTLED_NS)].max())
        risen = np.maximum.accumulate(index[late])
        after[name] = risen[EACH - 1 :: EACH].astype(np.float32)
    return after, before
