"""The algebra of the filter beside filterpy's matrices, which are made by differences."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from signals_made import hunting_signal

from hunt_ros.dynamics.mode_shape import ModeShape
from hunt_ros.estimation.kalman import HuntingTracker, TrackerConfig
from hunt_ros.estimation.tracker import algebra
from hunt_ros.estimation.tracker_config import Shaft
from hunt_ros.sensors import SENSORS


@pytest.fixture(scope='module')
def running():
    """Return two copies of a filter that has followed three sensors, a wheel with slip too."""
    shafts = (Shaft((1.0,)), Shaft((4.42,), 0.005))
    tracker = HuntingTracker(TrackerConfig(sensors=SENSORS, shafts=shafts))
    none, ratio = np.zeros(1), np.full((1, 1), 4.6 * np.exp(2.6j))
    tracker.set_modes(ModeShape(none, none, np.array([2.84]), ratio, np.zeros((1, 1))))
    hunting_signal(0, duration=3.0, rate=500, noise=1e-6, acceleration_noise=1e-3).track(tracker)
    filters = tracker._tracker.filters
    filters[1] = filters[0]
    return filters[0], filters[1]


def differences(f, copy, of):
    """Return the Jacobian of what `of` makes of the state of a filter."""
    n = f.states
    steps = 1e-4 * np.sqrt(np.diag(f.P)[:n]) + 1e-12
    columns = []
    for i, step in enumerate(steps):
        sides = []
        for sign in (1.0, -1.0):
            copy.x[:], copy.P[:] = f.x, f.P
            copy.x[i] += sign * step
            sides.append(np.array(of(copy), dtype=float))
        columns.append((sides[0] - sides[1]) / (2.0 * step))
    return np.stack(columns, axis=-1)


def textbook(f):
    """Return filterpy's filter in the state of ours."""
    kf = KalmanFilter(dim_x=f.states, dim_z=1)
    kf.x, kf.P = f.x[: f.states].reshape(-1, 1).copy(), f.P[: f.states, : f.states].copy()
    return kf


def assert_same_covariance(f, expected):
    root = np.sqrt(np.diag(expected))
    off = (f.P[: f.states, : f.states] - expected) / np.outer(root, root)
    assert np.abs(off).max() < 1e-4


def test_a_prediction_is_that_of_the_textbook(running):
    f, copy = running

    def moved(one):
        algebra.predict(one, 0.02)
        return one.x[: one.states].copy()

    F = differences(f, copy, moved)
    kf = textbook(f)
    kf.predict(F=F, Q=np.zeros_like(kf.P))
    copy.x[:], copy.P[:] = f.x, f.P
    z = complex(f.x[0], f.x[1]) * np.exp(complex(f.x[5], f.x[4]) * 0.02)
    assert moved(copy)[:2] == pytest.approx([z.real, z.imag], rel=1e-12)
    assert_same_covariance(copy, kf.P)


@pytest.mark.parametrize('k', range(3))
def test_a_correction_is_that_of_the_textbook(running, k):
    f, copy = running
    f.row.averaged, lines = 0.99, 2 * f.line_count
    f.row.value[:lines] = copy.row.value[:lines] = np.linspace(-0.5, 0.8, lines)
    copy.row.averaged = 0.99

    def reading(one):
        algebra.aim(one, k)
        return algebra.expected(one, one.row.direct)

    H = differences(f, copy, reading)[None, :]
    kf, noise = textbook(f), f.sensors[k].noise
    copy.x[:], copy.P[:] = f.x, f.P
    off = 3.0 * np.sqrt(noise)
    reading(copy)
    kf.update(off + float(H[0] @ kf.x[:, 0]), R=noise, H=H)
    algebra.correct(copy, off, algebra.project(copy) + noise)
    root = np.sqrt(np.diag(kf.P))
    assert np.abs((copy.x[: f.states] - kf.x[:, 0]) / root).max() < 1e-3
    assert_same_covariance(copy, kf.P)


def test_covariance_stays_symmetric_and_positive():
    signal = hunting_signal(2, duration=20.0, rate=500, kick_at=8.0, kick=5e-3, noise=1e-6)
    signal.lateral[5000:5400] += 1.0  # an absurd step, and back
    tracker = HuntingTracker()
    signal.track(tracker)
    f = tracker._tracker.filters[tracker._tracker.lead]
    P = f.P[: f.states, : f.states]
    assert np.array_equal(P, P.T)
    scale = np.sqrt(np.diag(P))
    assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > -1e-9


def test_the_mean_of_a_bin_is_as_good_as_its_samples():
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
