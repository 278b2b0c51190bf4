"""`hunt check` on live topics: what only a running rig shows."""

from __future__ import annotations

import json
import subprocess
import time

import numpy as np
from geometry_msgs.msg import TwistStamped
from processes import HUNT, joint
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

from hunt_ros.nodes.support.conversions import twist


def test_live_topics_two_publishers_and_a_clock_that_is_behind(graph) -> None:
    rig = graph.folder / 'rig.yaml'
    rig.write_text('/**: {ros__parameters: {channels: [lateral, yaw, speed]}}')
    lateral = graph.node.create_publisher(JointState, 'lateral', qos_profile_sensor_data)
    other = graph.beside('other')
    other.create_publisher(JointState, 'lateral', 10)
    speed = graph.node.create_publisher(TwistStamped, 'speed', 10)
    words = [*HUNT, 'check', '--rig', str(rig), '--directory', str(graph.folder)]
    words += ['--duration', '2', '--json', '-']
    asked = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    random = np.random.default_rng(3)

    def publish() -> None:
        now_ns = time.time_ns()
        lateral.publish(joint('lateral', now_ns, 1e-5 * random.standard_normal()))
        speed.publish(twist(now_ns - 1_000_000_000, 7.0))

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
    assert states['drive', '']['state'] == 'warn', 'nothing says that it stops by itself'
    other.destroy_node()
