"""What several tests of nodes share: processes, messages, a wheelset."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import JointState

from hunt_ros.nodes.support.conversions import joint_writer, to_time, twist
from hunt_ros.nodes.support.qos import stream

#: What starts the program.
HUNT = [sys.executable, '-u', '-m', 'hunt_ros.cli.main']


def children(parent: int, word: str) -> list[int]:
    """Return the processes that a process has started with this word on their command line."""
    found = []
    for path in Path('/proc').glob('[0-9]*'):
        try:
            started_by = int((path / 'stat').read_text().rpartition(')')[2].split()[1])
            words = (path / 'cmdline').read_bytes().split(b'\0')
        except OSError:
            continue  # it ended meanwhile
        if started_by == parent and word.encode() in words:
            found.append(int(path.name))
    return found


def joint(name: str, stamp_ns: int, value: float) -> JointState:
    """Return a reading."""
    message = JointState(name=[name], position=[value])
    message.header.stamp = to_time(stamp_ns)
    return message


class Wheelset:
    """
    Publishes what the sensors of a wheelset at 7.2 m/s say, as time passes, from now on.

    Attributes
    ----------
    amplitude_m : float
        Of a steady motion at the frequency of hunting; `noise` 1: with that of usual sensors.
    muted : set of str
        Channels that say nothing.
    """

    def __init__(self, graph, amplitude_m: float, noise: float = 1.0, behind_ns: int = 0) -> None:
        self.amplitude_m, self._noise = amplitude_m, noise
        self.muted: set[str] = set()
        self._rng = np.random.default_rng(0)
        node = graph.node
        self._joints = {
            name: (
                node.create_publisher(JointState, name, stream(1000)),
                joint_writer([name]),
            )
            for name in ('lateral', 'yaw', 'roller')
        }
        self._speed = node.create_publisher(TwistStamped, 'speed', stream(1000))
        self._now_ns = lambda: node.get_clock().now().nanoseconds - behind_ns
        self._begin_ns = self._next_ns = self._now_ns()
        node.create_timer(0.01, self._publish)

    def _publish(self) -> None:
        while self._next_ns <= self._now_ns():
            stamp_ns, self._next_ns = self._next_ns, self._next_ns + 10_000_000
            time = (stamp_ns - self._begin_ns) * 1e-9
            phase = 2.0 * np.pi * 2.8 * time
            noise = self._noise * self._rng.standard_normal(2)
            values = {
                'lateral': self.amplitude_m * np.cos(phase) + 5e-6 * noise[0],
                'yaw': 4.7 * self.amplitude_m * np.cos(phase + 2.6) + 2e-5 * noise[1],
                'roller': 48.0 * time,
            }
            for name, (publisher, written) in self._joints.items():
                if name not in self.muted:
                    publisher.publish(written(stamp_ns, float(values[name])))
            self._speed.publish(twist(stamp_ns, 7.2))
