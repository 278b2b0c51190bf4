"""Which set point comes next, and how far it may be from the one before."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.drivers.command import RollerCommand
from hunt_ros.drivers.profile import ProfileRunner


def _command(times=(0.0, 10.0), speeds=(0.0, 10.0), acceleration=1.0) -> RollerCommand:
    return RollerCommand(ProfileRunner(times, speeds), acceleration, longest_step_s=0.5)


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
    command = _command(times=(0.0, 5.0, 5.0), speeds=(0.0, 20.0, 3.0), acceleration=2.0)
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
    command = _command(speeds=(8.0, 8.0))
    command.start()
    _next(command, 0.1, 8.0)
    assert command.emergency_stop(0.0, 8.0) == 0.0
    assert _next(command, 0.0) == 0.0
    assert 'rearm' in command.start()
    assert 'rearm' in command.resume()
    assert command.emergency_stop(2.0, 0.5) == 0.5
    assert command.emergency_stop(2.0, math.nan) == 2.0


def test_after_a_rearm_or_a_deactivation_nothing_moves_by_itself() -> None:
    command = _command()
    command.start()
    _next(command, 0.5)
    command.emergency_stop(0.0, 0.5)
    command.rearm()
    assert {_next(command, 0.5, 0.5) for _ in range(5)} == {0.0}
    command.start()
    _next(command, 0.5)
    command.let_go()
    assert command.next(0.5, 0.5) is None
    assert command.resume() == ''
    assert _next(command, 0.1, 0.5) == pytest.approx(0.6)


def test_a_stopped_profile_holds_what_the_drive_was_told_not_where_the_ramp_leads() -> None:
    command = _command(times=(0.0,), speeds=(6.0,))
    command.start()
    _next(command, 0.5)
    assert _next(command, 0.5) == pytest.approx(1.0)
    command.stop()
    assert _next(command, 0.5) == pytest.approx(1.0)
