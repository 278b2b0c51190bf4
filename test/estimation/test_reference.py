"""The compiled kernel, the same as plain Python, and the same on filterpy's matrices."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from textbook_tracker import PlainTracker, ReferenceTracker

from hunt_ros.compiled import HAVE_COMPILER
from hunt_ros.estimation.kalman import HuntingTracker, ModePoint, TrackerConfig
from hunt_ros.sensors import SENSORS

GIVEN = ModePoint(0.0, 2.84, 3.3, 9.4, 4.6 * np.exp(2.6j), 5.0 - 3.0j, second_std=0.5)
CONFIGS = [
    TrackerConfig(),
    TrackerConfig(modes=(GIVEN,), bin_s=0.0),
    TrackerConfig(sensors=SENSORS[:3]),
]


def assert_same(rows, other, tolerance):
    for name in rows.dtype.names[1:]:
        a, b = rows[name], other[name]
        assert np.array_equal(np.isnan(a), np.isnan(b)), name
        finite = np.isfinite(a)
        if finite.any():
            scale = np.abs(a[finite]).max() + 1e-300
            assert np.abs(a[finite] - b[finite]).max() <= tolerance * scale, name


@pytest.mark.parametrize('config', CONFIGS, ids=['learnt', 'given', 'with an acceleration'])
def test_kernel_and_filterpy_give_the_same_numbers(hunting_signal, config):
    signal = hunting_signal(
        0, duration=3.5, rate=500, kick_at=2.5, kick=3e-4, second=2e-4, noise=5e-6
    )
    signal.lateral[100:140] = np.nan
    rows, _ = signal.track(HuntingTracker(config))
    reference, _ = signal.track(ReferenceTracker(config))
    assert_same(rows, reference, 1e-7)


@pytest.mark.skipif(not HAVE_COMPILER, reason='numba is not installed')
def test_compiled_and_plain_python_give_the_same_numbers(hunting_signal):
    signal = hunting_signal(1, duration=2.5, rate=250, kick_at=1.5, kick=3e-4)
    rows, _ = signal.track(HuntingTracker())
    plain, _ = signal.track(PlainTracker())
    assert_same(rows, plain, 1e-9)


def test_it_runs_without_the_compiler():
    program = """
import importlib.util as util
find = util.find_spec
util.find_spec = lambda name, *rest: None if name == 'numba' else find(name, *rest)
import sys
import numpy as np
from hunt_ros.estimation import HuntingTracker, HilbertEnvelope
stamps = np.arange(1, 401) * 4_000_000
wave = np.cos(17.8e-9 * stamps) + 0.01 * np.random.default_rng(0).normal(size=400)
none = np.full(400, np.nan)
rows = HuntingTracker().update(stamps, np.zeros(400, np.int8), wave, none, none, stamps[9::10])
assert abs(rows['lateral_amplitude'][-1] - 1.0) < 0.02, rows['lateral_amplitude'][-1]
assert np.isfinite(HilbertEnvelope(250.0).update(wave)[-1])
assert 'numba' not in sys.modules
"""
    subprocess.run([sys.executable, '-c', program], check=True, timeout=60)


def test_covariance_stays_symmetric_and_positive(hunting_signal):
    signal = hunting_signal(2, duration=20.0, rate=500, kick_at=8.0, kick=5e-3, noise=1e-6)
    signal.lateral[5000:5400] += 1.0  # an absurd step, and back
    tracker = HuntingTracker()
    signal.track(tracker)
    P = tracker.covariance
    assert np.array_equal(P, P.T)
    scale = np.sqrt(np.diag(P))
    assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > -1e-9
    assert tracker._filter.resets == 0


def test_the_mean_of_a_bin_is_as_good_as_its_samples(hunting_signal):
    errors = {0.0: [], 0.005: []}
    for seed in range(3):
        signal = hunting_signal(seed, duration=6.0, kick_at=4.0, kick=1e-4, frequency=5.5)
        for bin_s, found in errors.items():
            config = TrackerConfig(bin_s=bin_s, frequency_hz=5.5, frequency_max_hz=8.0)
            rows, phasor = signal.track(HuntingTracker(config))
            found.append((rows['lateral_amplitude'] / np.abs(phasor) - 1.0)[420:])
    fine, coarse = np.array(errors[0.0]), np.array(errors[0.005])
    assert abs(coarse.mean() - fine.mean()) < 0.002
    assert coarse.std() < 1.1 * fine.std() + 1e-4
