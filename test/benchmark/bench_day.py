"""
Measure the detector on random rigs and days: false alarms, misses, delays, flips, contradictions.

    python test/benchmark/bench_day.py [--days 500] [--first 0] [--worst 10]

Each day follows from its seed (`day_rigs`): `--first 17 --days 1` repeats day 17. To each fourth
comes another of the same rig, which stops or reverses.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from day_rigs import TURNS, Day, random_day
from numpy.typing import NDArray
from tables import markdown

from hunt_ros.detection import HuntingDetector, Level, detect
from hunt_ros.detection.output import Output
from hunt_ros.detection.regions import State
from hunt_ros.estimation.tracker_config import REFERENCE_HZ

#: Periods: a cycle that lasts shorter need not be said; ERROR may begin and end as much off the
#: truth; what is steady for a while is.
LASTS, OFF, STEADY = 20.0, 4.0, 10.0
#: In the cycle above this part of the stable branch; out of it below this part of what it was.
IN, OUT = 0.85, 0.35
#: A cycle that stands less clear of the quiet motion is none that anybody could tell from it.
CLEAR = 5.0
_B = NDArray[np.bool_]


@dataclass
class Marks:
    """What came of one day; times in seconds of a rig of the reference frequency."""

    sound_s: float = 0.0
    false_s: float = 0.0
    false_alarms: int = 0
    cycles: int = 0
    missed: int = 0
    delays: list[float] = field(default_factory=list)
    grown: int = 0
    ahead: int = 0
    flips: int = 0
    ok_in_doubt_s: float = 0.0
    contradict_s: float = 0.0

    @property
    def bad(self) -> int:
        """How many things went wrong."""
        return self.false_alarms + self.missed + self.flips

    def add(self, other: Marks) -> None:
        """Sum up."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)


def truth(day: Day) -> tuple[list[tuple[int, int, int]], _B]:
    """
    Return the cycles as (rising, arrived, left), places in `day.t`, and where ERROR is not false.

    An alarm is not false while it grows on its way to the cycle, within it, while it dies out,
    beyond v_c, and near the unstable branch, where the noise decides.
    """
    a = day.amplitude
    unstable, stable = day.rig.branches(day.speed)
    quiet = day.rig.quiet * day.rig.scale
    near = np.nan_to_num(a > 0.7 * unstable) | (day.speed > 0.99 * day.rig.v_c)
    if day.rig.fold:  # beside the fold it lingers for long, as if it cycled
        near |= (day.speed > 0.97 * day.rig.v_c * (1.0 - day.rig.fold)) & (a > 0.5 * day.rig.scale)
    allowed = near.copy()
    cycles = []
    k, n = 0, a.size
    while k < n:
        if not (a[k] > IN * stable[k] and stable[k] > CLEAR * quiet):
            k += 1
            continue
        arrived, size = k, a[k]
        while k < n and a[k] > OUT * size:
            size += 0.02 * (a[k] - size)
            k += 1
        before = np.flatnonzero(a[:arrived] < max(0.2 * a[arrived], 2.0 * quiet))
        begun = int(before[-1]) if before.size else 0
        cycles.append((begun, arrived, k))
        over = np.flatnonzero(a[k:] < max(0.1 * size, 3.0 * quiet))
        allowed[begun : k + int(over[0]) if over.size else n] = True
    return cycles, allowed


