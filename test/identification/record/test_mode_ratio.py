"""The ratio of yaw to lateral, read off windows of both sensors: against linear theory."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made import changed, rig_settings

from hunt_ros.dynamics.linear_stability import critical_speed, hunting_mode
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Hold, Profile
from hunt_ros.dynamics.simulation import simulate
from hunt_ros.identification.preparation import Recording, runs_in
from hunt_ros.identification.record.mode_ratio import RATIO, measured_ratio
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.samples import Record, Series

LEVELS = 0.75, 0.8, 0.85, 0.9, 0.95
SETTINGS = rig_settings(200.0, roughness=(20e-6, 10e-6))


def quiet(**changes: Any) -> Record:
    """Return a staircase below the critical speed, on which nothing but noise moves."""
    v_c = critical_speed(paper_rig())
    profile = Profile(tuple(Hold(v_c * level, 60.0, 1.0) for level in LEVELS))
    return simulate(paper_rig(), replace(SETTINGS, **changes), profile, seed=0)


def windows_of(record: Record, frequency_hz: float = 2.8) -> np.ndarray:
    """Return the ratio in all windows of a record."""
    runs, _ = runs_in(Recording(record, 1, IdentificationSettings()), frequency_hz, 0.0)
    return np.concatenate([np.zeros(0, RATIO), *(measured_ratio(run.seen) for run in runs)])


@pytest.fixture(scope='module')
def record() -> Record:
    return quiet()


def test_a_sensor_that_stands_still_tells_nothing(record) -> None:
    for name in ('lateral', 'yaw'):
        for level in (0.0, 0.01):
            assert windows_of(changed(record, **{name: level})).size == 0


def test_a_rig_in_reverse_and_stamps_out_of_order_say_the_same(record) -> None:
    expected = windows_of(record)
    rng = np.random.default_rng(0)
    shuffled = {}
    for name, one in record.items():
        order = rng.permutation(len(one))
        shuffled[name] = Series(one.stamps_ns[order], one.values[order])
    backward = changed(record, speed=np.negative, roller=np.negative)
    for other in (Record(shuffled), backward):
        found = windows_of(other)
        assert np.allclose(found['ratio'], expected['ratio'], rtol=1e-6)
        assert np.allclose(found['speed'], expected['speed'], rtol=1e-6)


def test_a_long_pause_costs_neither_memory_nor_windows(record) -> None:
    whole = windows_of(record)
    middle = int(np.mean([one.stamps_ns.mean() for one in record.values()]))
    later = {
        name: Series(one.stamps_ns + (one.stamps_ns > middle) * 30 * 86_400 * 10**9, one.values)
        for name, one in record.items()
    }
    assert abs(windows_of(Record(later)).size - whole.size) <= 3


@pytest.mark.parametrize('every', [1, 5, 8])
def test_sensors_of_other_rates_and_stamps_see_one_motion(every: int) -> None:
    """500 samples a second, the yaw sensor fewer and later: down to four in three cells."""
    rig = paper_rig()
    frequency = hunting_mode(rig, critical_speed(rig)).frequency_hz
    full = quiet(sample_rate_hz=500.0)
    yaw = Series(
        full['yaw'].stamps_ns[every // 2 :: every], full['yaw'].values[every // 2 :: every]
    )
    windows = windows_of(changed(full, yaw=yaw), frequency)
    assert windows.size > 60
    true = [hunting_mode(rig, float(v)).shape[2] / rig.length_scale for v in windows['speed']]
    off = np.abs(windows['ratio'] / true - 1.0) / np.sqrt(2.0)
    assert np.sqrt(np.mean(np.square(off))) < 0.15
    assert np.sqrt(np.mean(np.square(off / np.hypot(windows['relative_std'], 0.02)))) < 1.8
    assert np.median(windows['frequency_hz']) == pytest.approx(frequency, rel=0.04)


def test_lost_samples_are_bridged_and_gaps_are_left_out(record) -> None:
    whole = windows_of(record)
    rng = np.random.default_rng(0)
    kept = {}
    for name in ('lateral', 'yaw'):
        keep = rng.random(len(record[name])) > 0.05
        stamps = record[name].stamps_ns
        keep &= (stamps < 100_000_000_000) | (stamps > 130_000_000_000)
        kept[name] = Series(stamps[keep], record[name].values[keep])
    torn = Record({**record, **kept})
    assert 0.8 < windows_of(torn).size / whole.size < 0.95
