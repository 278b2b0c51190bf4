"""The speed node where a process, the drive, a sensor or the form fails: through real nodes."""

from __future__ import annotations

import itertools
import json
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from processes import joint
from rclpy.duration import Duration
from sensor_msgs.msg import JointState
from speed_rig import UNGUARDED, Drive, Rig
from std_msgs.msg import String

from hunt_ros.dynamics.profile import Profile
from hunt_ros.nodes.support.qos import latched, stream

HOLD = 'hold: {speed_mps: 6, duration_s: 1000, rate_mps2: 20}'


def _held_at(graph, resident, detector, drive: Drive, **parameters: object) -> Rig:
    """Return a rig whose profile holds 6 m/s, and whose interlock has seen that all is well."""
    rig = Rig(graph, resident, drive, profile=graph.profile(HOLD), **parameters)
    graph.spin_until(lambda: graph.call('speed/start_profile').success)
    graph.spin_until(lambda: 6.0 in drive.set_points)
    rig.until(interlock_cause='no reason to trip')
    return rig


def test_a_drive_that_hangs_holds_up_neither_the_watch_nor_an_emergency_stop(
    graph, resident, detector
) -> None:
    drive = Drive(6.0)
    rig = _held_at(graph, resident, detector, drive)
    told = graph.told('speed/status', latched())
    drive.released.clear()
    graph.spin_until(lambda: drive.hangs)
    sent = len(drive.set_points)
    detector.level = 'ERROR'
    rig.until(interlock_state='tripped')
    assert not graph.call('speed/emergency_stop').success
    count = len(told)
    graph.spin_until(lambda: len(told) > count + 5)
    assert len(drive.set_points) == sent, 'it hung all the time'
    drive.released.set()
    graph.spin_until(lambda: drive.set_points[-1] == 0.0)
    assert graph.call('speed/emergency_stop').success


def test_polling_stops_where_nothing_decides_any_more(graph, resident, detector) -> None:
    """So a drive with a watchdog of its own finds out."""
    drive = Drive(6.0)
    rig = _held_at(graph, resident, detector, drive)
    with rig.node._guard.deciding:  # the executor hangs at its next look
        graph.spin(1.0)
        reads, sent = drive.reads, len(drive.set_points)
        graph.spin(0.5)
        assert (drive.reads, len(drive.set_points)) == (reads, sent)
    graph.spin_until(lambda: drive.reads > reads + 5)


def test_a_driver_that_fails_to_close_is_opened_again(graph, resident, detector) -> None:
    drive = Drive(6.0)
    rig = _held_at(graph, resident, detector, drive)
    assert drive.opened == 1
    drive.breaks = True
    rig.until(interlock_state='tripped')
    graph.spin_until(lambda: drive.opened == 2)
    graph.spin_until(lambda: drive.set_points[-1] == 4.5)
    assert graph.call('speed/emergency_stop').success


def test_a_drive_whose_readings_fail_is_taken_down_all_the_same(graph, resident, detector) -> None:
    """Its answers come late, or are those of another device: it may obey."""
    drive = Drive(6.0)
    rig = _held_at(graph, resident, detector, drive)
    drive.unreadable = True
    rig.until(interlock_state='tripped')
    graph.spin_until(lambda: drive.speed_mps == 4.5)


def test_five_millimetres_on_the_sensor_trip_it_though_no_detector_speaks(graph, resident) -> None:
    drive = Drive(6.0)
    lateral = graph.node.create_publisher(JointState, 'lateral', 1000)
    rig = Rig(graph, resident, drive, amplitude_limit_m=3e-3, interlock='measure')
    count = itertools.count()

    def move() -> bool:
        for k in itertools.islice(count, 10):
            stamp_ns = time.time_ns() + 2_000_000 * (k % 10)
            lateral.publish(joint('lateral', stamp_ns, 5e-3 * np.sin(0.1 * k)))
        return rig.status['interlock_state'] == 'tripped'

    graph.spin_until(move)
    assert 'above the limit, 3.000 mm' in rig.status['interlock_cause']
    assert float(rig.status['displacement_m']) > 3e-3


def test_hunting_that_the_detector_is_not_sure_of_any_more_takes_the_roller_lower(
    graph, resident, detector
) -> None:
    """Gauntlet 504: v_n told too high, and a sensor that has just come back; it never died."""
    drive = Drive(6.0)
    detector.numbers |= {'v_n_mps': 9.6, 'v_c_mps': 12.0, 'noise_floor_m': 1e-5}
    rig = _held_at(graph, resident, detector, drive, safe_deceleration_mps2=20.0)
    detector.numbers |= {'amplitude_m': 8e-4, 'state': 'limit_cycle'}
    detector.level = 'ERROR'
    rig.until(interlock_state='tripped')
    detector.numbers['state'] = 'disturbed'
    detector.level = 'WARN'
    graph.spin_until(lambda: drive.speed_mps == 0.0)
    assert 'not died out at 9.10 m/s' in rig.status['interlock_cause']


