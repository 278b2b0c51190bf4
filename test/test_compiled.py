"""With numba or without: the same numbers, and every numerical room still imports."""

from __future__ import annotations

import json
import os
import shutil
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from made import python

from hunt_ros.compiled import F1, HAVE_COMPILER, compile_all, compiled

ROOT = Path(__file__).parents[1]
BAG = ROOT / 'bags' / 'kick_decays'
needs_numba = pytest.mark.skipif(not HAVE_COMPILER, reason='numba is not installed')

#: Put before a script: from here on, numba is not there to be found.
HIDE_NUMBA = "import sys; sys.modules['numba'] = None\n"


def run(script: str, hide: bool) -> str:
    """Run a script in a Python of its own, with or without numba; return what it printed."""
    words = ['-W', 'error::RuntimeWarning', '-c', HIDE_NUMBA * hide + script]
    return python(*words, OMP_NUM_THREADS='1').stdout


def decay(values: F1, factor: float) -> float:
    """Sum a recursive filter: an order of operations that a fast-math compiler would change."""
    state = 0.0
    total = 0.0
    for k in range(values.shape[0]):
        state = factor * state + values[k]
        total += state
    return total


def test_a_compiled_kernel_gives_the_numbers_of_plain_python_and_keeps_nan() -> None:
    values = np.random.default_rng(1).standard_normal(1000)
    assert compiled(decay)(values, 0.99) == decay(values, 0.99)
    assert np.isnan(compiled(decay)(np.array([1.0, np.nan, 1.0]), 0.5))
    assert hasattr(compiled(decay), 'py_func') is HAVE_COMPILER


RUN_THE_CHAIN = textwrap.dedent(
    """
    import importlib, json, pkgutil, sys
    import numpy as np
    for room in ('dynamics', 'estimation', 'analysis', 'detection', 'identification'):
        package = importlib.import_module(f'hunt_ros.{room}')
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):
            importlib.import_module(module.name)
    from hunt_ros.compiled import HAVE_COMPILER
    from hunt_ros.detection import DetectorConfig, HuntingDetector, detect
    from hunt_ros.dynamics.growth_law import lawful
    from hunt_ros.dynamics.identified import IdentifiedNormalForm
    from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
    from hunt_ros.dynamics.parameters import paper_rig
    from hunt_ros.dynamics.profile import Hold, Profile
    from hunt_ros.identification.likelihood.path import Path
    from hunt_ros.identification.likelihood.path_likelihood import innovations
    from hunt_ros.dynamics.simulation import (
        Kick, Roughness, SensorModel, SimulationSettings, simulate,
    )

    settings = SimulationSettings(
        sample_rate_hz=100.0, initial_speed=7.2, roughness=Roughness((2e-5,)), broadband=8e-6,
        lateral_sensor=SensorModel(noise=5e-6), yaw_sensor=SensorModel(noise=2e-5),
    )
    record = simulate(
        paper_rig(), settings, Profile((Hold(7.2, 0.0),)), 6.0, [Kick(2.0, 3e-4)], seed=4
    )
    detector = HuntingDetector(DetectorConfig(), IdentifiedNormalForm(PAPER_NORMAL_FORM))
    rows = detect(detector, record).estimates
    law = lawful([-0.24, 3.09, -1.33, 2.78, -0.45, -2.95])
    theta = np.concatenate([law, [0.0, 0.0, -8.0, -12.0, -20.0]])
    n = np.arange(12)
    phasor = (0.3 + 0.02 * n) * np.exp(0.1j * n)
    path = Path(0.5 * n, 0.01 * n, phasor, n == 0, 0.03, 0.2, 0.1, line=np.full(12, 0.01))
    print(json.dumps({
        'compiler': [HAVE_COMPILER, sys.modules.get('numba') is not None],
        'lateral': record['lateral'].values[::25].tolist(),
        'amplitude': [x if x == x else None for x in rows['lateral_amplitude'][::25].tolist()],
        'growth': [x if x == x else None for x in rows['growth_rate'][::25].tolist()],
        'level': rows['level'].tolist(),
        'innovations': innovations(theta, path).ravel().tolist(),
    }))
    """
)


@needs_numba
def test_simulator_and_detector_give_the_same_numbers_without_numba() -> None:
    """Every module of the numerical rooms can be imported without it, too."""
    fast, plain = (json.loads(run(RUN_THE_CHAIN, hide)) for hide in (False, True))
    assert (fast.pop('compiler'), plain.pop('compiler')) == ([True, True], [False, False])
    assert fast.pop('level') == plain.pop('level')
    for name, numbers in fast.items():
        ours, theirs = (np.array(x, dtype=np.float64) for x in (numbers, plain[name]))
        assert np.isfinite(ours).sum() > 15, name
        # To rounding: the compiler may join a product and a sum (FMA).
        scale = np.nanmax(np.abs(ours))
        np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-9 * scale, err_msg=name)


