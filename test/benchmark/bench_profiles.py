"""
What a see-saw and an adaptive staircase measure, against the paper's staircase.

The simulated rig is the full model; profiles that react see the amplitude of its motion. Each
recording is identified whole. The see-saw gets a third of the time of the staircase, the adaptive
staircase takes what it takes. Then the same through the seven nodes, whose detector reads the
motion, the interlock in `measure`. Run with --fast for 2 seeds and one run of the nodes, without
publication.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from bench_plan import _MAKERS as MAKERS
from bench_plan import NAMES, numbers, row, truth
from tables import markdown, publish

from hunt_ros.bag import read_record
from hunt_ros.cli.support import suite
from hunt_ros.cli.support.console_link import ConsoleLink
from hunt_ros.cli.support.processes import Processes
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Profile
from hunt_ros.dynamics.simulation import simulate
from hunt_ros.errors import HuntError
from hunt_ros.identification import Identification, identify
from hunt_ros.samples import Record
from hunt_ros.suite import LISTENERS, SIMULATOR, SOURCES

LOOP = 'low_mps: 6.0, high_mps: 8.8'
PROFILES = {
    'staircase': f'profile: [{{staircase: {{{LOOP}}}}}]',
    'see-saw': 'profile: [{seesaw: {duration_s: 240}}]',
    'adaptive staircase': f'profile: [{{adaptive_staircase: {{{LOOP}}}}}]',
}


#: Of the nodes: times as fast as real time at most, and the most that a run may take, s.
_PACE, _RUN_S, _CLOSING_S = 8.0, 600.0, 120.0


def measured(task: tuple[int, str]) -> tuple[float, np.ndarray]:
    """Run a profile; return how long it took, s, and the numbers identified."""
    seed, text = task
    settings, profile = MAKERS['rig_settings'](), Profile.from_yaml(text)
    return identified(simulate(paper_rig(), settings, profile, seed=seed))


def identified(record: Record) -> tuple[float, np.ndarray]:
    """Return the length of a recording, s, and the numbers identified from it."""
    known: Identification | None = None
    try:
        known = identify(record)
    except HuntError as refused:
        print(refused, file=sys.stderr, flush=True)
    return record.duration_s, numbers(known)


def through_nodes(seed: int, text: str) -> tuple[float, np.ndarray]:
    """Run a profile with the seven nodes on the simulated rig, and identify what was recorded."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        form = folder / 'form.yaml'
        form.write_text(IdentifiedNormalForm(PAPER_NORMAL_FORM).to_yaml(), encoding='utf-8')
        profile = Profile.from_yaml(text)
        parameters = suite.simulated_run(folder, profile, _PACE, seed=seed)
        # A see-saw begins where the rig is.
        parameters[SIMULATOR] |= {'roughness_m': 3e-5, 'initial_speed_mps': 6.0}
        common = suite.follow_clock(_PACE)
        with Processes('rig', folder / 'logs', private=True) as processes:
            link = suite.start_console(processes)
            suite.start_nodes(processes, LISTENERS, common, parameters, [form])
            suite.wait_until_up(link, LISTENERS)
            suite.start_nodes(processes, [SIMULATOR], {}, parameters)
            suite.start_nodes(processes, SOURCES, common, parameters)
            path = recording(link)
            print(f'{profile.name or text}, seed {seed}: {path.name}', file=sys.stderr, flush=True)
            return identified(read_record(path))


def recording(link: ConsoleLink) -> Path:
    """Wait until the profile has run; return the closed recording."""
    began = ''
    for line in link.lines(_RUN_S):
        state = line.get('profile_state', '')
        if began and state not in ('', began):
            break
        began = began or (state if state == 'running' else '')
    else:
        raise SystemExit(f'the profile did not end within {_RUN_S:.0f} s')
    link.call('recording/stop')
    said = []
    for line in link.lines(_CLOSING_S):
        if line['topic'] == 'recording/closed':
            return Path(line['data'])
        if 'recording' in str(line):
            said.append(str(line))
    print(*said[:20], *said[-20:], sep='\n', file=sys.stderr)
    raise SystemExit(f'the recording was not closed within {_CLOSING_S:.0f} s')


def main() -> None:
    """Measure, print and publish."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--fast', action='store_true', help='2 seeds, no publication')
    parser.add_argument('--runs', type=int, default=10, help='of the nodes, each profile')
    parser.add_argument('--jobs', type=int, default=None)
    arguments = parser.parse_args()
    seeds = range(2 if arguments.fast else 20)
    true = truth(paper_rig())
    rows: list[list[object]] = []
    lasted: dict[str, float] = {}

    def add(name: str, found: list[tuple[float, np.ndarray]]) -> None:
        lasted[name] = float(np.mean([duration_s for duration_s, _ in found]))
        label = f'{name}, {lasted[name]:.0f} s ({lasted[name] / lasted["staircase"]:.2f})'
        rows.append(row(label, [each for _, each in found], true))

    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context('spawn')) as pool:
        for name, text in PROFILES.items():
            add(name, list(pool.map(measured, [(seed, text) for seed in seeds])))
            print(f'{name}: {rows[-1]}', file=sys.stderr, flush=True)
    runs = 1 if arguments.fast else arguments.runs
    for name, text in list(PROFILES.items())[1:]:
        add(f'{name}, nodes, {runs} runs', [through_nodes(seed, text) for seed in range(runs)])
        print(f'{rows[-1]}', file=sys.stderr, flush=True)
    rows.append(['truth', '', *(f'{value:.4g}' for value in true)])
    text = (
        'Full model with roughness 30 um, forcing 8e-6, noise 5 um; rms error / rms of the stated'
        f' deviation (within two deviations), {len(seeds)} seeds; in brackets the share of the'
        " staircase's time. Goal: v_n and v_c to 0.05 m/s and A_u to 3 % in a third of its time"
        ' with the see-saw, in half of it with the adaptive staircase. The runs of the nodes are'
        f' up to {_PACE:.0f} times as fast as real time, their alarm holds the coefficients (33)'
        ' of the paper, and their interlock is in `measure`.\n\n'
        + markdown(['', 'answers', *NAMES], rows)
    )
    if arguments.fast:
        print(text)
    else:
        publish('bench-profiles', 'Profiles that react to the motion', text)


if __name__ == '__main__':
    main()