def judged(day: Day, output: Output) -> Marks:
    """Compare what was said with the truth."""
    marks, rows, t = Marks(), output.estimates, day.t
    unit = day.rig.hz / REFERENCE_HZ  # seconds of this rig to those of the reference
    step = float(t[1] - t[0])
    place = np.searchsorted(rows['stamp_ns'], t * 1e9, side='right') - 1
    level = rows['level'][np.maximum(place, 0)]
    level[place < 0] = Level.STALE
    error = level == Level.ERROR
    cycles, allowed = truth(day)
    _, stable = day.rig.branches(day.speed)
    margin = max(1, round(OFF / day.rig.hz / step))
    wide = np.convolve(allowed, np.ones(2 * margin + 1), mode='same') > 0
    sound = t < day.fault_s
    false = error & ~wide & sound
    marks.sound_s = unit * step * float(np.count_nonzero(sound))
    marks.false_s = unit * step * float(np.count_nonzero(false))
    marks.false_alarms = int(np.count_nonzero(np.diff(false.astype(np.int8), prepend=0) > 0))
    for begun, arrived, left in cycles:
        span = slice(arrived, left)
        doubt = np.count_nonzero(level[span] == Level.OK)
        marks.ok_in_doubt_s += unit * step * float(doubt)
        if (t[left - 1] - t[arrived]) * day.rig.hz < LASTS or t[left - 1] > day.fault_s:
            continue
        marks.cycles += 1
        said = np.flatnonzero(error[begun:left])
        if not said.size:
            marks.missed += 1
            continue
        marks.delays.append(unit * step * float(begun + said[0] - arrived))
        # Before 90 % of the amplitude that it comes to, where it was seen to grow.
        a = day.amplitude
        if t[begun] > 0.0 and t[arrived] > t[begun]:
            high = np.flatnonzero(a[begun:left] > 0.9 * float(np.max(a[begun:left])))
            marks.grown += 1
            marks.ahead += bool(said[0] <= high[0])
        # Beyond the fold there is no cycle any more: what dies out is said to.
        gone = np.flatnonzero(np.isnan(stable[arrived:left]))
        over = arrived + int(gone[0]) if gone.size else left - margin
        held = error[begun + said[0] : max(over, arrived)]
        marks.flips += int(np.count_nonzero(np.diff(held.astype(np.int8)) < 0))
    wrong = contradicting(output)
    spacing_s = float(np.median(np.diff(rows['stamp_ns']))) * 1e-9 if wrong.size > 1 else 0.0
    marks.contradict_s = unit * spacing_s * float(np.count_nonzero(wrong))
    return marks


def contradicting(output: Output) -> _B:
    """Return the rows whose word their own numbers contradict, shape (n,)."""
    rows = output.estimates
    state, chance = rows['state'], rows['escape_probability']
    growth, spread = rows['growth_rate'], 2.0 * rows['growth_rate_std']
    cycles = (state == State.LIMIT_CYCLE) & (chance < 0.05)
    grows = (state == State.ESCAPING) & (growth + spread < 0.0)
    dies = (state == State.DECAYING) & (chance > 0.5) & (growth - spread > 0.0)
    return np.asarray(cycles | grows | dies)


def lived(day: Day) -> tuple[Marks, Output]:
    """Run the detector over a day."""
    output = detect(HuntingDetector(day.config, day.form), day.record)
    return judged(day, output), output


def days_of(seeds: range) -> Iterator[Day]:
    """Yield the days of the seeds, and those that stop or reverse."""
    for seed in seeds:
        yield random_day(seed)
        if seed % 4 == 0:
            yield random_day(seed, TURNS[seed // 4 % 2])


def main() -> None:
    """Run the days that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--days', type=int, default=500)
    parser.add_argument('--first', type=int, default=0, help='seed of the first day')
    parser.add_argument('--worst', type=int, default=10, help='days that are named')
    asked = parser.parse_args()
    kinds: dict[str, Marks] = {}
    found = []
    for day in days_of(range(asked.first, asked.first + asked.days)):
        marks, output = lived(day)
        told = 'form' if day.form else 'no form'
        for name in ('all', told, day.fault or 'sound', day.kind):
            kinds.setdefault(name, Marks()).add(marks)
        found.append((marks.bad, day.title, marks))
        if asked.days == 1:
            for event in output.events:
                print(f'{event.stamp_ns * 1e-9:8.2f} {event.event}: {event.cause}')
    for _, title, marks in sorted(found, key=lambda one: -one[0])[: asked.worst]:
        print(
            f'{title}\n    false {marks.false_alarms} ({marks.false_s:.1f} s), missed'
            f' {marks.missed} of {marks.cycles}, flips {marks.flips}, OK in doubt'
            f' {marks.ok_in_doubt_s:.1f} s, contradict {marks.contradict_s:.1f} s'
        )
    head = ['days', 'hours', 'false alarms', 'ERROR s', 'cycles', 'missed', 's, median', '90 %']
    rows: list[list[object]] = []
    for name, marks in kinds.items():
        delays = np.quantile(marks.delays or [math.nan], [0.5, 0.9]).tolist()
        rows.append([name, marks.sound_s / 3600.0, marks.false_alarms, marks.false_s])
        rows[-1] += [marks.cycles, marks.missed, *delays, marks.flips, marks.ok_in_doubt_s]
        ahead = f'{marks.ahead} of {marks.grown}' if marks.grown else '-'
        rows[-1] += [marks.contradict_s, ahead]
    last = ['flips', 'OK in doubt, s', 'contradict, s', 'ahead of 90 %']
    print('\n' + markdown([*head, *last], rows))


if __name__ == '__main__':
    main()
