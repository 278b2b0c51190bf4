"""The simulated rig and its speed node: profile, emergency stop, rearm, over the drive link."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import JointState

from hunt_ros.nodes.support.conversions import to_ns

#: Mode of the interlock; without quotes ROS takes the word for `false`.
UNGUARDED = "'off'"

pytestmark = pytest.mark.ros


def test_the_roller_follows_the_profile_and_the_angle_follows_the_roller(graph) -> None:
    speeds = graph.collect(TwistStamped, 'speed')
    targets = graph.collect(TwistStamped, 'speed/target')
    angles = graph.collect(JointState, 'roller')
    graph.start('rig_simulator', port=graph.port, initial_speed_mps=6.0)
    graph.start(
        'roller_speed',
        port=graph.port,
        interlock=UNGUARDED,
        profile=graph.profile('corners: {times_s: [0, 1], speeds_mps: [6.0, 6.5]}'),
    )
    graph.spin_until(lambda: len(speeds) > 20)
    assert not targets, 'the drive must be left alone until a profile starts'
    assert graph.call('speed/start_profile').success
    graph.spin_until(lambda: speeds[-1].twist.linear.x > 6.49)
    at_s = np.array([to_ns(message.header.stamp) for message in angles]) / 1e9
    # Where the machine was held up the simulated rig stood still: readings are 0.01 s of its time
    # apart, and stamps a whole number of that.
    steps = np.diff(at_s) / 0.01
    assert np.median(steps) == pytest.approx(1.0, abs=1e-3)
    assert steps == pytest.approx(np.rint(steps), abs=1e-3)
    turned = angles[-1].position[0] - angles[0].position[0]
    speed_s = [to_ns(message.header.stamp) / 1e9 for message in speeds]
    speed = np.interp(at_s, speed_s, [message.twist.linear.x for message in speeds])
    assert turned == pytest.approx(0.01 * speed[1:].sum() / 0.15, rel=0.01)


@pytest.mark.slow
def test_an_emergency_stop_holds_until_it_is_rearmed_and_then_nothing_moves_by_itself(
    graph,
) -> None:
    speeds = graph.collect(TwistStamped, 'speed')
    graph.start('rig_simulator', port=graph.port, initial_speed_mps=2.0)
    graph.start(
        'roller_speed',
        port=graph.port,
        interlock=UNGUARDED,
        profile=graph.profile('hold: {speed_mps: 2.0, duration_s: 100, rate_mps2: 1.0}'),
    )
    graph.spin_until(lambda: speeds)
    assert not graph.call('speed/resume_profile').success
    assert graph.call('speed/start_profile').success
    assert graph.call('speed/emergency_stop').success
    graph.spin_until(lambda: speeds[-1].twist.linear.x < 0.05)
    refused = graph.call('speed/start_profile')
    assert not refused.success
    assert 'rearm' in refused.message
    assert graph.call('speed/rearm').success
    graph.spin(1.0)
    assert speeds[-1].twist.linear.x < 0.05
    assert graph.call('speed/resume_profile').success
    graph.spin_until(lambda: speeds[-1].twist.linear.x > 1.9)


def test_a_profile_that_is_none_ends_the_node_with_one_line(graph) -> None:
    graph.start('roller_speed', profile=graph.profile('hold: {speed_mps: 6, duration_s: -1}'))
    assert graph.wait('roller_speed') == 2
    last = graph.log('roller_speed').read_text().strip().splitlines()[-1]
    assert 'profile.yaml, step 1 (hold): duration_s: -1.0 is below 0 s' in last
