"""Profiles in YAML: what they are, what is refused, and how long they last."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from hunt_ros.dynamics.limit_cycle import limit_cycles
from hunt_ros.dynamics.linear_stability import critical_speed
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Climb, Hold, Motion, Profile, Ramp, Seesaw
from hunt_ros.dynamics.profile.run import ProfileRun
from hunt_ros.dynamics.simulation import SimulationSettings, simulate
from hunt_ros.errors import ConfigError

EVERY_STEP = """
name: all of them
profile:
- hold: {speed_mps: 6, duration_s: 10}
- ramp: {speed_mps: 7.0, rate_mps2: 0.1, note: up}
- sweep: {low_mps: 7.0, high_mps: 8.0, rate_mps2: 0.05}
- staircase: {low_mps: 7.0, high_mps: 7.4, hold_s: 5}
- corners: {times_s: [0, 10, 20], speeds_mps: [7, 8, 8]}
"""


def test_a_profile_is_read_written_and_simulated_alike() -> None:
    profile = Profile.from_yaml(EVERY_STEP)
    assert profile.steps[:2] == (Hold(6.0, 10.0), Ramp(7.0, note='up'))
    assert Profile.from_yaml(profile.to_yaml()) == profile
    times_s, speeds = profile.corners()
    assert times_s[-1] == pytest.approx(profile.duration_s)
    expected = 10.0 + 10.0 + 40.0 + (5 * 5.0 + 4.0) + 20.0
    assert times_s[-1] == pytest.approx(expected, abs=0.1)
    assert np.interp([5.0, 15.0], times_s, speeds) == pytest.approx([6.0, 6.5])


def test_a_staircase_goes_up_and_down_and_ends_at_the_top_it_was_given() -> None:
    text = 'profile: [{staircase: {low_mps: 6.2, high_mps: 6.7, hold_s: 10}}]'
    speeds = Profile.from_yaml(text).corners()[1]
    levels = [speed for speed, after in itertools.pairwise(speeds) if speed == after]
    assert levels == pytest.approx([6.2, 6.4, 6.6, 6.7, 6.6, 6.4, 6.2])


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('{', 'not YAML'),
        ('6.0', 'expected "profile:"'),
        ('profile: []', 'expected a list of steps'),
        ('{profile: [hold], x: 1}', "unknown key 'x'"),
        ('profile: [hold]', "step 1: 'hold' is no step"),
        ('profile: [{dance: {}}]', "unknown step 'dance'"),
        ('profile: [{hold: 6}]', 'no mapping'),
        ('profile: [{hold: {speed_mps: 6}}]', 'duration_s is missing'),
        ('profile: [{hold: {speed_mps: 6, duration_s: -1}}]', 'duration_s: -1.0 is below 0 s'),
        ('profile: [{hold: {speed_mps: -6, duration_s: 1}}]', 'speed_mps: -6.0 is below'),
        ('profile: [{hold: {speed_mps: .inf, duration_s: 1}}]', 'speed_mps: inf is above'),
        ('profile: [{hold: {speed_mps: six, duration_s: 1}}]', "speed_mps: 'six' is not a number"),
        ('profile: [{hold: {speed_mps: 6, duration_s: 1, sped: 2}}]', "unknown key 'sped'"),
        (
            'profile: [{ramp: {speed_mps: 6}}, {ramp: {speed_mps: 6, rate_mps2: 0}}]',
            'step 2 (ramp): rate_mps2: 0.0 is below',
        ),
        ('profile: [{corners: {times_s: [0, 1], speeds_mps: [6]}}]', '2 times for 1 speeds'),
        ('profile: [{corners: {times_s: [0, 0], speeds_mps: [6, 7]}}]', '0 s comes after 0 s'),
        ('profile: [{corners: {times_s: [0, a], speeds_mps: [6, 7]}}]', 'step 1 (corners)'),
        ('profile: [{corners: {times_s: 3, speeds_mps: [6, 7]}}]', 'step 1 (corners)'),
        ('profile: [{staircase: {low_mps: 7, high_mps: 6}}]', 'below low_mps'),
        ('profile: [{climb: {low_mps: 7, high_mps: 6}}]', 'below low_mps'),
    ],
)
def test_what_is_no_profile_is_refused_in_one_line(text, words) -> None:
    with pytest.raises(ConfigError) as refusal:
        Profile.from_yaml(text, 'mine.yaml')
    (line,) = str(refusal.value).splitlines()
    assert words in line
    assert line.startswith('mine.yaml')


def test_a_profile_above_the_ceiling_is_refused_with_its_step(tmp_path) -> None:
    file = tmp_path / 'fast.yaml'
    file.write_text('profile: [{hold: {speed_mps: 6, duration_s: 1}}, {ramp: {speed_mps: 9}}]')
    profile = Profile.read(str(file))
    assert profile.name == 'fast'
    profile.check(9.0)
    with pytest.raises(ConfigError, match=r'fast.yaml, step 2 \(ramp\): 9 m/s is above'):
        profile.check(8.5)
    with pytest.raises(ConfigError, match='cannot read it'):
        Profile.read(str(tmp_path / 'nowhere.yaml'))


def climbed(step: Climb, seen, seconds: int = 400) -> tuple[list[float], ProfileRun]:
    """Run a climb; `seen(speed, seconds at it)` is what the detector says. Return its speeds."""
    run, speeds, held_s = ProfileRun(Profile((step, Hold(5.0, 1.0))), 5.0), [5.0], 0.0
    for _ in range(10 * seconds):
        speed = run.advance(0.1, seen(speeds[-1], held_s))
        held_s = held_s + 0.1 if speed == speeds[-1] else 0.0
        speeds.append(speed)
        if run.finished:
            break
    return speeds, run


def cleared(speed: float, held_s: float, **more: float) -> Motion:
    known = {'margin': 4.0, 'escape_chance': 0.01, 'forecast_mps': 8.0, **more}
    unknown = {'held_mps': speed, 'held_s': held_s, 'amplitude_m': 1e-5}
    return Motion(**(unknown | known if held_s > 20.0 else unknown))


CLIMB = Climb(6.0, 7.0, 0.5, wait_s=30.0)


@pytest.mark.parametrize(
    ('step', 'seen', 'top', 'words'),
    [
        pytest.param(CLIMB, cleared, 7.0, '', id='to the top'),
        pytest.param(CLIMB, lambda v, t: cleared(v, t, margin=9.5 - v), 7.0, '',
                     id='the margin falls with the speed, and is kept'),
        pytest.param(CLIMB, lambda v, t: cleared(v, t, margin=8.2 - v), 6.5,
                     'margin 1.7, expected 2 or more', id='low margin'),
        pytest.param(CLIMB, lambda v, t: cleared(v, t, escape_chance=0.1 * (v > 6.2)), 6.5,
                     'chance of escape 0.1, expected 0.05', id='an escape is likely'),
        pytest.param(CLIMB, lambda v, t: cleared(v, min(t, 19.0)), 6.0, 'margin not known',
                     id='what is not known is not kept'),
        pytest.param(replace(CLIMB, margin=0.0, escape_chance=1.0, forecast_mps=1.2),
                     lambda v, t: cleared(v, t, margin=math.nan), 7.0,
                     'forecast of v_c 8 or more, expected 8.2 m/s', id='forecast alone'),
        pytest.param(CLIMB, lambda v, t: cleared(6.0, 300.0), 6.5, '6.5 m/s is not cleared',
                     id='the speed that was cleared before is no other'),
    ],
)  # fmt: skip
def test_a_climb_goes_on_where_a_speed_is_cleared_and_back_where_it_is_not(
    step, seen, top, words
) -> None:
    speeds, run = climbed(step, seen)
    assert max(speeds) == pytest.approx(top)
    assert run.finished
    assert words in run.note
    # What comes after it is not run where it went back.
    assert speeds[-1] == pytest.approx(6.0 if words else 5.0)


def test_a_climb_goes_back_at_once_where_it_hunts_or_what_was_kept_falls() -> None:
    def hunts(v: float, t: float) -> Motion:
        return replace(cleared(v, t), **({'margin': 0.0} if v == 7.0 and t > 5.0 else {}))

    speeds, run = climbed(CLIMB, hunts)
    assert speeds.count(7.0) == pytest.approx(50, abs=3)
    assert 'margin 0' in run.note
    stays = replace(CLIMB, hold_s=100.0)
    speeds, run = climbed(stays, lambda v, t: cleared(v, t, margin=4.0 if t < 60.0 else 1.9))
    assert max(speeds) == 6.0
    assert 'margin 1.9' in run.note


def test_hunting_ends_a_climb_that_asks_for_no_margin() -> None:
    anything = replace(CLIMB, margin=0.0, escape_chance=1.0, hold_s=300.0)

    def hunts(v: float, t: float) -> Motion:
        seen = cleared(v, t)
        return replace(seen, margin=0.0, escape_chance=1.0) if t > 5.0 else seen

    speeds, run = climbed(anything, hunts)
    assert len(speeds) < 300, 'at once'
    assert run.finished
    assert 'back to 6 m/s: 6 m/s is not cleared (margin 0: it hunts)' in run.note


def test_the_steps_of_a_climb_are_of_equal_height() -> None:
    step = Climb(6.0, 7.001, 0.5, wait_s=30.0)
    speeds, run = climbed(step, cleared)
    assert max(speeds) == 7.001
    assert not run.note
    assert np.ptp(np.diff(step.levels)) < 1e-9
    assert Climb(6.0, 6.0).levels == [6.0]


def test_a_slow_climb_decides_at_its_steps_and_not_on_the_way() -> None:
    run, speeds = ProfileRun(Profile((replace(CLIMB, rate_mps2=0.003),)), 6.0), [6.0]
    while not run.finished:  # so slow that the detector calls it held
        speeds.append(run.advance(0.1, cleared(speeds[-1], 300.0)))
    assert speeds[-1] == 7.0


def test_a_climb_needs_a_detector_that_judges_and_tells_its_highest_speed() -> None:
    profile = Profile.from_yaml('profile: [{climb: {low_mps: 6, high_mps: 9.1}}]')
    assert 'a detector has to clear' in profile.missing(Motion(amplitude_m=1e-5))
    assert not profile.missing(Motion(held_s=0.0))
    assert not profile.missing(Motion(held_s=0.0, v_n=6.1, v_c=8.0))
    assert 'not die out above v_n, 5.90' in profile.missing(Motion(held_s=0.0, v_n=5.9, v_c=8.0))
    assert 'not die out above v_c, 5.80' in profile.missing(Motion(held_s=0.0, v_c=5.8))
    with pytest.raises(ConfigError, match=r'9.1 m/s is above'):
        profile.check(9.0)
    with pytest.raises(ConfigError, match='a detector has to clear'):
        simulate(paper_rig(), SimulationSettings(), profile)


def test_a_see_saw_needs_a_form_or_its_numbers_and_no_simulation_alone() -> None:
    profile = Profile((Seesaw(60.0, low_mps=6.0, high_mps=8.4),))
    lacking = profile.missing(Motion())
    assert 'watch_low_mps' in lacking
    assert 'low_mps,' not in lacking.split('give ')[1].split('watch')[0]
    assert not profile.missing(Motion(v_n=6.4, v_c=8.0, fold_amplitude_m=4e-4))
    assert profile.duration_s == pytest.approx(60.0)
    with pytest.raises(ConfigError, match='reacts to the detector'):
        profile.corners()


def test_a_simulated_seesaw_turns_back_above_v_c_and_again_below_v_n() -> None:
    rig = paper_rig()
    settings = SimulationSettings(sample_rate_hz=100.0, broadband=8e-6)
    profile = Profile((Seesaw(duration_s=120.0, rate_mps2=0.2),))
    record = simulate(rig, settings, profile, seed=3)
    lateral, speed = record['lateral'], record['speed']
    v_n, v_c = limit_cycles(rig).nonlinear_critical_speed, critical_speed(rig)
    assert speed.values[0] < v_n
    top = int(np.argmax(speed.values))
    assert speed.values[top] > v_c
    # What grew at the top is hunting on the way down, until below v_n.
    below = top + int(np.argmax(speed.values[top:] < v_n))
    hunting = (lateral.stamps_ns > speed.stamps_ns[top]) & (
        lateral.stamps_ns < speed.stamps_ns[below]
    )
    assert lateral.values[hunting].max() > 0.4e-3
    # It went up again from there, and ends at its lowest speed when its time is over.
    assert speed.values[below:].max() > v_n + 0.3
    assert speed.values[-1] < v_n
    assert record.duration_s > 120.0


def test_a_seesaw_whose_v_n_is_too_high_goes_lower_until_hunting_dies_out() -> None:
    rig = paper_rig()
    settings = SimulationSettings(sample_rate_hz=100.0, broadband=8e-6)
    v_n = limit_cycles(rig).nonlinear_critical_speed
    wrong = v_n + 0.3
    seesaw = Seesaw(duration_s=200.0, rate_mps2=0.2, low_mps=wrong, watch_s=6.0)
    speed = simulate(rig, settings, Profile((seesaw,)), seed=3)['speed'].values
    top = int(np.argmax(speed))
    lowest = top + int(np.argmin(speed[top:]))
    assert wrong - 1.0 < speed[lowest] < wrong - 0.15
    assert speed[lowest:].max() > v_n + 0.3, 'it goes on'


def test_a_rig_without_a_fold_says_what_a_seesaw_needs() -> None:
    rig = replace(paper_rig(), alpha={}, beta={})
    with pytest.raises(ConfigError, match=r'step 1 \(seesaw\): .*give low_mps'):
        simulate(rig, SimulationSettings(), Profile((Seesaw(duration_s=10.0),)))