@needs_numba
def test_a_kernel_has_one_signature() -> None:
    kernel = compiled(decay)
    assert kernel(np.ones(3), 1) == 6.0  # an int is a float
    assert len(kernel.signatures) == 1
    with pytest.raises(TypeError, match='No matching definition'):
        kernel(np.ones(3, dtype=np.float32), 1.0)


KERNEL = """
from typing import NamedTuple
from hunt_ros.compiled import compiled, on_compilation
from part import FACTOR, Pair, half

@compiled
def total(pair: Pair) -> float:
    return FACTOR * half(pair.first) + pair.second

on_compilation(lambda text: print('compiling'))
print(total(Pair(2.0, 3.0)))
"""

PART = """
from typing import NamedTuple
from hunt_ros.compiled import compiled_part

FACTOR = 1.0
Pair = NamedTuple('Pair', [('first', float), ('second', float)])

@compiled_part
def half(x: float) -> float:
    return 0.5 * x
"""


def copy_of_the_package(to: Path) -> None:
    """Copy the package, without any machine code."""
    without = shutil.ignore_patterns('machine_code')
    shutil.copytree(ROOT / 'hunt_ros', to / 'hunt_ros', ignore=without)


def total(folder: Path, part: str = PART, kernel: str = KERNEL, **environment: str) -> list[str]:
    """Write the kernel above and its part, run it, and return the lines that it prints."""
    (folder / 'part.py').write_text(part)
    (folder / 'kernel.py').write_text(kernel)
    cache = {'NUMBA_CACHE_DIR': str(folder / 'cache')}
    done = python(folder / 'kernel.py', **cache | environment)
    return done.stdout.splitlines() + done.stderr.splitlines()


@needs_numba
def test_machine_code_is_kept_by_content(tmp_path) -> None:
    assert total(tmp_path) == ['compiling', '4.0']
    assert total(tmp_path) == ['4.0']
    for path in tmp_path.glob('*.py'):
        os.utime(path, (1.0, 1.0))
    assert total(tmp_path) == ['4.0']
    assert total(tmp_path, PART.replace('0.5', '0.25')) == ['compiling', '3.5']
    assert total(tmp_path, PART.replace('FACTOR = 1.0', 'FACTOR = 2.0')) == ['compiling', '5.0']


@needs_numba
def test_damaged_machine_code_is_made_anew(tmp_path) -> None:
    total(tmp_path)
    for path in (tmp_path / 'cache').rglob('*.code'):
        path.write_bytes(path.read_bytes()[:100])
    live = 'import hunt_ros.compiled as c; c._may_compile = False\nprint(total'
    assert total(tmp_path, kernel=KERNEL.replace('print(total', live)) == ['compiling', '4.0']
    assert not list((tmp_path / 'cache').rglob('*.code')), 'no live process compiles'
    assert total(tmp_path) == ['compiling', '4.0']
    assert total(tmp_path) == ['4.0']


@needs_numba
def test_where_nothing_can_be_written_kernels_work_and_one_line_says_so(tmp_path) -> None:
    """As in a source tree that is read-only, without a home; this holds for root too."""
    tree = tmp_path / 'tree'
    copy_of_the_package(tree)
    (tree / 'hunt_ros' / 'machine_code').write_text('a file where the folder should be')
    nowhere = {'NUMBA_CACHE_DIR': os.devnull, 'XDG_CACHE_HOME': os.devnull}
    *lines, last = total(tmp_path, PYTHONPATH=str(tree), **nowhere)
    assert lines == ['compiling', '4.0']
    assert 'NUMBA_CACHE_DIR' in last
    words = ['-m', 'hunt_ros.cli.main', 'compile']
    done = python(*words, cwd=tree, code=1, PYTHONPATH=str(tree), **nowhere)
    assert 'NUMBA_CACHE_DIR' in done.stderr


@needs_numba
def test_every_kernel_is_compiled_ahead_and_a_copy_of_the_package_finds_it(tmp_path) -> None:
    """As in a wheel or a container: another path, other dates."""
    compile_all()
    shutil.copytree(ROOT / 'hunt_ros', tmp_path / 'hunt_ros')
    # As after a change that took a kernel away: its machine code goes.
    folder = tmp_path / 'hunt_ros' / 'machine_code'
    for path in folder.glob('*.complete'):
        path.unlink()
    (gone := folder / f'hunt_ros.room.gone.{sys.implementation.cache_tag}.0.code').touch()
    script = 'import hunt_ros.compiled as c; print(c.__file__, c.compile_all(), c.is_complete())'
    place = {'PYTHONPATH': str(tmp_path), 'XDG_CACHE_HOME': str(tmp_path)}
    done = python('-c', script, cwd=tmp_path, **place)
    assert done.stdout.split() == [str(tmp_path / 'hunt_ros' / 'compiled.py'), '0', 'True']
    assert not gone.exists()


