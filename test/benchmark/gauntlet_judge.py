"""
The observer of the gauntlet: it knows the truth from the rig, and shares no code with the suite.

It has the true motion and speed, the set points that reached the drive, the calls that the alarm
command wrote down, what the director did and when, and how long the machine let processes of the
suite wait. Times are those of the epoch, s.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

#: Letter -> what must not happen.
RULES = {
    'a': 'hunting for more than 3 s above the true v_n, or left there, guarded in `protect`',
    'b': 'a set point rises without a command of a person',
    'c': 'the set point changes faster than its limit',
    'd': 'blind while the roller turns, or hunting, for more than 2 s, and nobody is called',
    'e': 'a trip or a call without a fault',
    'f': 'a recording that cannot be read, or more than 1 s lost to a kill',
    'g': '`hunt run` does not end',
}
_HUNTING_S, _UNCALLED_S, _LOST_S = 3.0, 2.0, 1.0
#: A roller that is slower stands: nothing hunts, and who is blind calls nobody.
_TURNS_MPS = 0.05
#: A share of the limit cycle that no quiet state reaches.
_HUNTS = 0.65
_PEAKS_S = 0.12
#: Rates of the set point are judged over so long, s.
_WINDOW_S = 0.5
#: Limits of the drive as the settings have it, m/s2; what counts as a rise and as a fall, m/s.
_RATE_MPS2, _RISE_MPS, _FALL_MPS = 1.0, 0.05, 0.05
#: A command of a person counts for what begins within this, s.
_OBEYED_S = 5.0
#: A machine that lets the suite wait longer than this share of a scenario is none to judge on.
_MOST_LATE = 0.5


@dataclass
class Deed:
    """
    Something that was done to the rig or the suite.

    `kind` and `what` name it; it lasts from `begin_s` to `end_s`. `blind`: no sensor or no
    detector while it lasts; `drive`: nobody can command the roller.
    """

    kind: str
    what: str
    begin_s: float
    end_s: float = math.inf
    blind: bool = False
    drive: bool = False


@dataclass
class Witness:
    """What was seen of one scenario."""

    truth: NDArray[np.float64]  # time, displacement, speed, how late
    set_points: NDArray[np.float64]  # time, m/s
    calls: list[tuple[float, str]]  # time, condition
    deeds: list[Deed]
    requests: list[float]  # when a person asked to start or resume
    stops: list[float]  # when something had to end every start
    waits: NDArray[np.float64]  # time, and how long a process of the suite waited since the last
    run_s: tuple[float, float]  # from the first start to the end of the suite
    ended: bool = True
    recordings: dict[Path, tuple[float, float] | str] = field(default_factory=dict)
    kills: list[float] = field(default_factory=list)  # of the recorder, while it recorded
    emergency: bool = False
    disarmed_s: float = math.inf

    def late_s(self, begin_s: float, end_s: float) -> float:
        """Return how much of a time the machine, not the suite, has spent."""
        times, waited = self.waits.T if self.waits.size else (np.zeros(0), np.zeros(0))
        of_suite = waited[(times >= begin_s - 0.5) & (times <= end_s + 0.5)].sum()
        rows = self.truth[(self.truth[:, 0] >= begin_s) & (self.truth[:, 0] <= end_s)]
        return float(max(of_suite, rows[:, 3].sum()))


def stretches(times_s: NDArray[np.float64], holds: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return begin and end of each time in which something holds."""
    edges = np.diff(np.concatenate([[False], holds, [False]]).astype(np.int8))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [(float(times_s[b]), float(times_s[e])) for b, e in zip(begins, ends, strict=True)]


def judge(seen: Witness, v_n_mps: float, cycle_m: float) -> tuple[dict[str, str], str]:
    """Return letter -> what was violated and when, and '' or why nothing can be judged."""
    begin_s, end_s = seen.run_s
    rows = seen.truth[(seen.truth[:, 0] >= begin_s) & (seen.truth[:, 0] <= end_s + 1.0)]
    if len(rows) < 100:
        return {}, 'the suite did not start'
    late_s = seen.late_s(begin_s, end_s)
    if late_s > _MOST_LATE * (end_s - begin_s):
        return {}, f'the machine was late by {late_s:.1f} s of {end_s - begin_s:.1f} s'
    times, _, speeds, _ = rows.T
    turns = np.abs(speeds) > _TURNS_MPS
    hunts = turns & _hunting(rows, cycle_m)
    found = {
        'a': _guarded(seen, times, hunts & (speeds > v_n_mps + 0.05), float(speeds[-1]) > v_n_mps),
        'b': _commanded(seen),
        'c': _rates(seen),
        'd': _called(seen, times, hunts, turns),
        'e': _quiet(seen),
        'f': _recorded(seen),
        'g': '' if seen.ended else 'it had to be killed',
    }
    return {letter: words for letter, words in found.items() if words}, ''


def _hunting(rows: NDArray[np.float64], cycle_m: float) -> NDArray[np.bool_]:
    """Return where the motion is that of a limit cycle: its peaks are 0.18 s apart."""
    half = max(1, round(_PEAKS_S / float(np.median(np.diff(rows[:, 0])))))
    padded, count = np.pad(rows[:, 1], half), 2 * half + 1
    largest = np.lib.stride_tricks.sliding_window_view(padded, count).max(axis=1)
    return np.asarray(largest > _HUNTS * cycle_m)


def _in_force(
    seen: Witness, times: NDArray[np.float64], chosen: Callable[[Deed], bool]
) -> NDArray:
    """Return where a deed of some kind lasts."""
    holds = np.zeros(times.size, dtype=bool)
    for deed in seen.deeds:
        if chosen(deed):
            holds |= (times >= deed.begin_s) & (times <= deed.end_s)
    return holds


