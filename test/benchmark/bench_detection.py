"""
The detector against the railway criteria on simulated rigs.

`--scale 1` is the full run (24 h of quiet running, ten minutes on two cores); 0.05 is a quick
look. `--publish` puts the tables into docs/benchmarks.md. What is measured stands in the
modules `detection_*` beside this one: rigs, knowledge (what the detector is told), kicks,
quiet running, sweeps, steady amplitude; the goals in `detection_goals`.
"""

from __future__ import annotations

import argparse
import itertools
import resource
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

import detection_kicks as kicks
import detection_quiet as quiet
import detection_report as report
import detection_steady as steady
import detection_sweeps as sweeps
from detection_goals import goals
from detection_kicks import ROUGHNESS
from detection_knowledge import (
    Knowledge,
    impaired,
    refitted,
    told_nothing,
    told_paper,
    told_speeds,
    told_truth,
)
from detection_measured import Measured
from detection_rigs import BENCHES, WAYS
from detection_scenarios import critical_kick
from tables import publish

_T = TypeVar('_T')
_R = TypeVar('_R')

#: What scale 1 means: hours of quiet running, and numbers of seeds.
HOURS = {'paper': 24.0, '14 m/s': 3.0, 'supercritical': 4.0, 'other forms': 1.5}
SEEDS = {'kicks': 24, '14 m/s kicks': 4, 'other forms': 6, 'steady': 3, 'sweep': 16, 'stairs': 8}
CLONES = 7
REFITS = 3


