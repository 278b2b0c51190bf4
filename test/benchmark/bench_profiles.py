"""
What a see-saw and an adaptive staircase measure, against the paper's staircase.

The simulated rig is the full model; profiles that react see the amplitude of its motion. Each
recording is identified whole. The see-saw gets a third of the time of the staircase, the adaptive
staircase takes what it takes. Run with --fast for 2 seeds, without publication.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
from bench_plan import _MAKERS as MAKERS
from bench_plan import NAMES, numbers, row, truth
from tables import markdown, publish

from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Profile
from hunt_ros.dynamics.simulation import simulate
from hunt_ros.errors import HuntError
from hunt_ros.identification import identify

LOOP = 'low_mps: 6.0, high_mps: 8.8'
PROFILES = {
    'staircase': f'profile: [{{staircase: {{{LOOP}}}}}]',
    'see-saw': 'profile: [{seesaw: {duration_s: 240}}]',
    'adaptive staircase': f'profile: [{{adaptive_staircase: {{{LOOP}}}}}]',
}


def measured(task: tuple[int, str]) -> tuple[float, np.ndarray]:
    """Run a profile; return how long it took, s, and the numbers identified."""
    seed, text = task
    record = simulate(paper_rig(), MAKERS['rig_settings'](), Profile.from_yaml(text), seed=seed)
    duration_s = float(record['lateral'].seconds(record.start_ns)[-1])
    try:
        return duration_s, numbers(identify(record))
    except HuntError:
        return duration_s, numbers(None)


def main() -> None:
    """Measure, print and publish."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--fast', action='store_true', help='2 seeds, no publication')
    parser.add_argument('--jobs', type=int, default=None)
    arguments = parser.parse_args()
    seeds = range(2 if arguments.fast else 20)
    true = truth(paper_rig())
    rows: list[list[object]] = []
    lasted: dict[str, float] = {}
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context('spawn')) as pool:
        for name, text in PROFILES.items():
            found = []
            for one in pool.map(measured, [(seed, text) for seed in seeds]):
                found.append(one)
                print(f'{name}: {len(found)} of {len(seeds)}', file=sys.stderr, flush=True)
            lasted[name] = float(np.mean([duration_s for duration_s, _ in found]))
            share = lasted[name] / lasted['staircase']
            label = f'{name}, {lasted[name]:.0f} s ({share:.2f})'
            rows.append(row(label, [each for _, each in found], true))
    rows.append(['truth', '', *(f'{value:.4g}' for value in true)])
    text = (
        'Full model with roughness 30 um, forcing 8e-6, noise 5 um; rms error / rms of the stated'
        f' deviation (within two deviations), {len(seeds)} seeds; in brackets the share of the'
        " staircase's time. Goal: v_n and v_c to 0.05 m/s and A_u to 3 % in a third of its time"
        ' with the see-saw, in half of it with the adaptive staircase.\n\n'
        + markdown(['', 'answers', *NAMES], rows)
    )
    if arguments.fast:
        print(text)
    else:
        publish('bench-profiles', 'Profiles that react to the motion', text)


if __name__ == '__main__':
    main()
