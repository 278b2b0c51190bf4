"""With numba or without: the same numbers, and every numerical room still imports."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from hunt_ros.compiled import HAVE_COMPILER, compiled

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
        timeout=300,
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
