"""One sensor through the mode shape: the lateral amplitude from yaw, and how well."""

from __future__ import annotations

import numpy as np
import pytest
from signals_made import hunting_signal

from hunt_ros.dynamics.mode_shape import ModeShape
from hunt_ros.estimation.kalman import HuntingTracker

RATIO = -3.94 + 2.37j


def modes(ratio: complex = RATIO, std: float = 0.01) -> ModeShape:
    ratios = np.tile(ratio * np.array([0.9, 1.0, 1.0]), (2, 1))
    sizes = np.array([0.0, 1e-4, 1e-3])
    return ModeShape(np.array([6.0, 9.0]), sizes, np.full(2, 2.84), ratios, np.full((2, 3), std))


def known(ratio: complex = RATIO) -> HuntingTracker:
    tracker = HuntingTracker()
    tracker.set_modes(modes(ratio), 0.03)
    return tracker


@pytest.mark.parametrize('dead_from', [0.0, 2.0, 6.0])
def test_yaw_alone_tells_the_lateral_amplitude_through_a_known_shape(dead_from):
    for seed in range(3):
        signal = hunting_signal(seed, duration=14.0, kick_at=8.0, kick=3e-4, noise=5e-6)
        signal.lateral[signal.stamps * 1e-9 > dead_from] = np.nan
        rows, phasor = signal.track(known())
        last = rows[1000:]
        error = last['lateral_amplitude'] / np.abs(phasor[1000:]) - 1.0
        assert np.abs(error).mean() < 0.03
        assert (last['lateral_tied'] == 1.0).all()
        relative = last['lateral_amplitude_std'] / last['lateral_amplitude']
        assert relative.min() > 0.025  # the scale of the sensors is not known better
        assert relative.max() < 0.06


def test_the_error_of_a_ratio_learnt_on_noise_is_within_what_is_claimed():
    """Learnt on a small motion made by noise, used on a large one after a kick."""
    scores = []
    for seed in range(12):
        signal = hunting_signal(
            seed,
            duration=12.0,
            amplitude=1e-5,
            forcing=1e-10,
            noise=5e-6,
            kick_at=6.0,
            kick=4e-4,
            second=1e-4,
        )
        signal.lateral[signal.stamps > 4_000_000_000] = np.nan
        rows, phasor = signal.track(HuntingTracker())
        last = slice(1000, 1200)
        error = rows['lateral_amplitude'][last] - np.abs(phasor[last])
        scores.append(np.mean(error / rows['lateral_amplitude_std'][last]))
    assert np.sqrt(np.mean(np.square(scores))) < 1.6
    assert np.abs(scores).max() < 3.5


def test_an_offset_that_wanders_teaches_no_ratio_that_passes_for_known():
    """The lateral offset by 2 mm in 15 s, beside a motion of 15 um."""
    for seed in range(6):
        signal = hunting_signal(
            seed,
            duration=40.0,
            rate=200.0,
            amplitude=1.5e-5,
            forcing=2e-12,
            noise=2e-6,
            roughness=0.0,
        )
        signal.lateral += 2e-3 * np.sin(2.0 * np.pi * signal.stamps * 1e-9 / 60.0)
        rows, _ = signal.track(HuntingTracker())
        known = rows[rows['yaw_ratio_std'] < 0.5 * rows['yaw_ratio']]
        found = known['yaw_ratio'] * np.exp(1j * known['yaw_lag'])
        assert (np.abs(found - RATIO) < 5.0 * known['yaw_ratio_std']).all(), seed
        assert known.size > 2000, 'it is learnt from the motion, soon'


def test_a_ratio_learnt_in_this_run_carries_on_with_more_doubt_elsewhere():
    signal = hunting_signal(3, duration=16.0, kick_at=9.0, kick=4e-4, noise=5e-6)
    signal.lateral[signal.stamps > 7_000_000_000] = np.nan
    signal.speed[signal.stamps > 12_000_000_000] *= 1.3
    rows, phasor = signal.track(HuntingTracker())
    relative = rows['lateral_amplitude_std'] / rows['lateral_amplitude']
    error = np.abs(rows['lateral_amplitude'] / np.abs(phasor) - 1.0)
    same, elsewhere = slice(800, 890), slice(1250, 1600)
    assert error[same].max() < 0.05
    assert relative[same].max() < 0.08
    assert relative[elsewhere].min() > 0.1
    assert error[elsewhere].max() < 0.1


def test_a_shape_may_come_while_the_tracker_runs_and_go_again():
    signal = hunting_signal(4, duration=9.0, noise=5e-6)
    tracker, third, found = HuntingTracker(), 3_000_000_000, []
    for begin, shape in ((0, None), (third, modes()), (2 * third, None)):
        tracker.set_modes(shape, 0.03)
        part = (signal.stamps > begin) & (signal.stamps <= begin + third)
        rows = tracker.update(
            signal.stamps[part],
            np.ones(part.sum(), np.int8),
            signal.yaw[part],
            signal.angle[part],
            signal.speed[part],
            begin + np.arange(1, 301) * 10_000_000,
        )
        found.append(rows['lateral_amplitude'])
    amplitude = np.concatenate(found)
    assert np.isnan(amplitude[:300]).all()
    assert np.abs(amplitude[350:600] / 2e-4 - 1.0).max() < 0.05
    assert np.abs(amplitude[610:] / 2e-4 - 1.0).max() < 0.05  # what was known is kept


def test_a_shape_of_other_sensors_is_found_out():
    """The yaw sensor is scaled by 1.3 against the one the shape was measured with."""
    signal = hunting_signal(5, duration=30.0, noise=5e-6)
    signal.lateral[signal.stamps > 20_000_000_000] = np.nan
    rows, _ = signal.track(known(RATIO / 1.3))
    assert np.abs(rows['lateral_amplitude'][500:1900] / 2e-4 - 1.0).max() < 0.03
    assert np.abs(rows['lateral_amplitude'][2200:] / 2e-4 - 1.0).max() < 0.06


def test_modes_are_interpolated_over_speed_and_held_at_the_ends():
    none, ratio = np.zeros(1), np.array([[4.0], [4.0j]])
    shape = ModeShape(np.array([6.0, 8.0]), none, np.array([2.0, 3.0]), ratio, np.zeros((2, 1)))
    signal = hunting_signal(0, duration=1.0, amplitude=0.0, roughness=0.0)
    for speed, frequency in ((5.0, 2.0), (7.0, 2.5), (9.0, 3.0)):
        signal.speed = np.full(signal.stamps.size, speed)
        tracker = HuntingTracker()
        tracker.set_modes(shape)
        rows, _ = signal.track(tracker, sensors=(0,))
        # With nothing to learn from, the frequency is the nominal one of that speed.
        assert rows['frequency_hz'][16] == pytest.approx(frequency)