class Workers:
    """Processes that share the work, and say on standard error how far they are."""

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self._pool = pool
        self._began = time.perf_counter()

    def __call__(
        self, label: str, function: Callable[[_T], _R], tasks: Sequence[_T], chunk: int = 1
    ) -> list[_R]:
        found: list[_R] = []
        for result in self._pool.map(function, tasks, chunksize=chunk):
            found.append(result)
            if len(found) == len(tasks) or not len(found) % max(1, len(tasks) // 10):
                since = time.perf_counter() - self._began
                print(f'{since:5.0f} s  {label}: {len(found)}/{len(tasks)}', file=sys.stderr)
        return found


def _critical(key: tuple[str, float, str, float]) -> float:
    return critical_kick(*key)


def all_critical(work: Workers) -> dict[tuple[str, float, str, float], float]:
    """Bisect the critical kick of every rig, speed, way and roughness."""
    keys = [
        (bench.key, speed, way, roughness)
        for bench in BENCHES.values()
        for speed, way, roughness in itertools.product(bench.kick_speeds, WAYS, ROUGHNESS)
    ]
    return dict(zip(keys, work('critical kicks', _critical, keys), strict=True))


def measure_kicks(
    work: Workers, measured: Measured, watchers: list[Knowledge], forms: list[Knowledge]
) -> None:
    """Kicks of the paper's rig: of all noise under the true form, of little under the others."""
    critical, scale = all_critical(work), measured.scale
    truth = told_truth('paper')
    plan = kicks.schedule('paper', critical, _seeds('kicks', scale))
    tasks = [kicks.Task(kick, truth, criteria=True, clones=_clones(kick)) for kick in plan]
    measured.kicks = work('kicks', kicks.judge, tasks, 4)
    few = kicks.schedule('paper', critical, _seeds('other forms', scale), (0.05,), near=2)
    others = [kicks.Task(kick, one) for one in (truth, *watchers) for kick in few]
    measured.other_kicks = work('kicks, other knowledge', kicks.judge, others, 4)
    rig = '14 m/s'
    some = kicks.schedule(rig, critical, _seeds('14 m/s kicks', scale), near=2)
    fits = [one for one in forms if one.name.startswith(f'{rig}:')]
    told = [told_truth(rig), told_truth(rig, False), *fits[:1]]
    tasks = [kicks.Task(kick, watcher) for watcher in told for kick in some]
    measured.rig_kicks = work('kicks, 14 m/s', kicks.judge, tasks, 4)


def _clones(kick: kicks.Kick) -> int:
    """The true chance is asked for where the goals are: with little noise."""
    return CLONES if kick.ratio <= 0.05 else 0


def measure_quiet(work: Workers, measured: Measured, watchers: list[Knowledge]) -> None:
    """Quiet running: of the paper's rig with the criteria, of the others, under other forms."""
    tasks = [
        quiet.Task(one, told_truth(rig), criteria=rig == 'paper')
        for rig in ('paper', '14 m/s', 'supercritical')
        for one in quiet.schedule(rig, HOURS[rig] * measured.scale)
    ]
    hours = HOURS['other forms'] * measured.scale
    tasks += [
        quiet.Task(one, watcher)
        for watcher in watchers
        for one in quiet.schedule('paper', hours, (0.2,))
    ]
    bare = [told_nothing('supercritical'), told_speeds('supercritical')]
    tasks += [
        quiet.Task(one, watcher)
        for watcher in bare
        for one in quiet.schedule('supercritical', hours, (0.2,))
    ]
    measured.quiet = work('quiet', quiet.watch, tasks)


def measure_sweeps(work: Workers, measured: Measured, forms: list[Knowledge]) -> None:
    """Sweeps and staircases of all rigs, under the true form, a refitted one and none."""
    tasks = []
    for rig in BENCHES:
        own = [one for one in forms if one.name.startswith(f'{rig}:')]
        for watcher in (told_truth(rig), *own[:1], told_nothing(rig)):
            for profile, kind in (('sweep', 'sweep'), ('staircase', 'stairs')):
                tasks += [
                    sweeps.Task(sweeps.Run(rig, profile, seed), watcher)
                    for seed in range(_seeds(kind, measured.scale))
                ]
    measured.courses = work('sweeps and staircases', sweeps.follow, tasks)


def measure_steady(work: Workers, measured: Measured) -> None:
    """Limit cycles, with everything in order and with something wrong."""
    watchers = [
        (rig, known)
        for rig in ('paper', '14 m/s')
        for known in (told_truth(rig), told_truth(rig, False), *impaired(rig))
    ]
    tasks = [
        steady.Task(rig, speed, seed, known, known.name == 'paper: true form')
        for rig, known in watchers
        for speed in BENCHES[rig].cycle_speeds
        for seed in range(_seeds('steady', measured.scale))
    ]
    measured.readings = work('steady amplitude', steady.read, tasks)


def _seeds(kind: str, scale: float) -> int:
    return max(1, round(SEEDS[kind] * scale))


def measure(work: Workers, scale: float) -> Measured:
    """Do everything."""
    measured = Measured(scale)
    fits = work('refits', refitted, [(rig, seed) for rig in BENCHES for seed in range(REFITS)])
    forms = [fit for fit in fits if fit is not None]
    measured.refits = {rig: sum(f.name.startswith(f'{rig}:') for f in forms) for rig in BENCHES}
    own = [fit for fit in forms if fit.name.startswith('paper:')]
    told = [
        told_truth('paper', False),
        *own,
        told_paper(),
        told_speeds('paper'),
        told_nothing('paper'),
    ]
    measure_kicks(work, measured, [*told, *impaired('paper')], forms)
    measure_quiet(work, measured, told)
    measure_sweeps(work, measured, forms)
    measure_steady(work, measured)
    return measured


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--scale', type=float, default=0.05, help='1: the full run')
    parser.add_argument('--publish', action='store_true', help='write docs/benchmarks.md')
    parser.add_argument('--jobs', type=int, default=None, help='processes; default: one a core')
    arguments = parser.parse_args()
    began = time.perf_counter()
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context('spawn')) as pool:
        measured = measure(Workers(pool), arguments.scale)
    minutes = (time.perf_counter() - began) / 60.0
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = (used.ru_utime + used.ru_stime) / 60.0
    took = f'Took {minutes:.1f} min, {cpu:.1f} min of CPU.'
    text = '\n\n'.join([goals(measured), *report.sections(measured), took])
    if arguments.publish:
        publish('bench-detection', 'The detector against the railway criteria', text)
    else:
        print(text)


if __name__ == '__main__':
    main()
