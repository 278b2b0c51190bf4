"""Changing speed: sweeps and staircases, up and down, judged by the motion itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from detection_knowledge import Knowledge, detector_for
from detection_rigs import BENCHES, RATE_HZ
from detection_scenarios import recording, true_amplitude
from tables import markdown

from hunt_ros.detection import State, detect
from hunt_ros.detection.regions import Region
from hunt_ros.dynamics.profile.speed_profile import SpeedProfile
from hunt_ros.dynamics.simulation import RollerRig

HUNTING = (State.ESCAPING, State.LIMIT_CYCLE)
#: Lowest and highest speed and the steps of the staircase, as shares of v_c.
_LOW, _HIGH, _STEP = 0.75, 1.1, 0.025
#: Hunting in earnest: half the limit cycle at 1.05 v_c.
_IN_EARNEST = 0.5


@dataclass(frozen=True)
class Run:
    """One run with changing speed: 'sweep' or 'staircase', up and down."""

    bench: str
    profile: str
    seed: int
    broadband: float = 8e-6
    roughness: float = 20e-6


@dataclass(frozen=True)
class Task:
    """A run and who watches it."""

    run: Run
    knowledge: Knowledge


@dataclass(frozen=True)
class Course:
    """
    What was said of one run.

    `lead` is the time from the first lasting alarm to hunting in earnest, s (NaN: no such
    alarm); `false_speeds` are those of alarms that ended without hunting in earnest.
    `lost` is the time in hunting in earnest in which the state did not say so, s, and `tail`
    the time from its end to the end of the alarm state, s.
    """

    run: Run
    watcher: str
    hunted: bool
    lead: float
    alarm_speed: float
    onset_speed: float
    false_speeds: tuple[float, ...]
    lost: float
    tail: float
    hysteresis_claimed: int


def profile_of(run: Run) -> SpeedProfile:
    v_c = BENCHES[run.bench].v_c
    if run.profile == 'sweep':
        return SpeedProfile.sweep(_LOW * v_c, _HIGH * v_c, 0.004 * v_c)
    up = v_c * np.arange(_LOW, _HIGH + 0.5 * _STEP, _STEP)
    return SpeedProfile.staircase(*up, *up[-2::-1], hold_s=25.0)


def follow(task: Task) -> Course:
    """Make a run, and let it be watched."""
    run, rig = task.run, BENCHES[task.run.bench]
    profile = profile_of(run)
    settings = rig.settings(_LOW * rig.v_c, run.broadband, run.roughness)
    roller = RollerRig(rig.rig, settings, 20_000 + run.seed)
    times = np.arange(int(profile.duration_s * RATE_HZ)) / RATE_HZ
    block = roller.advance(times.size, profile(times))
    rows = detect(detector_for(task.knowledge), recording([block])).estimates
    place = np.searchsorted(block.stamps_ns, rows['stamp_ns'])
    amplitude = true_amplitude(rig, block)[np.minimum(place, times.size - 1)]
    seconds, speed = rows['stamp_ns'] * 1e-9, rows['speed']
    earnest = np.flatnonzero(amplitude > _IN_EARNEST * rig.cycle)
    hunting = np.isin(rows['state'], HUNTING)
    region = rows['region'] == Region.HYSTERESIS
    claimed = int((region[1:] & ~region[:-1]).sum()) + int(region[0])
    start, end = (int(earnest[0]), int(earnest[-1])) if earnest.size else (-1, -1)
    lead, alarm_speed, tail, false = math.nan, math.nan, math.nan, []
    for first, last in _stretches(hunting):
        if not earnest.size or last < start or first > end:
            false.append(float(speed[first]))
            continue
        if math.isnan(lead):
            lead, alarm_speed = float(seconds[start] - seconds[first]), float(speed[first])
        tail = float(seconds[last] - seconds[end])
    return Course(
        run,
        task.knowledge.name,
        bool(earnest.size),
        lead,
        alarm_speed,
        float(speed[start]) if earnest.size else math.nan,
        tuple(false),
        float((~hunting[start : end + 1]).sum() * (seconds[1] - seconds[0]))
        if earnest.size
        else 0.0,
        tail,
        claimed,
    )


def _stretches(on: np.ndarray) -> list[tuple[int, int]]:
    """First and last place of each stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]


def table(courses: list[Course]) -> str:
    """One row a rig, profile and watcher: counts and medians."""
    rows: list[list[object]] = []
    for key in dict.fromkeys((c.watcher, c.run.profile) for c in courses):
        some = [c for c in courses if (c.watcher, c.run.profile) == key]
        hunted = [c for c in some if c.hunted]
        caught = [c for c in hunted if not math.isnan(c.lead)]
        false = [speed for c in some for speed in c.false_speeds]
        rows.append(
            [
                ', '.join(key),
                len(some),
                f'{len(caught)} of {len(hunted)}',
                _spread([c.lead for c in caught]),
                _spread([c.alarm_speed for c in caught]),
                _spread([c.onset_speed for c in hunted]),
                len(false) if not false else f'{len(false)} at {_spread(false)}',
                _spread([c.lost for c in hunted]),
                _spread([c.tail for c in caught]),
                '/'.join(str(n) for n in sorted({c.hysteresis_claimed for c in some})),
            ]
        )
    return markdown(
        [
            'detector, run',
            'runs',
            'hunting found',
            'alarm ahead, s',
            'alarm at m/s',
            'half the cycle at m/s',
            'alarms without hunting',
            'hunting unsaid, s',
            'said after its end, s',
            'hysteresis claimed',
        ],
        rows,
    )


def _spread(values: list[float]) -> str:
    """Median and range."""
    if not values:
        return '-'
    return f'{np.median(values):.2f} ({min(values):.2f} to {max(values):.2f})'
