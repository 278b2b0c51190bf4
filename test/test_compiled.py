"""With numba or without: the same numbers, and every numerical room still imports."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from hunt_ros.compiled import HAVE_COMPILER, compiled

BAG = Path(__file__).parents[1] / 'bags' / 'kick_decays'

#: Put before a script: from here on, numba is not there to be found.
HIDE_NUMBA = textwrap.dedent(
    """
    import sys
    from importlib.abc import MetaPathFinder

    class Hidden(MetaPathFinder):
        def find_spec(self, name, path=None, target=None):
            if name.partition('.')[0] == 'numba':
                raise ModuleNotFoundError(f'No module named {name!r}', name=name)
            return None

    sys.modules.pop('numba', None)
    sys.meta_path.insert(0, Hidden())
    import importlib.util
    real_find_spec = importlib.util.find_spec
    importlib.util.find_spec = (
        lambda name, package=None: None if name == 'numba' else real_find_spec(name, package)
    )
    """
)


def run(script: str, hide: bool) -> str:
    """Run a script in a Python of its own, with or without numba; return what it printed."""
    done = subprocess.run(
        [sys.executable, '-W', 'error::RuntimeWarning', '-c', HIDE_NUMBA * hide + script],
        capture_output=True,
        text=True,
        env={**os.environ, 'OMP_NUM_THREADS': '1'},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def decay(values: np.ndarray, factor: float) -> float:
    """Sum a recursive filter: an order of operations that a fast-math compiler would change."""
    state = 0.0
    total = 0.0
    for k in range(values.shape[0]):
        state = factor * state + values[k]
        total += state
    return total


def test_a_compiled_kernel_gives_the_numbers_of_plain_python() -> None:
    values = np.random.default_rng(1).standard_normal(1000)
    assert compiled(decay)(values, 0.99) == decay(values, 0.99)


def test_a_compiled_kernel_keeps_nan() -> None:
    assert np.isnan(compiled(decay)(np.array([1.0, np.nan, 1.0]), 0.5))


@pytest.mark.skipif(not HAVE_COMPILER, reason='numba is not installed')
def test_a_compiled_kernel_is_machine_code_where_numba_is_installed() -> None:
    assert compiled(decay) is not decay
    assert hasattr(compiled(decay), 'py_func')


IMPORT_EVERYTHING = textwrap.dedent(
    """
    import importlib, pkgutil
    import hunt_ros
    from hunt_ros.compiled import HAVE_COMPILER

    names = []
    for room in ('dynamics', 'estimation', 'analysis', 'detection', 'identification'):
        package = importlib.import_module(f'hunt_ros.{room}')
        names.append(package.__name__)
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):
            importlib.import_module(module.name)
            names.append(module.name)
    print(HAVE_COMPILER, 'numba' in sys.modules, len(names))
    """
)


def test_the_numerical_rooms_import_without_numba() -> None:
    compiler, loaded, modules = run(IMPORT_EVERYTHING, hide=True).split()
    assert (compiler, loaded) == ('False', 'False')
    assert int(modules) >= 5


def test_hiding_numba_is_what_makes_the_difference() -> None:
    """Guard of the tests here: if the hiding did nothing, they would prove nothing."""
    script = 'from hunt_ros.compiled import HAVE_COMPILER; print(HAVE_COMPILER)'
    assert run(script, hide=True).strip() == 'False'
    assert run(script, hide=False).strip() == str(HAVE_COMPILER)


ROOMS_WITHOUT_ROS = textwrap.dedent(
    """
    import importlib, pkgutil, sys
    for room in ('dynamics', 'estimation', 'analysis', 'detection', 'identification', 'report'):
        package = importlib.import_module(f'hunt_ros.{room}')
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):
            importlib.import_module(module.name)
    heavy = {'rclpy', 'rosbags', 'mcap', 'matplotlib', 'bokeh', 'dask', 'distributed', 'serial'}
    print(sorted(heavy & set(sys.modules)))
    """
)


def test_the_numerical_rooms_bring_in_no_ros_no_bag_and_no_plotting_library() -> None:
    assert run(ROOMS_WITHOUT_ROS, hide=False).strip() == '[]'


RUN_THE_CHAIN = textwrap.dedent(
    """
    import json
    from hunt_ros.compiled import HAVE_COMPILER
    from hunt_ros.detection import DetectorConfig, HuntingDetector, detect
    from hunt_ros.dynamics.identified import IdentifiedNormalForm
    from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
    from hunt_ros.dynamics.parameters import paper_rig
    from hunt_ros.dynamics.simulation import (
        Kick, Roughness, SensorModel, SimulationSettings, SpeedProfile, simulate,
    )

    settings = SimulationSettings(
        sample_rate_hz=100.0, initial_speed=7.2, roughness=Roughness((2e-5,)), broadband=8e-6,
        lateral_sensor=SensorModel(noise=5e-6), yaw_sensor=SensorModel(noise=2e-5),
    )
    record = simulate(
        paper_rig(), settings, SpeedProfile.constant(7.2), 6.0, [Kick(2.0, 3e-4)], seed=4
    )
    detector = HuntingDetector(DetectorConfig(), IdentifiedNormalForm(PAPER_NORMAL_FORM))
    rows = detect(detector, record).estimates
    print(json.dumps({
        'compiler': HAVE_COMPILER,
        'lateral': record['lateral'].values[::25].tolist(),
        'amplitude': [x if x == x else None for x in rows['lateral_amplitude'][::25].tolist()],
        'growth': [x if x == x else None for x in rows['growth_rate'][::25].tolist()],
        'level': rows['level'].tolist(),
    }))
    """
)


@pytest.mark.skipif(not HAVE_COMPILER, reason='numba is not installed: nothing to compare with')
def test_simulator_and_detector_give_the_same_numbers_without_numba() -> None:
    fast, plain = (json.loads(run(RUN_THE_CHAIN, hide)) for hide in (False, True))
    assert (fast.pop('compiler'), plain.pop('compiler')) == (True, False)
    assert fast.pop('level') == plain.pop('level')
    for name, numbers in fast.items():
        ours, theirs = (np.array(x, dtype=np.float64) for x in (numbers, plain[name]))
        assert np.isfinite(ours).sum() > 15, name
        # To rounding: the compiler may join a product and a sum (FMA).
        scale = np.nanmax(np.abs(ours))
        np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-9 * scale, err_msg=name)


KERNEL = """
from hunt_ros.compiled import compiled