def test_the_death_of_who_started_it_is_seen_though_the_roller_is_where_it_is_safe(
    graph, resident, detector, monkeypatch
) -> None:
    """The signal of that death may come before the last thread of the dead has gone."""
    drive = Drive(6.0)
    rig = _held_at(graph, resident, detector, drive, safe_deceleration_mps2=20.0)
    graph.spin_until(rig.node.wind_down)
    assert drive.speed_mps == pytest.approx(4.5, abs=0.1)
    monkeypatch.setattr(os, 'getppid', lambda: 1)
    graph.spin_until(lambda: rig.node.wind_down() and drive.speed_mps < 0.1)


def test_an_emergency_stop_is_a_stop_and_no_clock_changes(graph, resident, detector) -> None:
    drive = Drive(6.0)
    rig = _held_at(graph, resident, detector, drive)
    assert rig.set(use_sim_time=True) == (False, 'use_sim_time: taken at the start only')
    assert graph.call('speed/emergency_stop').success
    assert drive.speed_mps == 0.0


@pytest.mark.parametrize('amplitude_m', [8e-4, 1e-5])
def test_a_run_that_ends_while_it_hunts_ends_at_a_stop(
    graph, resident, detector, amplitude_m
) -> None:
    drive = Drive(6.0)
    detector.numbers['noise_floor_m'] = 1e-5
    limits = {'interlock': 'measure', 'safe_deceleration_mps2': 20.0}
    rig = _held_at(graph, resident, detector, drive, **limits)
    detector.numbers['amplitude_m'] = amplitude_m
    detector.level = 'OK' if amplitude_m == 1e-5 else 'ERROR'
    graph.spin(0.5)
    graph.spin_until(rig.node.wind_down)
    assert drive.speed_mps == pytest.approx(4.5 if detector.level == 'OK' else 0.0, abs=0.1)


def test_a_roller_that_is_left_as_it_is_trips_nothing(graph, resident, detector) -> None:
    """Its rig ends at the same moment, where it is a simulated one."""
    drive = Drive(6.0)
    rig = _held_at(graph, resident, detector, drive, slow_down_at_end=False)
    assert rig.node.wind_down()
    drive.breaks = True
    graph.spin_until(lambda: drive.opened == 2)
    graph.spin(0.5)
    assert rig.events == []


@pytest.mark.parametrize('end', ['emergency_stop', 'stop_profile'])
def test_after_any_stop_no_profile_starts_by_itself(graph, resident, detector, end) -> None:
    drive = Drive(6.0)
    detector.level = 'STALE'
    profile = graph.profile('hold: {speed_mps: 6, duration_s: 1000}')
    rig = Rig(graph, resident, drive, profile=profile, profile_autostart=True)
    graph.spin_until(lambda: 'the profile waits' in rig.status['message'])
    graph.call(f'speed/{end}')
    detector.level = 'OK'
    graph.spin_until(lambda: rig.status['interlock_cause'] == 'no reason to trip')
    assert graph.call('speed/rearm').success
    graph.spin(1.0)
    assert not any(drive.set_points)
    assert rig.status['profile_state'] == 'idle'
    assert graph.call('speed/start_profile').success


def _restarted(graph, **parameters: object) -> list[TwistStamped]:
    """Start the speed node of the simulated rig again; return the set points of it."""
    targets = graph.collect(TwistStamped, 'speed/target')
    graph.start('roller_speed', port=graph.port, **parameters)
    return targets


@pytest.mark.slow
@pytest.mark.parametrize('stop', ['emergency_stop', ''])
def test_what_was_in_force_is_in_force_again_after_a_kill(graph, stop) -> None:
    speeds = graph.collect(TwistStamped, 'speed')
    statuses = graph.told('speed/status', latched())
    kept = graph.folder / 'recordings' / '.speed_state.json'
    settings = {
        'interlock': UNGUARDED if stop else 'measure',
        'state_file': kept,
        'profile': graph.profile('hold: {speed_mps: 5, duration_s: 100, rate_mps2: 1.0}'),
        'profile_autostart': True,
    }
    graph.start('rig_simulator', port=graph.port, initial_speed_mps=3.0)
    _restarted(graph, **settings)
    graph.spin_until(lambda: speeds)
    if stop:
        graph.spin_until(lambda: speeds[-1].twist.linear.x > 3.3)
        assert graph.call('speed/emergency_stop').success
        graph.spin_until(lambda: 'asked for' in kept.read_text())
    graph.spin_until(lambda: kept.exists() and json.loads(kept.read_text())['running'])
    graph.end('roller_speed', signal.SIGKILL)
    statuses.clear()
    count = len(speeds)
    _restarted(graph, **settings)
    graph.spin_until(lambda: statuses and len(speeds) > count + 100)

    words = 'emergency stop' if stop else 'ended without being asked'
    graph.spin_until(
        lambda: statuses.last['level'] == 'ERROR' and words in statuses.last['message']
    )
    refused = graph.call('speed/start_profile')
    assert not refused.success
    assert 'rearm' in refused.message
    graph.spin_until(lambda: speeds[-1].twist.linear.x < 0.1)
    if not stop:
        return
    assert graph.call('speed/rearm').success
    graph.spin(1.0)
    assert speeds[-1].twist.linear.x < 0.1, 'no autostart after it'
    assert graph.end('roller_speed') == 0
    state = json.loads(kept.read_text())
    assert not any(state[key] for key in ('running', 'emergency_stop', 'trip'))
    assert [line['what'] for line in state['history']][-1] == 'rearmed'