def _calling(seen: Witness, times: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where somebody is called."""
    holds = np.zeros(times.size, dtype=bool)
    for at_s, condition in seen.calls:
        holds[times >= at_s] = condition in ('alarm', 'doubt')
    return holds


def _guarded(
    seen: Witness, times: NDArray[np.float64], unsafe: NDArray[np.bool_], left: bool
) -> str:
    helpless = _in_force(seen, times, lambda deed: deed.drive) & _calling(seen, times)
    unsafe = unsafe & ~helpless & (times < seen.disarmed_s)
    for begin_s, end_s in stretches(times, unsafe):
        lasted_s = end_s - begin_s - seen.late_s(begin_s, end_s)
        if lasted_s > _HUNTING_S:
            return f'{lasted_s:.1f} s of hunting from {begin_s - seen.run_s[0]:.1f} s on'
    # A wrong form that no motion refutes says itself where the roller is safe.
    excused = any(deed.drive or deed.kind.startswith('form') for deed in seen.deeds)
    if left and not excused and math.isinf(seen.disarmed_s):
        return 'the roller is left above v_n'
    return ''


def _commanded(seen: Witness) -> str:
    """Say where a set point rose although nobody had asked for it since it had to fall."""
    lowest, fell_s, before = math.inf, -math.inf, math.inf
    for at_s, value in seen.set_points:
        stops = [stop_s for stop_s in seen.stops if fell_s < stop_s <= at_s]
        if value < before - _FALL_MPS or stops:
            fell_s, lowest = at_s if value < before - _FALL_MPS else stops[-1], value
        before = value
        asked_s = max((when for when in seen.requests if when <= at_s), default=-math.inf)
        if asked_s > -math.inf and asked_s + _OBEYED_S >= fell_s:
            lowest = value
        elif value > lowest + _RISE_MPS:
            return f'{lowest:.2f} to {value:.2f} m/s at {at_s - seen.run_s[0]:.1f} s'
        lowest = min(lowest, value)
    return ''


def _rates(seen: Witness) -> str:
    points = seen.set_points
    for index in range(len(points)):
        later = np.searchsorted(points[:, 0], points[index, 0] + _WINDOW_S)
        if later >= len(points):
            break
        passed_s = points[later, 0] - points[index, 0]
        change = points[later, 1] - points[index, 1]
        # A fall begins at the measured speed, which lags behind or is wrong; a stop is a leap.
        leaps = seen.emergency or any(deed.drive for deed in seen.deeds)
        spare = 0.12 if change > 0.0 else math.inf if leaps else 0.5
        late_s = seen.late_s(points[index, 0], points[later, 0])
        if passed_s < 2.0 and abs(change) > _RATE_MPS2 * (1.1 * passed_s + late_s) + spare:
            at_s = points[index, 0] - seen.run_s[0]
            return f'{change:+.2f} m/s in {passed_s:.2f} s at {at_s:.1f} s'
    return ''


def _called(
    seen: Witness, times: NDArray[np.float64], hunts: NDArray[np.bool_], turns: NDArray[np.bool_]
) -> str:
    first = next((at_s for at_s, condition in seen.calls if condition == 'well'), math.inf)
    bad = hunts | (turns & _in_force(seen, times, lambda deed: deed.blind))
    uncalled = bad & ~_calling(seen, times) & (times > first) & (times < seen.run_s[1])
    for begin_s, end_s in stretches(times, uncalled):
        lasted_s = end_s - begin_s - seen.late_s(begin_s, end_s)
        if lasted_s > _UNCALLED_S:
            return f'{lasted_s:.1f} s from {begin_s - seen.run_s[0]:.1f} s on'
    return ''


def _quiet(seen: Witness) -> str:
    if seen.deeds:
        return ''
    well = [at_s for at_s, condition in seen.calls if condition == 'well']
    end_s = min(seen.stops)
    for at_s, condition in seen.calls:
        if condition != 'well' and well and well[0] < at_s < end_s:
            return f'{condition} called at {at_s - seen.run_s[0]:.1f} s'
    told = seen.set_points[seen.set_points[:, 0] < end_s, 1]
    falls = np.flatnonzero(np.diff(told) < -_FALL_MPS)
    if falls.size:
        return f'a trip at {seen.set_points[falls[0], 0] - seen.run_s[0]:.1f} s'
    return ''


def _recorded(seen: Witness) -> str:
    spans: list[tuple[float, float]] = []
    for path, read in seen.recordings.items():
        if isinstance(read, str):
            return f'{path.name}: {read}'
        spans.append(read)
    if not spans:
        return 'nothing was recorded'
    for kill_s in seen.kills:
        last = max((min(end, kill_s) for begin, end in spans if begin < kill_s), default=0.0)
        lost_s = kill_s - last - seen.late_s(kill_s - 2.0, kill_s)
        if lost_s > _LOST_S:
            return f'{min(lost_s, 999.0):.1f} s before a kill are lost'
    return ''


def table(results: Iterable[dict[str, object]]) -> list[list[object]]:
    """Return a row for each kind of fault: scenarios, those not judged, violations by letter."""
    rows: dict[str, dict[str, int]] = {}
    for result in results:
        kinds = list(result['kinds']) or ['no fault']  # type: ignore[call-overload]
        for kind in [*sorted(set(kinds)), 'all']:
            row = rows.setdefault(kind, dict.fromkeys(('n', 'not', *RULES), 0))
            row['n'] += 1
            row['not'] += bool(result['unjudged'])
            for letter in result['violations']:  # type: ignore[attr-defined]
                row[letter] += 1
    order = sorted(rows, key=lambda kind: (kind == 'all', kind))
    return [[kind, *rows[kind].values()] for kind in order]
