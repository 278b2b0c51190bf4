"""Which set point comes next, and how far it may be from the one before."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.drivers.command import DriveLimits, RollerCommand
from hunt_ros.dynamics.profile import Climb, Corners, Hold, Motion, Profile, Ramp, Seesaw
from hunt_ros.dynamics.profile.run import ProfileRun
from hunt_ros.errors import ConfigError


def _command(*steps, acceleration=1.0, jerk=1e4, ceiling=20.0) -> RollerCommand:
    limits = DriveLimits(acceleration_mps2=acceleration, jerk_mps3=jerk, speed_ceiling_mps=ceiling)
    command = RollerCommand(limits, longest_step_s=0.5)
    command.profile = Profile(steps or (Ramp(10.0, 1.0),))
    return command


def _next(command: RollerCommand, passed_s: float, measured: float = 0.0) -> float | None:
    speed = command.next(passed_s, measured)
    if speed is not None:
        command.taken(speed)
    return speed


def test_the_drive_is_left_alone_until_a_profile_is_started_and_its_speed_is_known() -> None:
    command = _command()
    assert command.next(0.1, 3.0) is None
    assert command.resume() == 'no profile was started'
    assert command.start() == ''
    assert command.next(0.1, math.nan) is None


@given(
    gaps=st.lists(st.floats(-10.0, 1e4), min_size=1, max_size=40),
    measured=st.floats(0.0, 20.0),
    refused=st.lists(st.booleans(), min_size=40, max_size=40),
)
def test_no_gap_moves_the_set_point_faster_than_the_limit(gaps, measured, refused) -> None:
    command = _command(Corners((0.0, 5.0), (0.0, 20.0)), Hold(3.0, 1.0, 100.0), acceleration=2.0)
    command.start()
    last = measured
    for gap, no in zip(gaps, refused, strict=False):
        speed = command.next(gap, measured)
        assert speed is not None
        assert abs(speed - last) <= 2.0 * 0.5 + 1e-9
        if not no:
            command.taken(speed)
            last = speed


def test_time_stands_still_while_the_drive_takes_nothing() -> None:
    command = _command()
    command.start()
    assert _next(command, 0.5) == pytest.approx(0.5)
    for _ in range(100):
        command.next(0.5, 0.5)  # refused
    assert _next(command, 0.5) == pytest.approx(1.0)


def test_an_emergency_stop_is_not_ramped_and_never_speeds_the_roller_up() -> None:
    command = _command(Hold(8.0, 10.0))
    command.start()
    _next(command, 0.1, 8.0)
    assert command.trip(0.0, 8.0, stop=True) == 0.0
    assert _next(command, 0.0) == 0.0
    assert 'hunt call rearm' in command.start()
    assert 'hunt call rearm' in command.resume()
    command = _command()
    assert command.trip(2.0, 0.5, stop=True) == 0.5
    assert _command().trip(2.0, math.nan, stop=True) == 2.0


def test_after_a_pause_of_the_process_the_way_down_is_no_leap() -> None:
    """But it goes on over the time for which a drive that answers late may hold one up."""
    command = _command()
    command.trip(2.0, 8.0)
    command.taken(8.0)
    assert command.next(0.8, 8.0) == pytest.approx(7.2)
    assert command.next(5.0, 8.0) == pytest.approx(7.0)


def test_a_climb_does_not_go_on_behind_a_trip() -> None:
    command = _command(Climb(0.5, 2.0))
    seen = Motion(amplitude_m=0.0, held_mps=0.5, held_s=3.0)
    assert command.start(seen) == ''
    command.taken(command.next(0.5, 0.5, seen))
    command.trip(0.2, 0.5)
    command.rearm()
    assert 'start the profile again' in command.resume()
    assert _next(command, 0.5, 0.2) == pytest.approx(0.2)
    assert command.start(seen) == ''


def test_a_stopped_profile_holds_what_the_drive_was_told_not_where_the_ramp_leads() -> None:
    command = _command(Corners((0.0,), (6.0,)))
    command.start()
    _next(command, 0.5)
    assert _next(command, 0.5) == pytest.approx(1.0)
    command.stop()
    assert _next(command, 0.5) == pytest.approx(1.0, abs=1e-3)


def _ride(command: RollerCommand, seconds: float, step_s: float = 0.05, **seen) -> list[float]:
    """Follow the set points with a drive that is always there; return them."""
    motion, speeds = Motion(**seen), []
    for _ in range(round(seconds / step_s)):
        speed = command.next(step_s, speeds[-1] if speeds else 0.0, motion)
        assert speed is not None
        command.taken(speed)
        speeds.append(speed)
    return speeds


def test_acceleration_and_jerk_are_limited_and_nothing_overshoots() -> None:
    command = _command(Corners((0.0, 20.0), (4.0, 4.0)), acceleration=1.0, jerk=2.0)
    command.start()
    speeds = np.array([0.0, *_ride(command, 10.0, 0.01)])
    rates = np.diff(speeds) / 0.01
    assert np.abs(rates).max() <= 1.0 + 1e-9
    assert np.abs(np.diff(rates, prepend=0.0)).max() / 0.01 <= 2.0 * 2.0 + 1e-6
    assert speeds.max() <= 4.0
    assert speeds[-1] == 4.0
    # As quick as the limits allow: 4 m/s at 1 m/s2, and half a second for each change of it.
    assert np.argmax(speeds > 3.999) * 0.01 == pytest.approx(4.5, abs=0.1)


def test_no_profile_and_no_parameter_brings_a_set_point_above_the_ceiling() -> None:
    command = _command(ceiling=10.0)
    with pytest.raises(ConfigError, match='above the ceiling'):
        Profile((Hold(10.5, 1.0),)).check(10.0)
    command.profile = Profile((Seesaw(100.0),))  # its speeds follow from the form
    seen = {'amplitude_m': 0.0, 'v_n': 8.0, 'v_c': 9.9, 'fold_amplitude_m': 1e-3}
    assert command.start(Motion(**seen)) == ''
    speeds = _ride(command, 150.0, 0.25, **seen)
    assert max(speeds) == 10.0


def test_a_ceiling_that_is_lowered_is_approached_within_the_limits() -> None:
    command = _command(Hold(8.8, 100.0, 1.0), acceleration=1.0, jerk=5.0, ceiling=12.0)
    command.start()
    assert _ride(command, 15.0)[-1] == pytest.approx(8.8)
    command.stop()
    command.limits = replace(command.limits, speed_ceiling_mps=5.0)
    speeds = [8.8, *_ride(command, 8.0)]
    assert -np.diff(speeds).min() <= 0.05 + 1e-9
    assert speeds[-1] == 5.0
    command.limits = replace(command.limits, speed_ceiling_mps=0.0)
    assert _ride(command, 8.0)[-1] == 0.0, '0 m/s is a limit, not none'


def test_a_profile_tells_its_progress_and_goes_on_where_it_was_paused() -> None:
    command = _command(Hold(1.0, 4.0, 0.5), Ramp(2.0, 0.5))
    assert (command.state, command.remaining_s) == ('idle', pytest.approx(6.0))
    command.start()
    _ride(command, 3.0)
    assert (command.state, command.elapsed_s) == ('running', pytest.approx(3.0))
    assert command.remaining_s == pytest.approx(2.0 + 4.0 + 2.0 - 3.0)
    command.stop()
    assert set(_ride(command, 3.0)) == {1.0}
    assert (command.state, command.elapsed_s) == ('paused', pytest.approx(3.0))
    command.resume()
    speeds = _ride(command, 6.0)
    assert (command.state, command.remaining_s) == ('finished', 0.0)
    assert speeds[-1] == pytest.approx(2.0)


def test_a_trip_slows_down_at_its_own_rate_and_never_up_and_a_stop_stands_above_it() -> None:
    command = _command(Hold(8.0, 100.0, 1.0))
    command.start()
    _ride(command, 12.0)
    assert command.trip(5.0, 8.0) == 5.0
    speeds = _ride(command, 5.0)
    assert -np.diff([8.0, *speeds]).min() == pytest.approx(0.05)
    assert speeds[-1] == 5.0
    assert not command.stopped
    assert 'hunt call rearm' in command.start()
    assert command.trip(6.0, 5.0) == 5.0, 'a second trip does not speed it up'
    assert command.trip(0.0, 5.0, stop=True) == 0.0
    assert command.trip(4.0, 5.0) == 0.0
    assert command.stopped
    assert _ride(command, 0.1)[0] == 0.0
    command.rearm()
    assert set(_ride(command, 2.0)) == {0.0}, 'nothing moves by itself'


def test_a_trip_on_the_way_up_does_not_go_on_up_where_the_roller_lags() -> None:
    command = _command(Hold(8.0, 100.0, 1.0))
    command.start()
    _ride(command, 6.0)
    command.trip(0.0, 5.5)
    speed = command.next(0.05, 5.5)
    assert speed == pytest.approx(5.45)


@pytest.mark.parametrize('silent_s', [1.0, 30.0, 1000.0])
def test_a_see_saw_whose_leg_ends_in_silence_goes_on(silent_s) -> None:
    """Not NaN for ever: the form of before holds, and the step comes to its end."""
    command = _command(Seesaw(300.0, watch_s=5.0))
    seen = {'amplitude_m': 1e-5, 'v_n': 6.4, 'v_c': 8.0, 'fold_amplitude_m': 4e-4}
    assert command.start(Motion(**seen)) == ''
    speeds = _ride(command, 88.0, 0.25, **seen)
    speeds += _ride(command, silent_s, 0.25)
    speeds += _ride(command, 500.0, 0.25, **seen)
    assert np.isfinite(speeds).all()
    assert command.state == 'finished'
    assert 6.0 < speeds[-1] < 6.5


def test_a_step_that_never_heard_of_a_form_stays_and_says_so() -> None:
    run = ProfileRun(Profile((Seesaw(30.0),)), 5.0)
    assert {run.advance(0.5, Motion()) for _ in range(100)} == {5.0}
    assert 'no normal form' in run.note
    assert run.finished


def test_a_profile_that_reacts_wants_an_amplitude_and_a_form() -> None:
    command = _command(Seesaw(300.0, watch_s=5.0))
    assert 'tells none' in command.start(Motion())
    assert 'v_n' in command.start(Motion(amplitude_m=1e-5))