LIVE = """
import numpy as np
import hunt_ros.compiled as c
c.serve_live(print)
from hunt_ros.estimation.turning import Unwrapping
Unwrapping().update(np.arange(3), np.arange(3) / 10.0)
print(c.runs_compiled(), len(c.KERNELS))
"""


@needs_numba
def test_a_live_process_compiles_nothing(tmp_path) -> None:
    tree = tmp_path / 'tree'
    copy_of_the_package(tree)
    place = {'PYTHONPATH': str(tree), 'XDG_CACHE_HOME': str(tmp_path / 'home')}
    done = python('-c', LIVE, cwd=tree, **place)
    said, last = done.stdout.splitlines()
    assert 'not compiled' in said
    assert 'hunt compile' in said
    assert last == 'False 0'
    assert not list(tmp_path.rglob('*.code'))


def test_a_verb_works_with_the_compiler_switched_off() -> None:
    words = ['-m', 'hunt_ros.cli.main', 'replay', BAG]
    done = python(*words, code=None, NUMBA_DISABLE_JIT='1')
    assert done.returncode in (0, 1), done.stderr  # 1: no form
    assert 'Traceback' not in done.stderr


@needs_numba
@pytest.mark.parametrize('verb', ['replay', 'identify'])
def test_a_verb_compiles_nothing_where_hunt_compile_has_run(verb) -> None:
    compile_all()
    done = python('-m', 'hunt_ros.cli.main', verb, BAG, code=None)
    assert done.returncode in (0, 1), done.stderr  # 1: no form
    assert 'compiling' not in done.stderr


#: Limits set while it runs, criteria, a forecast, a form accepted, each channel missing once.
ALL_WAYS = """
import sys
from dataclasses import replace
import hunt_ros.compiled as c
said = []
c.serve_live(said.append)
from hunt_ros.criteria import CRITERIA
from hunt_ros.detection import DetectorConfig, HuntingDetector
from hunt_ros.detection.companions import CompanionConfig, Companions
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.errors import ConfigError
from hunt_ros.dynamics.profile import Hold, Profile
from hunt_ros.dynamics.simulation import Kick, SimulationSettings, simulate

settings = SimulationSettings(sample_rate_hz=100.0, initial_speed=7.2, broadband=8e-6)
kicks = [Kick(5.0, lateral_m=3e-4)]
record = simulate(paper_rig(), settings, Profile((Hold(7.2, 0.0),)), 40.0, kicks, seed=1)
form = IdentifiedNormalForm(PAPER_NORMAL_FORM)
channels = ('lateral', 'yaw', 'roller', 'speed')
for missing in ('', *channels):
    used = tuple(name for name in channels if name != missing)
    try:
        config = DetectorConfig(channels=used, roller_diameter_m=0.6)
    except ConfigError:
        continue  # it is needed
    detector = HuntingDetector(config)
    criteria = tuple(CRITERIA) if 'lateral' in used else ()
    companions = Companions(CompanionConfig(criteria=criteria), config)
    for begin_s in range(40):
        if begin_s == 10:
            config = replace(config, alarm_lateral_mm=0.1, warn_acceleration_mps2=0.1)
            detector.reconfigure(config)
        if begin_s == 20:
            detector.set_normal_form(form)
        for name in used:
            channel = record[name]
            second = channel.stamps_ns // 1_000_000_000
            part = second - second[0] == begin_s
            output = detector.update(name, channel.stamps_ns[part], channel.values[part])
            companions.update(output.motion)
assert len(c.KERNELS) > 10, c.KERNELS
c.load()
c.load()
print(c.runs_compiled(), said)
"""


@needs_numba
def test_no_way_through_a_live_detector_meets_a_kernel_that_is_not_compiled() -> None:
    compile_all()
    assert run(ALL_WAYS, hide=False).strip() == 'True []'


@needs_numba
def test_compiling_does_not_run_the_program_that_asks_once_more(tmp_path) -> None:
    """It ran in each process of the pool, waited for the lock there, and that for ever."""
    program = tmp_path / 'program.py'
    program.write_text(
        textwrap.dedent("""
            print('runs', flush=True)
            import hunt_ros.estimation.turning
            from hunt_ros import compiled

            compiled.is_complete = lambda: False
            compiled._kernel_files = list
            compiled._find = lambda name: None
            compiled._write = lambda name, content: compiled._PACKAGE
            compiled._sources = str
            compiled._TAG = 'none'  # no kernel is gone
            print(compiled.compile_all(), 'compiled')
        """)
    )
    told = python(str(program)).stdout
    assert told.split('\n')[:1] == ['runs']
    assert told.count('runs') == 1
    assert told.rstrip().endswith('compiled')
