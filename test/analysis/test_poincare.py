from __future__ import annotations

import math

import numpy as np
import pytest
from made import at_most, rig_settings

from hunt_ros.analysis.phase_portrait import phase_portrait
from hunt_ros.analysis.poincare import own_section, poincare_section
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import RollerRig, SimulationSettings
from hunt_ros.errors import IdentificationError

RATE = 250.0


def running(speed: float, kick: float = 0.0, broadband: float = 8e-6, seed: int = 0):
    """Displacement and roller angle of a minute of running, 15 s after a kick."""
    settings = rig_settings(RATE, broadband, (30e-6, 10e-6), initial_speed=speed)
    rig = RollerRig(paper_rig(), settings, seed)
    if kick:
        rig.kick(lateral_m=kick)
    block = rig.advance(round(75 * RATE))
    begin = round(15 * RATE)
    return block.lateral[begin:], block.roller_angle[begin:]


@pytest.mark.parametrize('broadband', [0.0, 8e-6, 2e-5])
@pytest.mark.parametrize('speed', [6.0, 7.2])
def test_below_the_critical_speed_the_section_is_a_point(speed, broadband):
    lateral, angle = running(speed, broadband=broadband)
    section = poincare_section(lateral, RATE, angle)
    assert (section.kind, section.period) == ('periodic', 1)


@pytest.mark.parametrize('broadband', [0.0, 8e-6, 2e-5])
@pytest.mark.parametrize(('speed', 'kick'), [(8.3, 1e-3), (8.8, 1e-3), (7.2, 1e-3)])
def test_a_hunting_wheelset_draws_a_closed_curve(speed, kick, broadband):
    lateral, angle = running(speed, kick, broadband)
    section = poincare_section(lateral, RATE, angle)
    assert section.kind == 'quasi-periodic'


def test_a_locked_orbit_is_a_few_points():
    time = np.arange(round(100 * RATE)) / RATE
    angle = 2 * np.pi * 7.5 * time
    noise = np.random.default_rng(0).normal(0.0, 5e-6, time.size)
    signal = 0.6e-3 * np.sin(angle * 2 / 5) + 5e-5 * np.sin(angle) + noise
    section = poincare_section(signal, RATE, angle)
    assert (section.kind, section.period) == ('periodic', 5)
    doubled = 0.3e-3 * np.sin(angle) + 0.1e-3 * np.sin(angle / 2 + 0.4) + noise
    section = poincare_section(doubled, RATE, angle)
    assert (section.kind, section.period) == ('periodic', 2)
    # Close to 2/5 but not locked: the points drift along a curve.
    section = poincare_section(0.6e-3 * np.sin(angle * 0.4004) + noise, RATE, angle)
    assert section.kind == 'quasi-periodic'


def test_a_growing_oscillation_is_a_transient():
    time = np.arange(round(60 * RATE)) / RATE
    signal = 1e-4 * np.exp(0.03 * time) * np.sin(17.3 * time)
    section = poincare_section(signal, RATE, 2 * np.pi * 7.64 * time)
    assert section.kind == 'transient'


def test_the_section_lies_on_the_orbit():
    time = np.arange(round(60 * RATE)) / RATE
    signal = 1e-3 * np.sin(17.3 * time) + 0.01
    section = poincare_section(signal, RATE, 2 * np.pi * 7.64 * time)
    radius = np.hypot(section.displacement, section.velocity / 17.3)
    assert radius == pytest.approx(1e-3, rel=0.03)


def test_the_portrait_of_a_sinusoid_is_its_ellipse():
    time = np.arange(round(20 * RATE)) / RATE
    portrait = phase_portrait(0.5e-3 * np.cos(18.0 * time) + 3e-3, RATE)
    velocity = -0.5e-3 * 18.0 * np.sin(18.0 * time)[portrait.first : -portrait.first]
    assert portrait.velocity == pytest.approx(velocity, abs=0.02 * 0.5e-3 * 18.0)


def test_turning_backwards_makes_no_difference():
    lateral, angle = running(8.3, 1e-3)
    forward = poincare_section(lateral, RATE, angle)
    backward = poincare_section(lateral, RATE, -angle)
    assert backward.kind == forward.kind
    assert backward.displacement == pytest.approx(forward.displacement)