@compiled
def twice(x):
    return 2.0 * x

@compiled
def thrice(x):
    return 3.0 * x

print(twice(1.0), thrice(1.0))
"""


@pytest.mark.skipif(not HAVE_COMPILER, reason='numba is not installed')
def test_where_nothing_can_be_written_kernels_work_and_one_line_says_so(tmp_path) -> None:
    """As in a source tree that is read-only, without a home; this holds for root too."""
    (tmp_path / 'kernel.py').write_text(KERNEL)
    (tmp_path / '__pycache__').write_text('a file where the folder should be')
    unset = ('NUMBA_CACHE_DIR', 'XDG_CACHE_HOME')
    env = {name: value for name, value in os.environ.items() if name not in unset}
    done = subprocess.run(
        [sys.executable, str(tmp_path / 'kernel.py')],
        capture_output=True,
        text=True,
        check=False,
        env={**env, 'HOME': os.devnull},
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == '2.0 3.0\n'
    (line,) = done.stderr.splitlines()
    assert 'NUMBA_CACHE_DIR' in line


@pytest.mark.skipif(not HAVE_COMPILER, reason='without numba nothing is kept on disk')
def test_machine_code_of_an_earlier_version_is_made_anew(tmp_path) -> None:
    kernel = textwrap.dedent(
        """
        from {module} import Pair
        from hunt_ros.compiled import compiled

        @compiled
        def total(pair):
            return pair.first + pair.second

        print(total(Pair(1.0, 2.0)), sum(total.stats.cache_hits.values()))
        """
    )
    fields = '[("first", float), ("second", float)]'
    pair = f'from typing import NamedTuple\nPair = NamedTuple("Pair", {fields})\n'
    script = f'import sys; sys.path.insert(0, {str(tmp_path)!r}); import kernels'

    def version(module: str) -> list[str]:
        (tmp_path / f'{module}.py').write_text(pair)
        (tmp_path / 'kernels.py').write_text(kernel.format(module=module))
        return run(script, hide=False).split()

    assert version('before') == ['3.0', '0']
    assert version('before') == ['3.0', '1']
    (tmp_path / 'before.py').unlink()
    assert version('later') == ['3.0', '0']
    assert version('later') == ['3.0', '1']


@pytest.mark.skipif(not HAVE_COMPILER, reason='without numba nothing is kept on disk')
@pytest.mark.parametrize('verb', ['replay', 'identify'])
def test_a_verb_that_ran_before_compiles_nothing(verb) -> None:
    """A part that Python calls would be compiled at every start, and be said each time."""
    words = [sys.executable, '-m', 'hunt_ros.cli.main', verb, str(BAG)]
    for _ in range(2):
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert done.returncode in (0, 1), done.stderr  # 1: no form
    if 'cannot be kept' in done.stderr:
        pytest.skip('nothing can be written here')
    assert 'compiling' not in done.stderr
