"""The speed node: a drive that refuses or is gone, a clock that is set, and its interlock."""

from __future__ import annotations

import numpy as np
import pytest
import rclpy.clock
from geometry_msgs.msg import TwistStamped
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from speed_rig import UNGUARDED, Drive, Rig, node_on

from hunt_ros.errors import ConfigError
from hunt_ros.nodes.support.conversions import to_time
from hunt_ros.nodes.support.qos import latched

#: Largest step between two set points: what passes at most between them, and the default limit.
_STEP = 0.25 * 1.0 + 1e-9


def _step_clock(monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
    """Let every clock of ROS that follows the machine's be set ahead."""
    before = rclpy.clock.Clock.now

    def now(clock: rclpy.clock.Clock) -> Time:
        reading = before(clock)
        if clock.clock_type == rclpy.clock.ClockType.STEADY_TIME:
            return reading
        ahead = reading.nanoseconds + round(seconds * 1e9)
        return Time(nanoseconds=ahead, clock_type=clock.clock_type)

    monkeypatch.setattr(rclpy.clock.Clock, 'now', now)


def test_an_emergency_stop_says_whether_the_drive_took_it(graph, resident) -> None:
    drive = Drive(6.0)
    drive.breaks = True
    resident(node_on(drive), interlock=UNGUARDED)
    assert not graph.call('speed/emergency_stop').success
    graph.spin_until(lambda: drive.set_points)
    assert set(drive.set_points) == {0.0}, 'the stop stays in force until the drive can take it'
    graph.spin_until(lambda: graph.call('speed/emergency_stop').success)
    drive.refusal = 'drive: illegal data address'
    refused = graph.call('speed/emergency_stop')
    assert not refused.success
    assert drive.refusal in refused.message
    drive.refusal = ''
    graph.spin_until(lambda: graph.call('speed/emergency_stop').success)


def test_a_step_of_the_machines_clock_does_not_move_the_roller(
    graph, resident, monkeypatch
) -> None:
    drive = Drive(6.0)
    targets = graph.collect(TwistStamped, 'speed/target')
    profile = graph.profile('ramp: {speed_mps: 20.0, rate_mps2: 0.1}')
    Rig(graph, resident, drive, interlock=UNGUARDED, profile=profile)
    graph.spin_until(lambda: graph.call('speed/start_profile').success)
    graph.spin_until(lambda: len(targets) > 3)
    _step_clock(monkeypatch, 200.0)
    count = len(targets)
    graph.spin_until(lambda: len(targets) > count + 3)
    assert np.abs(np.diff(drive.set_points)).max() <= _STEP


def test_a_second_speed_node_of_the_same_name_refuses_to_start_or_is_an_error(
    graph, resident, detector
) -> None:
    drive = Drive(6.0)
    health = graph.told()
    profile = graph.profile('hold: {speed_mps: 6, duration_s: 9}')
    rig = Rig(graph, resident, drive, interlock='measure', profile=profile)
    rig.until(interlock_cause='no reason to trip')
    namesake = graph.beside('roller_speed')  # as of another machine, which holds its own names

    graph.spin_until(lambda: health.says('another node is named /rig/roller_speed'))
    graph.spin_until(lambda: 'commands the drive, too' in rig.status['message'])
    assert 'commands the drive, too' in graph.call('speed/rearm').message
    assert not graph.call('speed/start_profile').success
    namesake.destroy_node()
    graph.start('roller_speed')
    assert graph.wait('roller_speed') == 2
    last = graph.log('roller_speed').read_text().strip().splitlines()[-1]
    assert '/rig/roller_speed runs already' in last


#: The keys of `speed/status`, which others read.
KEYS = {
    'speed_mps', 'target_mps', 'profile', 'profile_state', 'profile_elapsed_s',
    'profile_remaining_s', 'interlock', 'interlock_state', 'interlock_cause',
    'interlock_since_ns', 'emergency_stop', 'safe_speed_mps', 'speed_ceiling_mps', 'alarm_kept',
    'interlock_code', 'operating_state',
    'displacement_m', 'ending',
}  # fmt: skip


def test_the_interlock_slows_the_roller_down_until_a_person_arms_it_again(
    graph, resident, detector
) -> None:
    drive = Drive(6.0)
    profile = graph.profile('hold: {speed_mps: 6, duration_s: 1000}')
    rig = Rig(graph, resident, drive, profile=profile)
    assert set(rig.status) == KEYS | {'level', 'name', 'message', 'stamp_ns'}
    graph.spin_until(lambda: graph.call('speed/start_profile').success)
    rig.until(profile_state='running', interlock_cause='no reason to trip')
    detector.level = 'ERROR'
    # Through v_n less the margin: the motion lasts.
    graph.spin_until(lambda: drive.set_points and drive.set_points[-1] == 0.0)
    rig.until(interlock_state='tripped', profile_state='paused', level='ERROR')
    assert np.abs(np.diff(drive.set_points)).max() <= _STEP
    for service in ('start_profile', 'resume_profile', 'rearm'):
        answer = graph.call(f'speed/{service}')
        assert not answer.success, service
        assert 'ERROR' in answer.message or 'rearm' in answer.message

    detector.level = 'WARN'
    graph.spin_until(lambda: graph.call('speed/rearm').success)
    graph.spin(0.3)
    assert drive.set_points[-1] == 0.0, 'nothing moves by itself'
    assert rig.arm(False).success
    assert graph.call('speed/resume_profile').success
    rig.until(interlock_state='disarmed', profile_state='running', level='WARN', target_mps='6.0')
    graph.spin_until(lambda: len(rig.events) >= 4)
    tripped = ['interlock_tripped'] * 2  # and that the safe speed is none
    assert rig.events == [*tripped, 'interlock_armed', 'interlock_disarmed']


def test_a_drive_is_silent_only_while_the_time_of_a_simulated_rig_goes_on(
    graph, resident, detector
) -> None:
    clock = graph.node.create_publisher(Clock, '/clock', 10)
    now_s = 1.0

    def tick() -> None:
        clock.publish(Clock(clock=to_time(round(now_s * 1e9))))

    graph.node.create_timer(0.02, tick)
    rig = Rig(graph, resident, drive := Drive(1.0), use_sim_time=True)
    graph.spin_until(lambda: rig.node.get_clock().now().nanoseconds > 0)
    # Armed it is from the start: the silence of a drive that never spoke is another matter.
    rig.until(interlock_state='armed', interlock_cause='no reason to trip')
    told = graph.told('speed/status', latched())
    drive.mute = True  # a simulated rig that waits for the detector says nothing
    graph.spin_until(lambda: len(told) > 30)  # 3 s of this machine
    assert rig.status['interlock_state'] == 'armed'
    now_s += 3.0
    rig.until(interlock_state='tripped')
    assert 'the drive has sent nothing for' in rig.status['interlock_cause']


def test_an_emergency_stop_that_the_encoder_does_not_show_is_no_success(graph, resident) -> None:
    drive = Drive(6.0)
    rig = Rig(graph, resident, drive, interlock=UNGUARDED)
    graph.spin_until(lambda: rig.status['speed_mps'] == '6.0')
    drive.obeys = False
    answer = graph.call('speed/emergency_stop')
    assert not answer.success
    assert 'the encoder shows 6.00 m/s' in answer.message
    assert 'hard-wired' in answer.message
    rig.until(emergency_stop='true', level='ERROR')
    drive.obeys = True
    assert graph.call('speed/emergency_stop').success


def test_a_speed_node_without_a_profile_says_so(graph, resident) -> None:
    Rig(graph, resident, Drive(6.0), interlock=UNGUARDED)
    assert graph.call('speed/start_profile').message == 'no profile is given'


def test_a_profile_above_the_ceiling_is_refused_at_the_start(graph, resident) -> None:
    above = graph.profile('ramp: {speed_mps: 9.0}')
    with pytest.raises(ConfigError, match=r'step 1 \(ramp\): 9 m/s is above the ceiling, 8 m/s'):
        Rig(graph, resident, Drive(6.0), speed_ceiling_mps=8.0, profile=above)
