"""
A campaign: many recordings identified by the workers of a Dask scheduler.

One local worker against two, with the bootstrap; whether both give what one process gives; and
the memory of the client against that of the samples. Then the last recording beside the others,
of which all is kept, against all read again. Run with --quick for four recordings, without
publication.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from runpy import run_path

import numpy as np
from distributed import LocalCluster
from tables import markdown, publish

from hunt_ros.bag import read_record, write_record
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile.speed_profile import SpeedProfile
from hunt_ros.dynamics.simulation import simulate
from hunt_ros.identification import IdentificationSettings, identify

_MAKERS = run_path(str(Path(__file__).parents[1] / 'identification' / 'conftest.py'))


def write(task: tuple[str, int]) -> int:
    """Write one recording of 75 s at 1 kHz: a few holds of a staircase; return its samples."""
    path, seed = task
    speeds = 6.2 + 0.2 * ((3 * seed + np.arange(3)) % 14)
    profile = SpeedProfile.staircase(*speeds, hold_s=25.0)
    settings = replace(_MAKERS['rig_settings'](), sample_rate_hz=1000.0)
    record = simulate(paper_rig(), settings, profile, seed=seed)
    write_record(path, record)
    return sum(series.values.size for series in record.values())


def client(paths: list[str], settings: IdentificationSettings) -> None:
    """Identify in this process; print the time, the peak of the memory, and the result."""
    begun = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.perf_counter()
    result = identify([partial(read_record, path) for path in paths], settings)
    took = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    document = json.dumps(result.to_json(), sort_keys=True)
    print(json.dumps({'s': took, 'mb': (peak - begun) / 1024.0, 'result': document}))


def measured(paths: list[str], address: str, bootstrap: int, keep: str = '') -> dict:
    """Run a client in a process of its own."""
    words = [sys.executable, __file__, '--client', address, '--bootstrap', str(bootstrap)]
    words += ['--work-folder', keep, *paths]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout.splitlines()[-1]))


def main() -> None:
    """Measure, print and publish."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='4 recordings, no publication')
    parser.add_argument('--recordings', type=int, default=40)
    parser.add_argument('--bootstrap', type=int, default=200)
    parser.add_argument('--client', help=argparse.SUPPRESS)
    parser.add_argument('--work-folder', default='', help=argparse.SUPPRESS)
    parser.add_argument('paths', nargs='*', help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.client is not None:
        settings = IdentificationSettings(
            cluster=arguments.client,
            bootstrap=arguments.bootstrap,
            jobs=1,
            work_folder=arguments.work_folder,
        )
        client(arguments.paths, settings)
        return
    count = 4 if arguments.quick else arguments.recordings
    replications = 40 if arguments.quick else arguments.bootstrap
    rows, found = [], {}
    with tempfile.TemporaryDirectory() as folder:
        paths = [str(Path(folder) / f'run{k:03d}') for k in range(count)]
        with ProcessPoolExecutor(mp_context=get_context('spawn')) as pool:
            samples = sum(pool.map(write, zip(paths, range(count), strict=True)))
        for workers in (0, 1, 2):
            if not workers:
                found[workers] = measured(paths, '', replications)
            else:
                with LocalCluster(
                    n_workers=workers, threads_per_worker=1, dashboard_address=None
                ) as local:
                    measured(paths[:4], local.scheduler_address, 40)  # compiled before the clock
                    found[workers] = measured(paths, local.scheduler_address, replications)
            print(workers, found[workers]['s'], found[workers]['mb'], file=sys.stderr, flush=True)
        keep = str(Path(folder) / 'kept')
        all_read = measured(paths, '', 0)
        first = measured(paths[:-1], '', 0, keep)
        size = sum(file.stat().st_size for file in Path(keep).iterdir())
        one_more = measured(paths, '', 0, keep)
        nothing_new = measured(paths, '', 0, keep)
    for workers, name in ((0, 'this process'), (1, 'one worker'), (2, 'two workers')):
        one = found[workers]
        same = 'yes' if one['result'] == found[0]['result'] else '**no**'
        ratio = f'{found[1]["s"] / one["s"]:.2f}'
        rows.append([name, f'{one["s"]:.1f}', ratio, f'{one["mb"]:.0f}', same])
    same = 'yes' if one_more['result'] == all_read['result'] else '**no**'
    again = 'yes' if nothing_new['result'] == all_read['result'] else '**no**'
    kept = [
        [f'all {count}, nothing kept', f'{all_read["s"]:.1f}', '-'],
        [f'{count - 1}, all of them new', f'{first["s"]:.1f}', '-'],
        ['and one more', f'{one_more["s"]:.1f}', same],
        [f'all {count}, all kept: the fit alone', f'{nothing_new["s"]:.1f}', again],
    ]
    header = ['work done by', 'time, s', 'times one worker', "client's memory, MB", 'same result']
    text = (
        f'{count} recordings of 75 s at 1 kHz, {samples / 1e6:.1f} million samples'
        f' ({16 * samples / 2**20:.0f} MB with their stamps), {replications} replications of the'
        f' bootstrap; {os.cpu_count()} cores, which the client and both workers share. Memory is'
        ' what the identification adds to the peak. Goals: two workers 1.7 times one, the same'
        " result bit for bit, and a client that does not hold the recordings' samples.\n\n"
        + markdown(header, rows)
        + '\n\nWithout the bootstrap, in one process; `--work-folder` holds'
        f' {size / 2**20 / (count - 1):.2f} MB of each recording:\n\n'
        + markdown(['recordings', 'time, s', 'same result'], kept)
    )
    if arguments.quick:
        print(text)
    else:
        publish('bench-campaign', 'A campaign on several workers', text)


if __name__ == '__main__':
    main()