def test_a_state_that_cannot_be_read_is_a_trip(graph, resident, detector, tmp_path: Path) -> None:
    path = tmp_path / 'state.json'
    path.write_text('{"running": 7')
    rig = Rig(graph, resident, Drive(6.0), state_file=path)
    rig.until(interlock_state='tripped')
    assert 'cannot read the safety state' in rig.status['interlock_cause']
    graph.spin_until(lambda: graph.call('speed/rearm').success)
    graph.spin_until(lambda: json.loads(path.read_text())['trip'] == '')


def test_a_disk_that_takes_no_state_is_said_and_guards_on(graph, resident, detector) -> None:
    health = graph.told()
    drive = Drive(6.0)
    rig = _held_at(graph, resident, detector, drive, state_file='/proc/state.json')
    graph.spin_until(lambda: health.says('safety state failed'))
    detector.level = 'ERROR'
    rig.until(interlock_state='tripped')
    graph.spin_until(lambda: drive.set_points[-1] == 0.0)


def test_an_alarm_that_nobody_acknowledged_outlives_its_detector(
    graph, resident, detector
) -> None:
    rig = Rig(graph, resident, Drive(6.0))
    detector.alarm = True
    graph.spin_until(lambda: detector.sent > 30)
    detector._sequence = 0  # killed and started again: it knows of nothing
    detector.alarm = False
    rig.until(alarm_kept='its reasons')
    assert graph.call('speed/rearm').success
    rig.until(alarm_kept='')
    detector.alarm = True
    graph.spin(0.5)
    detector.alarm = False  # acknowledged
    graph.spin(0.5)
    assert rig.status['alarm_kept'] == ''


def test_who_disarms_is_told_and_words_that_are_none_end_nothing(
    graph, resident, detector
) -> None:
    drive = Drive(6.0)
    rig = _held_at(graph, resident, detector, drive)
    words = graph.node.create_publisher(String, 'roller_speed/calls', stream(10))
    graph.spin_until(words.get_subscription_count)
    said = {'service': 'disarm-interlock', 'who': 'mia@pc', 'words': ''}
    for text in ('no JSON', '[]', '{"service": "disarm-interlock"}', json.dumps(said)):
        words.publish(String(data=text))
    assert words.wait_for_all_acked(Duration(seconds=30.0))
    assert rig.arm(False).success
    rig.until(interlock_cause='disarmed by mia@pc: nothing slows the roller')
    # Who calls waits until one reader of its words is there: another one might still hear nothing.
    assert words.get_subscription_count() == 1


def test_nobody_can_make_a_speed_node_inactive(graph, resident, detector) -> None:
    Rig(graph, resident, Drive(8.0))
    services = [name for name, _ in graph.node.get_service_names_and_types()]
    assert '/rig/speed/emergency_stop' in services
    assert not [name for name in services if name.endswith('/change_state')]


def test_parameters_set_together_are_judged_together(graph, resident, detector) -> None:
    fast = graph.profile('ramp: {speed_mps: 8.0}')
    rig = Rig(graph, resident, Drive(6.0), interlock=UNGUARDED, profile=fast)
    taken, reason = rig.set(speed_ceiling_mps=5.0, safe_speed_mps=4.0)
    assert not taken
    assert '8 m/s is above the ceiling, 5 m/s' in reason
    graph.spin(0.5)
    assert rig.status['speed_ceiling_mps'] == 'inf', 'what was refused has no effect'
    assert rig.set(speed_ceiling_mps=12.0, safe_speed_mps=4.0) == (True, '')
    # 0 m/s forbids motion.
    assert not rig.set(speed_ceiling_mps=0.0)[0]
    rig.set(interlock='protect')
    graph.spin_until(lambda: rig.status['safe_speed_mps'] == '4.0')
    taken, reason = rig.set(safe_speed_mps=5.0)
    assert not taken
    assert 'not below v_n' in reason
    assert rig.set(safe_speed_mps=0.0)[0]
    rig.until(safe_speed_mps='0.0')


def test_a_check_that_fails_refuses_the_parameter(graph, resident, detector, monkeypatch) -> None:
    rig = Rig(graph, resident, Drive(6.0), profile=graph.profile(HOLD))
    monkeypatch.setattr(Profile, 'check', lambda profile, ceiling_mps: {}[ceiling_mps])
    taken, reason = rig.set(speed_ceiling_mps=9.0)
    assert not taken
    assert reason.startswith('KeyError: ')