@pytest.mark.parametrize(('size', 'turning'), [(1000, np.nan), (1000, 0.0), (100, 33.0)])
def test_what_cannot_be_cut_is_refused(size, turning):
    values = np.random.default_rng(0).normal(size=size)
    with pytest.raises(IdentificationError):
        poincare_section(values, RATE, turning * np.arange(size) / RATE)


def test_few_revolutions_decide_nothing():
    lateral, angle = running(8.3, 1e-3)
    count = round(3 * RATE)
    assert poincare_section(lateral[:count], RATE, angle[:count]).kind == 'undecided'


@pytest.mark.parametrize('speed', [7.0, 7.8])
def test_quiet_motion_that_noise_drives_is_not_called_a_curve(speed):
    trials = 20
    kinds = []
    for seed in range(trials):
        settings = SimulationSettings(sample_rate_hz=RATE, initial_speed=speed, broadband=5e-6)
        block = RollerRig(paper_rig(), settings, seed).advance(round(40 * RATE))
        kinds.append(poincare_section(block.lateral, RATE, block.roller_angle).kind)
    # Near v_c 40 s hold a few independent amplitudes: it may stay open what they are.
    doubted = kinds.count('undecided')
    assert trials - doubted - kinds.count('noise-driven') <= at_most(0.03, trials), kinds
    assert doubted <= at_most(0.2, trials), kinds


def test_a_limit_cycle_that_noise_moves_is_a_curve():
    trials = 8
    kinds = [running(7.2, 1e-3, 2e-5, seed) for seed in range(trials)]
    kinds = [poincare_section(y[:10000], RATE, angle[:10000]).kind for y, angle in kinds]
    assert trials - kinds.count('quasi-periodic') <= at_most(0.02, trials), kinds


def test_two_frequencies_without_a_ratio_are_a_curve_whatever_the_sensor_adds():
    trials = 12
    time = np.arange(round(40 * RATE)) / RATE
    angle = 2 * np.pi * 7.5 * time
    kinds = []
    for seed in range(trials):
        random = np.random.default_rng(seed)
        hunting = 0.6e-3 * np.sin(angle * 0.618034 + random.uniform(0.0, 2 * np.pi))
        signal = hunting + 5e-5 * np.sin(angle) + random.normal(0.0, 5e-6, time.size)
        kinds.append(poincare_section(signal, RATE, angle).kind)
    assert trials - kinds.count('quasi-periodic') <= at_most(0.02, trials), kinds


def hopf(noise: float, seconds: float = 60.0, size: float = 1.0, seed: int = 0):
    """A limit cycle, or with size 0 damped noise, at 2.5 Hz; y and a quarter of a cycle behind."""
    random = np.random.default_rng(seed)
    z, dt = complex(size), 1.0 / RATE
    path = np.empty(round(seconds * RATE), dtype=complex)
    for k in range(path.size):
        growth = 1.0 - abs(z) ** 2 if size else -0.5
        z += growth * z * dt + noise * math.sqrt(dt) * complex(*random.standard_normal(2))
        path[k] = z
    turning = path * np.exp(2j * np.pi * 2.5 * np.arange(path.size) / RATE)
    return 1e-3 * turning.real, 4e-3 * turning.imag


@pytest.mark.parametrize('with_yaw', [False, True])
def test_without_a_roller_a_limit_cycle_is_a_point_of_its_own_section(with_yaw):
    lateral, yaw = hopf(0.02)
    section = own_section(lateral, RATE, yaw if with_yaw else None)
    assert section.cut == 'hunting'
    assert (section.kind, section.period) == ('periodic', 1)
    assert section.displacement.size == pytest.approx(60 * 2.5, abs=3)
    assert abs(section.displacement).mean() == pytest.approx(1e-3, rel=0.05)


@pytest.mark.parametrize('with_yaw', [False, True])
def test_without_a_roller_noise_is_noise(with_yaw):
    trials = 6
    kinds = []
    for seed in range(trials):
        lateral, yaw = hopf(0.1, size=0.0, seed=seed)
        kinds.append(own_section(lateral, RATE, yaw if with_yaw else None).kind)
    assert trials - kinds.count('noise-driven') <= at_most(0.05, trials), kinds


def test_too_few_cycles_are_refused():
    time = np.arange(round(1.2 * RATE)) / RATE
    with pytest.raises(IdentificationError, match='cycles'):
        own_section(np.sin(2 * np.pi * 2.5 * time), RATE)
