"""Levels that step and wrong samples are no motion; what is hit moves, what repeats is stuck."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made import held, record_of, rig_settings

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, detect, health
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import Kick, simulate

RATE, END_S, STEP_S = 200.0, 13.0, 8.0
AMPLITUDE, NOISE = 0.2e-3, 5e-6
#: Yaw over lateral phasor, rad/m.
RATIO = -3.94 + 2.37j
CONFIG = DetectorConfig(channels=('lateral', 'yaw', 'speed'))
#: Of one sensor alone, m: what its readings step by.
RESOLUTION, ALONE = 1e-6, DetectorConfig(channels=('lateral', 'speed'))


def signals(seed: int) -> tuple[np.ndarray, dict[str, np.ndarray], np.random.Generator]:
    """Return seconds, and what both sensors read of a steady motion."""
    rng = np.random.default_rng(seed)
    t = (np.arange(round(END_S * RATE)) + 1) / RATE
    turn = AMPLITUDE * np.exp(2j * np.pi * (2.84 * t + rng.random()))
    lateral = turn.real + NOISE * rng.normal(size=t.size)
    yaw = (RATIO * turn).real + 5.0 * NOISE * rng.normal(size=t.size)
    return t, {'lateral': lateral, 'yaw': yaw}, rng


def errors(t: np.ndarray, values: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return seconds of the rows, and the relative error of the lateral amplitude."""
    rows = detect(HuntingDetector(CONFIG), record_of(t, **values, speed=7.2)).estimates
    return rows['stamp_ns'] * 1e-9, rows['lateral_amplitude'] / AMPLITUDE - 1.0


@pytest.mark.parametrize('step_m', [0.2e-3, 10e-3])
@pytest.mark.parametrize('sensors', [('lateral',), ('yaw',), ('lateral', 'yaw')], ids='+'.join)
def test_a_level_that_steps_is_no_motion(sensors: tuple[str, ...], step_m: float) -> None:
    for seed in range(2):
        t, values, rng = signals(seed)
        for name in sensors:
            scale = 1.0 if name == 'lateral' else abs(RATIO)
            values[name][t > STEP_S + 0.35 * rng.random()] += scale * step_m
        seconds, error = errors(t, values)
        late = (seconds > 5.0) & (seconds < STEP_S) | (seconds > STEP_S + 0.65)
        assert np.abs(error[late]).max() < 0.05


@pytest.mark.parametrize('share', [0.01, 0.05])
@pytest.mark.parametrize('size_m', [AMPLITUDE, 5e-3])
def test_samples_that_are_wrong_are_left_out(share: float, size_m: float) -> None:
    found = []
    for seed in range(4):
        t, values, rng = signals(seed)
        for name, scale in (('lateral', 1.0), ('yaw', abs(RATIO))):
            wrong = rng.random(t.size) < share
            values[name][wrong] += scale * size_m * rng.normal(size=wrong.sum())
        seconds, error = errors(t, values)
        found.append(error[seconds > 5.0])
    assert np.mean(np.abs(found) > 0.05) < 0.002


#: Ways to hit a wheelset: what one blow adds, by its size in m. Set aside it stands still at
#: first, as a level that has stepped does for ever.
WAYS = {
    'aside': lambda size: Kick(STEP_S, lateral_m=size),
    'turned': lambda size: Kick(STEP_S, yaw_rad=4.5 * size),
    'pushed': lambda size: Kick(STEP_S, lateral_velocity=18.0 * size),
    'spun': lambda size: Kick(STEP_S, yaw_rate=80.0 * size),
}


@pytest.mark.parametrize('way', WAYS)
def test_a_wheelset_that_was_hit_moves(way: str) -> None:
    off = []
    for seed, size in enumerate((1e-4, 1.5e-4, 2.5e-4, 4e-4) * 3):
        blow = (WAYS[way](size),)
        record = simulate(
            paper_rig(), rig_settings(500.0, 4e-7), held(7.2), STEP_S + 1.5, blow, seed
        )
        rows = detect(HuntingDetector(), record).estimates
        # A period, in which the second mode is nearly gone.
        seconds, lateral = 1e-9 * record['lateral'].stamps_ns, record['lateral'].values
        whole = (seconds > STEP_S + 0.25) & (seconds < STEP_S + 0.25 + 1.0 / 2.84)
        told = (rows['stamp_ns'] > seconds[whole][0] * 1e9) & (
            rows['stamp_ns'] < seconds[whole][-1] * 1e9
        )
        moved = np.sqrt(2.0) * lateral[whole].std()
        off.append(np.mean(rows['lateral_amplitude'][told]) / moved - 1.0)
    assert np.mean(np.abs(off) < 0.15) > 0.9


# --- a reading that repeats says something only where the motion exceeds its steps ------------


def stuck(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return seconds and True where the lateral sensor is said to be stuck, at the rows."""
    record = record_of((np.arange(values.size) + 1) / RATE, lateral=values, speed=6.0)
    rows = detect(HuntingDetector(ALONE), record).estimates
    wrong = (rows['lateral_wrong'] & health.STUCK) != 0
    assert (rows['level'][wrong] == Level.STALE).all()
    return rows['stamp_ns'] * 1e-9, wrong


def read(motion: np.ndarray, seed: int = 0, noise: float = 0.1 * RESOLUTION) -> np.ndarray:
    """Return what a sensor with steps reads of a motion, m."""
    noisy = motion + noise * np.random.default_rng(seed).standard_normal(motion.size)
    return RESOLUTION * np.round(noisy / RESOLUTION)


@pytest.mark.parametrize('offset', [0.1, 0.25, 0.4, 0.5])
@pytest.mark.parametrize('amplitude', [0.0, 0.3, 0.6])
def test_a_sensor_with_coarse_steps_at_rest_is_not_stuck(offset: float, amplitude: float) -> None:
    t = np.arange(round(20.0 * RATE)) / RATE
    # It moved before it came to rest: what its steps are is known from that.
    motion = RESOLUTION * (offset + 30.0 * np.exp(-2.0 * t) * np.cos(17.8 * t))
    values = read(motion + amplitude * RESOLUTION * np.cos(17.8 * t))
    seconds, wrong = stuck(values)
    assert not wrong[seconds > 1.0].any()


@pytest.mark.parametrize('noise', [0.1, 1.5])
def test_a_sensor_that_stops_in_the_middle_of_a_motion_is_stuck(noise: float) -> None:
    t = np.arange(round(10.0 * RATE)) / RATE
    values = read(20.0 * RESOLUTION * np.cos(17.8 * t), noise=noise * RESOLUTION)
    values[t > 6.0] = values[np.flatnonzero(t > 6.0)[0]]
    seconds, wrong = stuck(values)
    assert not wrong[seconds < 6.0].any()
    assert wrong[seconds > 6.3].all()


def test_a_slow_motion_of_few_steps_rests_at_its_top_and_is_not_stuck() -> None:
    t = np.arange(round(40.0 * RATE)) / RATE
    values = read(5.0 * RESOLUTION * np.cos(2.0 * np.pi * 0.5 * t), noise=0.0)
    config = replace(ALONE, hunting_frequency_hz=0.5)
    rows = detect(HuntingDetector(config), record_of(t + 1.0 / RATE, lateral=values, speed=6.0))
    assert not (rows.estimates['lateral_wrong'] & health.STUCK).any()


def test_a_sensor_that_never_moved_is_not_believed() -> None:
    seconds, wrong = stuck(np.zeros(round(5.0 * RATE)))
    assert wrong[seconds > 0.3].all()
