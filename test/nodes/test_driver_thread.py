"""The thread that owns a driver: never two on one device, and patient with one that is away."""

from __future__ import annotations

import socket
import threading
import time

import numpy as np
from lifecycle_msgs.msg import Transition
from sensor_msgs.msg import JointState

from hunt_ros.drivers import SensorBlock
from hunt_ros.nodes.support.sensor import SensorNode


class _Device:
    """A device that takes its time to be opened, and knows how many have it at once."""

    range = (-np.inf, np.inf)

    def __init__(self) -> None:
        self.opened = self.present = self.most = 0
        self.may_open = threading.Event()

    def open(self) -> None:
        self.opened += 1
        self.present += 1
        self.most = max(self.most, self.present)
        self.may_open.wait()

    def read(self, timeout_s: float) -> SensorBlock:
        time.sleep(min(timeout_s, 0.01))
        return SensorBlock(np.array([time.time_ns()]), np.array([1e-3]))

    def close(self) -> None:
        self.present = 0


def test_a_thread_that_ends_late_keeps_its_device_until_then(graph, resident) -> None:
    device = _Device()

    def make() -> SensorNode:
        node = SensorNode('lateral')
        node._make_driver = lambda: device
        return node

    heard = graph.collect(JointState, 'lateral')
    resident(make, autostart=False)
    graph.change_state('lateral_sensor', Transition.TRANSITION_CONFIGURE)
    graph.spin_until(lambda: device.opened == 1)
    graph.change_state('lateral_sensor', Transition.TRANSITION_CLEANUP)
    graph.change_state('lateral_sensor', Transition.TRANSITION_CONFIGURE)
    graph.change_state('lateral_sensor', Transition.TRANSITION_ACTIVATE)
    assert device.opened == 1, 'the first is still at it'
    device.may_open.set()
    graph.spin_until(lambda: heard)
    assert device.opened == 2
    assert device.most == 1


def test_hardware_that_is_not_there_is_tried_again_less_and_less_often(graph) -> None:
    """Three waits of 0.5, 1 and 2 s; without a back-off they would be 1.5 s together."""
    tried_s: list[float] = []
    with socket.create_server(('127.0.0.1', graph.port)) as server:

        def refuse() -> None:
            while len(tried_s) < 4:
                server.accept()[0].close()
                tried_s.append(time.monotonic())

        thread = threading.Thread(target=refuse, daemon=True)
        thread.start()
        graph.start('lateral_sensor', port=graph.port)
        graph.spin_until(lambda: len(tried_s) == 4)
        thread.join()
    assert tried_s[-1] - tried_s[0] > 2.5
