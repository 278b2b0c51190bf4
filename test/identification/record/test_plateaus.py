from __future__ import annotations

import numpy as np
from made import record_of, rig_settings

from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Corners, Profile
from hunt_ros.dynamics.simulation import Kick, simulate
from hunt_ros.identification.record.channels import channels_of
from hunt_ros.identification.record.envelope import without_beat
from hunt_ros.identification.record.hunting_frequency import tracked_envelope
from hunt_ros.identification.record.kicks import find_kicks
from hunt_ros.identification.record.plateaus import Run, speed_holds, steady_part, steady_states
from hunt_ros.identification.settings import IdentificationSettings

SETTINGS = IdentificationSettings()


def analysed(record):
    channels = channels_of(record)
    envelope, clean = tracked_envelope(channels, 2.8, SETTINGS)
    kicked, corrected = find_kicks(clean, envelope), without_beat(envelope)
    states = steady_states(channels, envelope, corrected, kicked, SETTINGS)
    return Run(envelope, envelope, corrected, kicked, states)


def test_holds_are_found_in_a_noisy_staircase_and_none_in_a_ramp():
    rng = np.random.default_rng(0)
    time = np.arange(0, 120, 0.5)
    stairs = 6.0 + 0.2 * np.floor(time / 30.0) + 0.005 * rng.standard_normal(time.size)
    holds = speed_holds(time, stairs, 8.0)
    assert len(holds) == 4
    assert all(time[end - 1] - time[start] > 25.0 for start, end in holds)
    ramp = 6.0 + 0.012 * time + 0.005 * rng.standard_normal(time.size)
    assert speed_holds(time, ramp, 8.0) == []


def test_a_hold_beside_quick_ramps_is_the_hold_alone() -> None:
    """The step from instant to instant along a ramp is no jitter of the reading."""
    time = np.arange(0.0, 105.0, 0.53)
    corners = ([0.0, 8.0, 40.0, 60.0, 92.0, 105.0], [7.0, 7.0, 8.8, 8.8, 7.0, 7.0])
    speed = np.interp(time, *corners) + 0.005 * np.random.default_rng(0).standard_normal(time.size)
    ends = [(time[first], time[last - 1]) for first, last in speed_holds(time, speed, 6.0)]
    assert np.abs(np.array(ends) - [[0.0, 8.0], [40.0, 60.0], [92.0, 105.0]]).max() < 1.5


def test_the_steady_part_leaves_out_the_approach():
    rng = np.random.default_rng(1)
    x = np.arange(100)
    amplitude = 6e-4 * (1.0 - 0.8 * np.exp(-x / 10.0)) + 1e-6 * rng.standard_normal(100)
    part = steady_part(amplitude)
    assert part is not None
    assert 20 < part.start < 80
    assert steady_part(6e-4 * np.exp(0.03 * x)) is None


def test_a_staircase_gives_one_state_a_plateau_with_its_direction(records):
    steady = [s for s in analysed(records['staircase'][0]).states if s.kind == 'plateau']
    top = max(steady, key=lambda s: s.speed)
    assert len(steady) > 20
    assert {s.direction for s in steady if s.end_ns < top.start_ns and s.speed > 6.1} == {'up'}
    assert {s.direction for s in steady if s.start_ns > top.end_ns} == {'down'}
    assert abs(top.amplitude / 7.0e-4 - 1.0) < 0.01
    assert top.maxima > top.amplitude  # it holds the roughness line
    assert top.cycles > 30


def test_kicks_of_a_sweep_are_found_where_they_were(records):
    record = records['sweep'][0]
    found = [(at - record.start_ns) / 1e9 for _, at in analysed(record).kicks]
    for time in (60.0, 120.0):
        assert min(abs(np.array(found) - time)) < 1.5
    assert len(found) <= 6


def test_a_small_kick_into_the_noise_next_to_the_critical_speed_is_found():
    """Taken for free growth, one in ten demos was refused its normal form."""
    profile = Profile((Corners((0.0, 60.0), (7.3, 7.9)),))
    rig = rig_settings(200.0, roughness=(2e-5,))
    kicks = [Kick(40.0, lateral_m=8e-5)]
    found = []
    for seed in range(4):
        record = simulate(paper_rig(), rig, profile, kicks=kicks, seed=seed)
        found += [(at - record.start_ns) / 1e9 for _, at in analysed(record).kicks]
    near = [time for time in found if abs(time - 40.0) < 1.5]
    assert len(near) >= 3
    assert len(found) - len(near) <= 1


def test_a_reading_that_stands_still_is_no_amplitude():
    # A motion below one step of a coarse sensor: then the amplitude is zero.
    time = np.arange(0.0, 120.0, 0.01)
    motion = np.where(time > 40.0, 2e-3, 2e-5) * np.sin(2.0 * np.pi * 2.8 * time)
    lateral = np.round(motion / 1e-4) * 1e-4
    speed = 7.0 + 0.2 * np.floor(time / 41.0)
    record = record_of(time, lateral=lateral, speed=speed)
    states = analysed(record).states
    assert [round(1e3 * s.amplitude, 2) for s in states if s.kind == 'plateau'] == [2.0, 2.0]
