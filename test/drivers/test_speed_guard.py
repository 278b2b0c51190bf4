"""Set points that go through a mailbox of one to a drive that takes its time."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest

from hunt_ros.drivers.base import DriveBlock
from hunt_ros.drivers.command import DriveLimits
from hunt_ros.drivers.interlock import Heard, InterlockSettings
from hunt_ros.drivers.safety_state import SafetyState, read
from hunt_ros.drivers.speed_guard import SpeedGuard
from hunt_ros.dynamics.profile import Hold, Motion, Profile
from hunt_ros.errors import ConfigError


class _Slow:
    def __init__(self) -> None:
        self.taken: list[float] = []
        self.refuses = False

    def set_speed(self, speed_mps: float) -> None:
        if self.refuses:
            raise OSError('not now')
        self.taken.append(speed_mps)


def _guard(state: SafetyState | None = None) -> SpeedGuard:
    settings = InterlockSettings()
    return SpeedGuard(DriveLimits(), settings, 0.0, state or SafetyState(), longest_step_s=0.25)


def test_the_newest_counts_and_what_is_refused_is_not_what_the_drive_has() -> None:
    guard, drive = _guard(), _Slow()
    guard.post(5.0, 1)
    guard.post(4.0, 2)
    assert guard.hand_over(drive) == 4.0
    assert (drive.taken, guard.taken, guard.answered) == ([4.0], (4.0, 2), 2)
    assert guard.hand_over(drive) is None
    drive.refuses = True
    for speed in (3.0, 2.0):
        guard.post(speed, 3)
        assert guard.hand_over(drive) is None
    assert (drive.taken, guard.refused, guard.refusal) == ([4.0], 2, 'OSError: not now')
    assert guard.taken == (4.0, 2), 'what the drive has'


def test_the_way_down_goes_on_though_no_set_point_is_answered() -> None:
    """It may arrive all the same; once a second, as where each time a line is opened for it."""
    guard, drive = _guard(), _Slow()
    second = 10**9
    guard.post(6.0, second)
    guard.hand_over(drive)
    guard.end()
    drive.refuses = True
    for now_ns in range(2 * second, 9 * second, second):
        guard.decide(now_ns, now_ns, there=True)
        guard.hand_over(drive)
    assert guard.target_mps == 0.0
    assert guard.refused == 7


@pytest.mark.parametrize(('mode', 'state'), [('off', 'armed'), ('protect', 'disarmed')])
def test_who_was_disarmed_by_a_person_stays_so_and_not_by_a_parameter_of_before(
    tmp_path, mode, state
) -> None:
    before = SpeedGuard(DriveLimits(), InterlockSettings(interlock=mode), 0.0, SafetyState())
    before.arm(0, False)
    (tmp_path / 'state').write_text(before.unsaved(running=False))
    after = SpeedGuard(DriveLimits(), InterlockSettings(), 0.0, read(tmp_path / 'state'))
    assert (after.interlock.state, after.interlock.goal_mps) == (state, math.inf)


@pytest.mark.parametrize('mps', [0.0, 3.0, 6.0])
@pytest.mark.parametrize('rearm', [False, True])
def test_a_speed_node_that_was_killed_sets_no_roller_going(mps, rearm) -> None:
    """It starts tripped, with the safe speed of before; the roller may stand."""
    guard, drive = _guard(SafetyState(running=True, goal_mps=4.5)), _Slow()
    assert guard.interlock.goal_mps == 4.5
    guard.reconfigure(0, InterlockSettings(interlock='off'))
    for step in range(1, 100):
        now_ns = step * 50_000_000
        if rearm and step in (1, 50):
            guard.rearm(now_ns)
        guard.hand_over(drive)
        speeds = np.array([drive.taken[-1] if drive.taken else mps])
        angle = np.array([np.nan])
        guard.readings.take(now_ns / 1e9, DriveBlock(np.array([now_ns]), angle, speeds))
        guard.decide(now_ns, now_ns, True)
    assert all(b <= a for a, b in itertools.pairwise([mps, *drive.taken]))
    assert not drive.taken if rearm else drive.taken[-1] == min(mps, 4.5)


@pytest.mark.parametrize('text', ['', '{"running": 7', '7', '[' * 100_000, '\udcff', '{}'])
def test_a_file_of_any_content_is_a_state_or_damaged(tmp_path, text) -> None:
    path = tmp_path / 'state'
    path.write_bytes(text.encode(errors='surrogateescape'))
    with pytest.raises(ConfigError, match='cannot read the safety state'):
        read(path)


def test_a_set_point_falls_by_the_time_since_the_one_that_the_drive_has() -> None:
    guard, drive, begin_ns = _guard(), _Slow(), 7_000_000_000
    guard.post(8.0, begin_ns)
    guard.hand_over(drive)
    guard.command.taken(8.0)
    guard.command.trip(6.0, 8.0)
    for now_ms in (100, 200):  # the first one is replaced before the drive takes it
        now_ns = begin_ns + now_ms * 1_000_000
        guard.decide(now_ns, now_ns, True)
    assert guard.hand_over(drive) == pytest.approx(7.8)
    now_ns += 50_000_000
    guard.decide(now_ns, now_ns, True)
    assert guard.hand_over(drive) == pytest.approx(7.75)


def test_what_a_drive_said_before_it_fell_silent_is_not_its_speed() -> None:
    silent_s = [0.0]
    guard = SpeedGuard(
        DriveLimits(), InterlockSettings(), 0.0, SafetyState(), silent_s=lambda: silent_s[0]
    )
    speeds, stamps_ns = np.array([3.0]), np.array([1])
    guard.readings.take(0.0, DriveBlock(stamps_ns, np.array([np.nan]), speeds))
    assert guard.measured_mps == 3.0
    silent_s[0] = 9.0
    assert math.isnan(guard.measured_mps)
    assert guard.trouble() == ('STALE', 'the drive has sent nothing for 9.0 s')


def test_a_profile_starts_by_itself_once() -> None:
    settings = InterlockSettings(interlock='off')
    guard = SpeedGuard(DriveLimits(), settings, 0.0, SafetyState(), autostart=True)
    guard.command.profile = Profile((Hold(5.0, 1.0),))
    guard.decide(1, 1, True)
    assert (guard.autostart, guard.command.state) == (False, 'running')


@pytest.mark.parametrize('seed', range(20))
def test_no_set_point_of_a_trip_rises_however_late_the_drive_takes_it(seed) -> None:
    """Ticks and hand-overs in any order, and goals that are lowered on the way."""
    rng, guard, drive = np.random.default_rng(seed), _guard(), _Slow()
    guard.post(8.0, 1)
    guard.hand_over(drive)
    guard.command.taken(8.0)
    guard.command.trip(6.0, 8.0)
    now_ns = 1
    for _ in range(400):
        now_ns += int(rng.integers(1, 200_000_000))
        if rng.random() < 0.5:
            guard.hand_over(drive)
            continue
        if rng.random() < 0.2:
            guard.command.trip(guard.target_mps - 0.5, guard.target_mps)
        guard.decide(now_ns, now_ns, True)
    assert all(b <= a for a, b in itertools.pairwise(drive.taken))
    assert drive.taken[-1] < 6.0


def test_a_trip_of_the_run_before_says_since_when_however_often_it_starts() -> None:
    cause = 'the detector says ERROR: limit cycle'
    line = {'at': '2026-11-28T10:02:11.123+00:00', 'what': 'interlock_tripped', 'why': cause}
    guard = _guard(SafetyState(trip=cause, history=({**line, 'who': ''},)))
    told = 'before this start, at 2026-11-28 10:02:11 UTC; until rearmed (hunt call rearm): '
    told += cause
    assert guard.interlock.cause == told
    kept = json.loads(guard.unsaved(running=False))
    again = _guard(SafetyState(trip=kept['trip'], history=tuple(kept['history'])))
    assert again.interlock.cause == told


def test_an_end_is_called_no_trip() -> None:
    guard = _guard()
    guard.end()
    assert guard.present()[1].startswith('the end: the roller goes to 0.00 m/s')


def test_who_asked_is_in_the_history_and_in_the_event() -> None:
    guard = _guard()
    change, _ = guard.arm(0, False, 'mia@pc (console)')
    assert change.cause == 'disarmed by mia@pc (console): nothing slows the roller'
    guard.emergency_stop(0, 'leo@pc (dashboard)')
    guard.rearm(0)
    history = json.loads(guard.unsaved(running=True))['history']
    assert [(line['what'], line['who']) for line in history[1:]] == [
        ('interlock_disarmed', 'mia@pc (console)'),
        ('emergency_stop', 'leo@pc (dashboard)'),
        ('rearmed', ''),
    ]


@pytest.mark.parametrize(
    ('speed', 'target', 'state'),
    [(0.0, 0.0, 'parked'), (0.0, 2.0, 'protect'), (2.0, 0.0, 'protect')],
)
def test_a_roller_that_stands_and_is_to_is_parked(speed, target, state) -> None:
    guard = _guard()
    guard.post(target, 1)
    guard.hand_over(_Slow())
    for k in range(3):
        block = DriveBlock(np.array([k]), np.array([math.nan]), np.array([speed]))
        guard.readings.take(10.0 + k, block)
    guard.watch(round(12.1e9), round(12.1e9))
    assert guard.values()['operating_state'] == state


@pytest.mark.parametrize(('mps', 'state'), [(0.0, 'parked'), (0.03, 'protect')])
def test_a_roller_that_creeps_is_not_parked(mps, state) -> None:
    """A set point of before may be in the drive: this guard has sent none."""
    guard = SpeedGuard(DriveLimits(), InterlockSettings(), 0.3, SafetyState())
    jitter = np.random.default_rng(1).normal(0.0, 1e-3, 100)  # a count of the encoder or so
    for k in range(100):
        now_s = 0.02 * k
        angle = np.array([mps * now_s / 0.15 + jitter[k]])
        guard.readings.take(now_s, DriveBlock(np.array([k]), angle, np.array([mps])))
    guard.watch(round(2e9), round(2e9))
    assert guard.values()['operating_state'] == state


def test_who_disarms_a_measurement_is_called_for_hunting_again() -> None:
    settings = InterlockSettings(interlock='measure')
    guard = SpeedGuard(DriveLimits(), settings, 0.0, SafetyState())
    assert guard.values()['operating_state'] == 'measure'
    guard.arm(0, False)
    assert guard.values()['operating_state'] == 'off', 'no limit of the amplitude trips either'


@pytest.mark.parametrize('reached', [False, True])
def test_a_way_down_that_was_over_does_not_begin_again(tmp_path, reached) -> None:
    """The drive is deaf: the roller turns on at 7.6 m/s."""
    path = tmp_path / 'state'
    path.write_text(SafetyState(trip='why', goal_mps=0.0, there=reached).to_json())
    guard, drive = _guard(read(path)), _Slow()
    for k in range(1, 40):
        now_ns = k * 50_000_000
        block = DriveBlock(np.array([k]), np.array([math.nan]), np.array([7.6]))
        guard.readings.take(now_ns * 1e-9, block)
        guard.decide(now_ns, now_ns, there=True)
        guard.hand_over(drive)
    assert drive.taken[0] == (0.0 if reached else pytest.approx(7.6, abs=0.1))
    assert all(np.diff(drive.taken) <= 0.0)
    assert json.loads(guard.unsaved(running=True))['there'] is reached


def test_a_speed_node_that_dies_after_a_stop_has_ended_holds_nothing_up(tmp_path) -> None:
    """The roller is still on its way to what the stop asked for; nobody asked for another."""
    path, drive, mps = tmp_path / 'state', _Slow(), 5.0
    guard = _guard(SafetyState())
    guard.interlock.hear(0, Heard('OK', motion=Motion(v_n=6.0)))
    for k in range(1, 100):
        if k == 40:  # it died, and is started again
            path.write_text(guard.unsaved(running=True))
            guard = _guard(read(path))
        now_ns = k * 50_000_000
        block = DriveBlock(np.array([k]), np.array([math.nan]), np.array([mps]))
        guard.readings.take(now_ns * 1e-9, block)
        if k == 10:
            guard.emergency_stop(now_ns)
        if k == 20:
            guard.interlock.arm(now_ns, False)
            assert guard.rearm(now_ns)[1] == ''
        guard.decide(now_ns, now_ns, there=True)
        guard.hand_over(drive)
        mps = max(0.0, mps - 0.05) if drive.taken else mps
    assert guard.command.forced, 'tripped'
    assert {*drive.taken} == {0.0}
