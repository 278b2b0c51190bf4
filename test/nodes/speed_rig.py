"""A speed node in the process of the test, on a drive in memory; a detector that we play."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool

from hunt_ros.drivers.base import DriveBlock
from hunt_ros.errors import DriverError
from hunt_ros.nodes.roller_speed import RollerSpeedNode
from hunt_ros.nodes.support.conversions import diagnostic
from hunt_ros.nodes.support.qos import STATUS, latched

#: Mode of the interlock; without quotes ROS takes the word for `false`.
UNGUARDED = "'off'"


class Drive:
    """A drive in memory: the roller runs at the set point at once."""

    def __init__(self, speed_mps: float = 0.0) -> None:
        self.speed_mps = speed_mps
        self.set_points: list[float] = []
        self.opened = self.reads = 0
        self._angle = 0.0
        self.refusal = ''
        self.mute = self.breaks = self.unreadable = False
        self.obeys = True
        self.hangs = False  # in a call, until it is released
        self.released = threading.Event()
        self.released.set()

    def open(self) -> None:
        self.opened += 1

    def read(self, timeout_s: float) -> DriveBlock:
        time.sleep(min(timeout_s, 0.01))
        self.reads += 1
        if self.breaks or self.unreadable:
            raise DriverError('gone')
        if self.mute:
            return DriveBlock()
        self._angle += 1e-3
        return DriveBlock(
            np.array([time.time_ns()]), np.array([self._angle]), np.array([self.speed_mps])
        )

    def set_speed(self, speed_mps: float) -> None:
        if self.refusal:
            raise DriverError(self.refusal)
        self.hangs = not self.released.is_set()
        self.released.wait()
        self.hangs = False
        self.set_points.append(speed_mps)
        if self.obeys:
            self.speed_mps = speed_mps

    def close(self) -> None:
        if self.breaks:
            self.breaks = False
            raise OSError('the task is not there any more')


class Detector:
    """Says the same thing 20 times a second, whatever the test does meanwhile."""

    def __init__(self, graph) -> None:
        self._publisher = graph.node.create_publisher(DiagnosticArray, 'hunting/status', STATUS)
        self.sent = 0
        self._sequence = 0
        self.level, self.silent, self.alarm = 'OK', False, False
        self.numbers: dict[str, object] = {'amplitude_m': 1e-5, 'v_n_mps': 5.0, 'v_c_mps': 7.0}
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._ending.wait(0.05):
            self.sent += 1
            self._sequence += 5
            values = {'sequence': self._sequence, 'alarm': self.alarm, **self.numbers}
            message = diagnostic(
                time.time_ns(), 'hunting', self.level, 'its reasons', values, 'rig'
            )
            if not self.silent:
                self._publisher.publish(message)

    def close(self) -> None:
        self._ending.set()
        self._thread.join()


def node_on(drive: Drive) -> Callable[[], RollerSpeedNode]:
    def make() -> RollerSpeedNode:
        node = RollerSpeedNode()
        node._make_driver = lambda: drive
        return node

    return make


class Rig:
    """A speed node on a drive in memory, and what it says."""

    def __init__(self, graph, resident, drive: Drive, **parameters: object) -> None:
        self.graph, self.drive = graph, drive
        self._statuses = graph.told('speed/status', latched())
        self._events = graph.told('hunting/events')
        # A machine that is busy must not look like a detector that is silent.
        patience = {'status_timeout_s': 20.0, **parameters}
        self.node = resident(node_on(drive), **patience)
        graph.spin_until(lambda: self._statuses)

    @property
    def status(self) -> dict[str, str]:
        return self._statuses[-1]

    @property
    def events(self) -> list[str]:
        return self._events.events

    def until(self, **values: str) -> None:
        """Wait until the status has these values."""
        self.graph.spin_until(lambda: values.items() <= self.status.items())

    def arm(self, armed: bool) -> SetBool.Response:
        return self.graph.ask(SetBool, 'speed/arm_interlock', data=armed)

    def set(self, **values: object) -> tuple[bool, str]:
        words = [Parameter(name, value=value) for name, value in values.items()]
        result = self.node.set_parameters_atomically(words)
        return result.successful, result.reason
