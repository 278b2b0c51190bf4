"""`hunt check` on live topics: what only a running rig shows."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

pytestmark = pytest.mark.ros


def test_live_topics_two_publishers_and_a_clock_that_is_behind(graph) -> None:
    rig = graph.folder / 'rig.yaml'
    rig.write_text('/**: {ros__parameters: {channels: [lateral, yaw, speed]}}')
    lateral = graph.node.create_publisher(JointState, 'lateral', qos_profile_sensor_data)
    other = graph.beside('other')
    other.create_publisher(JointState, 'lateral', 10)
    speed = graph.node.create_publisher(TwistStamped, 'speed', 10)
    words = [sys.executable, '-m', 'hunt_ros.cli.main', 'check', '--rig', str(rig)]
    words += ['--duration', '2', '--json', '-', '--directory', str(graph.folder)]
    asked = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    random, number = np.random.default_rng(3), 0

    def publish() -> None:
        nonlocal number
        number += 1
        message = JointState(name=['lateral'], position=[1e-5 * random.standard_normal()])
        message.header.stamp = graph.node.get_clock().now().to_msg()
        lateral.publish(message)
        twist = TwistStamped(header=message.header)
        twist.header.stamp.sec -= 1
        twist.twist.linear.x = 7.0
        speed.publish(twist)

    graph.node.create_timer(0.005, publish)
    graph.spin_until(lambda: asked.poll() is not None, 60.0)
    found = json.loads(asked.communicate()[0])
    assert asked.returncode == 1
    states = {(one['check'], one['channel']): one for one in found['checks']}
    assert states['publishers', 'lateral']['value'] == 2
    assert '/rig/other' in states['publishers', 'lateral']['text']
    assert states['publishers', 'yaw']['value'] == 0
    assert states['rate', 'lateral']['value'] > 0.0, 'best effort is heard'
    assert states['clock', 'speed']['state'] == 'warn'
    assert 'PTP' in states['clock', 'speed']['advice']
    assert states['clock', 'speed']['value'] >= 1.0
    assert states['disk', '']['value'] > 0.0
    assert states['alarm', '']['state'] == 'warn', 'the rig file names no output'
    other.destroy_node()
