"""Lines of whole records: the hunting is no forced line."""

from __future__ import annotations

import numpy as np
import pytest
from made import record_of, rig_settings

from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Corners, Profile
from hunt_ros.dynamics.simulation import Kick, simulate
from hunt_ros.estimation.record_lines import RecordLines
from hunt_ros.estimation.record_motion import motion_of, turns_per_metre


@pytest.mark.parametrize('speed', [6.8, 7.4])
@pytest.mark.parametrize('roughness', [(), (2e-5,)], ids=['smooth', 'rough'])
@pytest.mark.parametrize('kicks', [[], [Kick(120.0, 6e-4)]], ids=['quiet', 'kicked'])
def test_in_a_record_most_of_which_is_one_speed_the_hunting_is_not_forced(
    speed, roughness, kicks
) -> None:
    """In way it is a line as it is in time: what it does at other speeds tells them apart."""
    profile = Profile([Corners((0.0, 5.0, 45.0, 240.0), (0.5, 0.5, speed, speed))])
    settings = rig_settings(200.0, roughness=roughness, initial_speed=0.5)
    record = simulate(paper_rig(), settings, profile, 240.0, kicks, seed=1)
    lines = RecordLines([motion_of(record)])
    assert lines.forced() == []
    if kicks:
        assert lines.hunting_hz == pytest.approx(2.84, rel=0.03)


@pytest.mark.parametrize(('apart', 'forced'), [(0.025, False), (0.06, True)])
def test_a_line_follows_the_speed_once_it_is_seen_at_speeds_far_enough_apart(
    apart, forced
) -> None:
    """Speeds within half the width of the window, and beyond: there alone is it named."""
    rng = np.random.default_rng(0)
    speed = 6.0 * np.where(np.arange(24_000) < 12_000, 1.0 - apart, 1.0 + apart)
    turned = 1.2 * np.cumsum(speed) * 0.01
    lateral = 1e-4 * np.cos(2.0 * np.pi * turned) + 5e-6 * rng.normal(size=speed.size)
    record = record_of(np.arange(1, 24_001) / 100.0, lateral=lateral, speed=speed)
    lines = RecordLines([motion_of(record)]).forced()
    assert [line.turns_per_metre for line in lines] == pytest.approx([1.2] * forced, rel=0.01)


@pytest.mark.parametrize(('grown', 'forced'), [(1.0, True), (3.0, True), (60.0, False)])
def test_hunting_of_the_kinematic_wavelength_is_no_forced_line(grown, forced) -> None:
    """Klingel (1883): its frequency follows the speed; what tells it is that it comes and goes."""
    rng = np.random.default_rng(0)
    count = 48_000
    speed = 6.0 + 2.5 * np.sin(np.pi * np.arange(count) / count)
    turned = 0.42 * np.cumsum(speed) * 0.01
    size = 2e-5 * np.where(speed > 7.0, grown, 1.0)
    lateral = size * np.cos(2.0 * np.pi * turned) + 1e-6 * rng.normal(size=count)
    record = record_of(np.arange(1, count + 1) / 100.0, lateral=lateral, speed=speed)
    lines = RecordLines([motion_of(record)]).forced()
    assert [line.turns_per_metre for line in lines] == pytest.approx([0.42] * forced, rel=0.01)


@pytest.mark.parametrize('seed', range(4))
def test_rest_of_the_kinematic_wavelength_is_no_forced_line(seed) -> None:
    """Noise drives it: its frequency follows the speed, and its phase wanders."""
    rng = np.random.default_rng(seed)
    count = 24_000
    speed = np.linspace(5.5, 7.0, count)
    turn = np.exp((-0.1 + 1.0j) * 2.0 * np.pi * 0.35 * speed * 0.01)
    noise = rng.normal(size=(count, 2)) @ (1.0, 1.0j)
    phasor = np.empty(count, dtype=complex)
    phasor[0] = 0.0
    for k in range(1, count):
        phasor[k] = turn[k] * phasor[k - 1] + noise[k]
    lateral = 4e-7 * phasor.real + 1e-7 * rng.normal(size=count)
    record = record_of(np.arange(1, count + 1) / 100.0, lateral=lateral, speed=speed)
    assert RecordLines([motion_of(record)]).forced() == []


def test_a_record_whose_clock_was_set_ahead_by_years_is_no_motion() -> None:
    seconds = np.arange(6000) / 100.0 + np.where(np.arange(6000) < 3000, 0.0, 1.6e9)
    record = record_of(seconds, lateral=1e-4 * np.cos(2.0 * np.pi * 2.8 * seconds))
    assert motion_of(record) is None


@pytest.mark.parametrize('wraps', [False, True])
def test_the_way_of_a_gap_is_not_guessed(wraps: bool) -> None:
    """Where the speed changes meanwhile, or the encoder wraps, a known line would be another."""
    time = np.arange(0.0, 120.0, 0.01)
    speed = np.where(time < 60.0, 3.0, 6.5)
    angle = np.cumsum(speed) * 0.01 / 0.15
    angle = angle % (2.0 * np.pi) if wraps else angle
    there = np.abs(time - 59.0) > 10.0
    record = record_of(time[there], roller=angle[there], speed=speed[there])
    assert turns_per_metre(record, 0.0) == pytest.approx(1.0 / (0.3 * np.pi), rel=1e-3)


def test_a_run_that_reverses_has_turned() -> None:
    time = np.arange(0.0, 120.0, 0.01)
    speed = np.where(time < 60.0, 6.0, -6.0)
    record = record_of(time, roller=np.cumsum(speed) * 0.01 / 0.15, speed=speed)
    assert turns_per_metre(record, 0.0) == pytest.approx(1.0 / (0.3 * np.pi), rel=1e-3)
