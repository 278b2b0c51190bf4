"""
Run the demo again and again as a newcomer does, idle or beside busy loops, and print how it ended.

A run ends well with exit code 0, a form with v_n, no ERROR or WARN before the sweep has begun,
and no kernel compiled on the way.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import hunt_ros

_MOST_S = 1800.0
_CODE = Path(hunt_ros.__file__).parent / 'machine_code'


def _spin() -> None:
    while True:
        pass


def _run(out: Path, seed: int) -> dict[str, object]:
    """Return what came of one run."""
    known = set(_CODE.glob('*.code'))
    words = [sys.executable, '-m', 'hunt_ros.cli.main', 'demo', '--out', str(out)]
    began = time.monotonic()
    with tempfile.TemporaryFile('w+') as log:
        process = subprocess.run(
            [*words, '--seed', str(seed)], stdout=log, stderr=log, timeout=_MOST_S, check=False
        )
        log.seek(0)
        lines = log.read().splitlines()
    start = lines[: next((i for i, line in enumerate(lines) if ' m/s ' in line), len(lines))]
    loud = [line for line in start if 'ERROR' in line or 'WARN' in line]
    forms = list(out.glob('demo_*/normal_form.yaml'))
    return {
        'seed': seed,
        'exit': process.returncode,
        'form': bool(forms),
        'seconds': round(time.monotonic() - began),
        'loud': loud,
        'compiled': len(set(_CODE.glob('*.code')) - known),
        'last': lines[-1] if lines else '',
    }


def main() -> int:
    """Run, print a line a run and the sums, and return 1 where one run did not end well."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--runs', type=int, default=20)
    parser.add_argument('--busy', type=int, default=0, help='busy loops beside it')
    arguments = parser.parse_args()
    loops = [multiprocessing.Process(target=_spin, daemon=True) for _ in range(arguments.busy)]
    for loop in loops:
        loop.start()
    good = 0
    for seed in range(1, arguments.runs + 1):
        with tempfile.TemporaryDirectory() as folder:
            found = _run(Path(folder), seed)
        well = found['exit'] == 0 and found['form'] and not found['loud'] and not found['compiled']
        good += bool(well)
        print(json.dumps(found), flush=True)
    print(f'{good} of {arguments.runs} runs ended well beside {arguments.busy} busy loops')
    return 0 if good == arguments.runs else 1


if __name__ == '__main__':
    sys.exit(main())
