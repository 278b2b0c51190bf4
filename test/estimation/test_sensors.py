"""Further sensors of the motion, as rows of the tracker's measurements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from signals_made import hunting_signal

from hunt_ros.estimation.kalman import HuntingTracker, TrackerConfig
from hunt_ros.sensors import SENSORS as TABLE

SENSORS = tuple(own for own in TABLE if own.usual or own.name == 'axle_box')
THREE = TrackerConfig(sensors=SENSORS)
SEEDS = 6


def tracked(signals, config, sensors=(0, 1, 2), after_s=5.0):
    """Return, over all signals, error and deviation of the amplitude (relative), frequency, Hz."""
    found = []
    for signal in signals:
        rows, phasor = signal.track(HuntingTracker(config), sensors)
        late = rows['stamp_ns'] > after_s * 1e9
        size = np.abs(phasor[late])
        error = rows['lateral_amplitude'][late] / size - 1.0
        std = rows['lateral_amplitude_std'][late] / size
        found.append((error, std, rows['frequency_hz'][late]))
    return tuple(np.concatenate(column) for column in zip(*found, strict=True))


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.fixture(scope='module')
def signals():
    return [hunting_signal(seed, duration=9.0, rate=500) for seed in range(SEEDS)]


def test_an_acceleration_makes_the_amplitude_better(signals):
    without, _, _ = tracked(signals, TrackerConfig())
    error, std, _ = tracked(signals, THREE)
    assert rms(error) < rms(without)
    assert 0.5 < rms(error) / rms(std) < 1.5


@pytest.mark.parametrize('sensors', [(2,), (1, 2)])
def test_an_acceleration_alone_gives_the_lateral_amplitude(signals, sensors):
    error, std, frequency = tracked(signals, THREE, sensors)
    assert rms(error) < 0.06  # its scale is its own calibration, known to a few per cent
    assert rms(error) < 2.0 * rms(std)
    assert rms(frequency - 2.84) < 0.03


def test_a_wrong_scale_is_learnt_and_is_not_taken_for_another_frequency():
    wrong = [
        hunting_signal(seed, duration=9.0, rate=500, acceleration_scale=1.05)
        for seed in range(SEEDS)
    ]
    _, _, frequency = tracked(wrong, TrackerConfig())
    error, std, beside = tracked(wrong, THREE)
    assert rms(beside - 2.84) < 1.2 * rms(frequency - 2.84)
    assert rms(error) < 1.5 * rms(std)
    for signal in wrong:  # what was learnt of it holds when the displacement is gone
        gone = signal.stamps > 6_000_000_000
        signal.lateral[gone] = np.nan
    error, _, _ = tracked(wrong, THREE, (0, 2), after_s=7.0)
    assert rms(error) < 0.03


def test_on_a_rig_of_another_frequency_it_is_the_same_filter():
    """Half the frequency: the same samples in twice the time, accelerations a quarter."""
    fast = hunting_signal(1, duration=6.0, rate=500, acceleration_noise=8e-3)
    slow = replace(fast, stamps=2 * fast.stamps, acceleration=0.25 * fast.acceleration)
    slow.speed = 0.5 * fast.speed
    usual, _ = fast.track(HuntingTracker(THREE))
    half = TrackerConfig(1.42, 0.5, 3.0, sensors=SENSORS)
    rows, _ = slow.track(HuntingTracker(half), rate_hz=50)
    named = {'rtol': 1e-6, 'atol': 0.0}
    late = slice(300, None)
    np.testing.assert_allclose(
        rows['lateral_amplitude'][late], usual['lateral_amplitude'][late], **named
    )
