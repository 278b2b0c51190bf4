"""
Run tests as they would run on another machine.

    python test/elsewhere.py [--only NAME] [--fast]

Each imitation changes one thing: the instructions that a library may use, the cores, the load,
the clock and language of the system, or what may be written. The tests that could notice run in
it. Times are not judged.
"""

from __future__ import annotations

import argparse
import contextlib
import locale
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

#: Numbers that come out of long sums, of noise, and of eigenvectors.
NUMERICS = (
    'test/dynamics/test_covariance_root.py',
    'test/dynamics/test_linear_stability.py',
    'test/dynamics/simulation/test_simulation.py',
    'test/estimation/test_kalman.py',
    'test/analysis',
    'test/bag/test_golden_bags.py',
    'test/detection/test_no_form.py',
    'test/identification/test_silence.py',
    'test/test_streaming_contract.py',
)
GOLDEN = ('test/bag/test_golden_bags.py', 'test/analysis/test_poincare.py')
#: Texts, stamps and files.
TEXTS = (
    'test/bag/test_golden_bags.py',
    'test/bag/interchange/test_tables.py',
    'test/bag/test_columns.py',
    'test/cli',
    'test/report/test_numbers.py',
    'test/dynamics/test_identified.py',
)
NODES = ('test/nodes',)

#: A user who may write nowhere but in the folder for temporary files.
NOBODY = 'nobody'


class Unavailable(Exception):
    """This machine cannot imitate that; the message says why."""


@dataclass(frozen=True)
class Imitation:
    """
    Another machine.

    Parameters
    ----------
    name : str
        What `--only` selects.
    tests : tuple of str
        Files and folders that run in it.
    variables : mapping
        Environment; None removes a variable.
    prefix : callable
        Words before the command.
    beside : callable
        A context in which the tests run; it gives the tree they run in.
    fast : bool
        True if continuous integration runs it too.
    """

    name: str
    tests: tuple[str, ...]
    variables: Mapping[str, str | None] = field(default_factory=dict)
    prefix: Callable[[], list[str]] = list
    beside: Callable[[], contextlib.AbstractContextManager[Path]] = lambda: here()
    fast: bool = False


@contextlib.contextmanager
def here() -> Iterator[Path]:
    yield ROOT


@contextlib.contextmanager
def two_busy_loops() -> Iterator[Path]:
    loops = [subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(2)]
    try:
        yield ROOT
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


@contextlib.contextmanager
def read_only_tree() -> Iterator[Path]:
    """Copy the tree under version control to where this user, or nobody, cannot write."""
    with tempfile.TemporaryDirectory(prefix='hunt_ros_read_only_') as scratch:
        tree = Path(scratch) / 'tree'
        words = ['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard']
        listed = subprocess.run(words, cwd=ROOT, capture_output=True, check=True).stdout
        for name in filter(None, listed.decode().split('\0')):
            if (ROOT / name).is_file():
                (tree / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, tree / name)
        for path in [tree, *tree.rglob('*')]:
            path.chmod(0o555 if path.is_dir() else 0o444)
        Path(scratch).chmod(0o755)
        try:
            yield tree
        finally:
            for path in [tree, *tree.rglob('*')]:
                path.chmod(0o755 if path.is_dir() else 0o644)


def one_core() -> list[str]:
    if not shutil.which('taskset'):
        raise Unavailable('there is no taskset here')
    return ['taskset', '-c', str(min(os.sched_getaffinity(0)))]


def without_rights() -> list[str]:
    """To root nothing is read-only: become nobody."""
    if os.getuid() != 0:
        return []
    if not shutil.which('setpriv'):
        raise Unavailable('run by root, which may write everywhere, and there is no setpriv')
    words = ['setpriv', '--reuid', NOBODY, '--clear-groups', '--']
    # Not the program that is started alone, whose rights are those of root yet, but its own too.
    script = f'import subprocess; subprocess.run([{sys.executable!r}, "-c", ""], check=True)'
    runs = subprocess.run([*words, sys.executable, '-c', script], capture_output=True)
    if runs.returncode != 0:
        raise Unavailable(f'{NOBODY} may not run {Path(sys.executable).resolve()}')
    return words


