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