def numpy_extras() -> str:
    """Return the instruction sets that numpy would use here and can do without."""
    from numpy._core import _multiarray_umath as core

    return ' '.join(name for name in core.__cpu_dispatch__ if core.__cpu_features__[name])


def comma_locale() -> str:
    """Return a locale that writes 3,14; C where there is none."""
    for name in ('de_DE.UTF-8', 'fr_FR.UTF-8', 'de_DE.utf8', 'fr_FR.utf8'):
        with contextlib.suppress(locale.Error):
            locale.setlocale(locale.LC_ALL, name)
            locale.setlocale(locale.LC_ALL, 'C')
            return name
    return 'C'


IMITATIONS = (
    Imitation('numba-generic', NUMERICS, {'NUMBA_CPU_NAME': 'generic'}),
    Imitation('numba-x86-64-v3', NUMERICS, {'NUMBA_CPU_NAME': 'x86-64-v3'}),
    Imitation('numpy-baseline', NUMERICS, {'NPY_DISABLE_CPU_FEATURES': numpy_extras()}),
    Imitation('openblas-haswell', NUMERICS, {'OPENBLAS_CORETYPE': 'Haswell'}),
    Imitation('openblas-prescott', GOLDEN, {'OPENBLAS_CORETYPE': 'Prescott'}, fast=True),
    Imitation('one-core', NODES, prefix=one_core),
    Imitation('busy', NODES, beside=two_busy_loops),
    Imitation('hash-seed', TEXTS, {'PYTHONHASHSEED': '4'}),
    Imitation('chatham', TEXTS, {'TZ': 'Pacific/Chatham', 'LC_ALL': 'C'}, fast=True),
    Imitation('comma', TEXTS, {'TZ': 'America/St_Johns', 'LC_ALL': comma_locale()}),
    Imitation(
        'read-only',
        (*GOLDEN, 'test/test_compiled.py'),
        {'HOME': None, 'PYTHONDONTWRITEBYTECODE': '1', 'XDG_CACHE_HOME': None},
        prefix=without_rights,
        beside=read_only_tree,
    ),
    Imitation('no-home', ('test/cli', 'test/nodes/test_sensor.py'), {'HOME': None}),
)


def environment(imitation: Imitation, scratch: Path) -> dict[str, str]:
    """Return this environment with the changes, and a place for the machine code they ask for."""
    changed = dict(os.environ)
    for name, value in imitation.variables.items():
        changed.pop(name, None)
        if value is not None:
            changed[name] = value
    if 'NUMBA_CPU_NAME' in imitation.variables:
        changed['NUMBA_CACHE_DIR'] = str(scratch / 'kernels')
    return changed


def run(imitation: Imitation) -> str:
    """Run the tests of one imitation; return 'passed', 'FAILED', or why it was skipped."""
    words = ['-m', 'pytest', '-p', 'no:cacheprovider', '--tb=short', '-m', 'not packaging']
    with tempfile.TemporaryDirectory(prefix='hunt_ros_elsewhere_') as scratch:
        Path(scratch).chmod(0o777)
        try:
            prefix = imitation.prefix()
        except Unavailable as reason:
            return f'skipped: {reason}'
        variables = environment(imitation, Path(scratch))
        with imitation.beside() as tree:
            variables['PYTHONPATH'] = str(tree)
            command = [*prefix, sys.executable, *words, f'--basetemp={scratch}/tests']
            code = subprocess.run([*command, *imitation.tests], cwd=tree, env=variables).returncode
    return 'passed' if code == 0 else 'FAILED'


def main() -> int:
    """Run what is asked for, and print a summary."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--only', choices=[one.name for one in IMITATIONS], help='this one')
    parser.add_argument('--fast', action='store_true', help='the part of continuous integration')
    arguments = parser.parse_args()
    chosen = [
        one
        for one in IMITATIONS
        if (arguments.only in (None, one.name)) and (one.fast or not arguments.fast)
    ]
    lines = []
    for imitation in chosen:
        print(f'==== {imitation.name}', flush=True)
        begin = time.monotonic()
        outcome = run(imitation)
        lines.append(f'{imitation.name:20} {time.monotonic() - begin:6.0f} s  {outcome}')
    print('\n'.join(['====', *lines]))
    return int(any(line.endswith('FAILED') for line in lines))


if __name__ == '__main__':
    sys.exit(main())
