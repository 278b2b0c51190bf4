"""The speed node on a drive that refuses, goes away and comes back, and on a clock that is set."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
import rclpy.clock
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from lifecycle_msgs.msg import Transition
from rclpy.parameter import Parameter
from rclpy.time import Time

from hunt_ros.drivers.base import DriveBlock
from hunt_ros.errors import DriverError
from hunt_ros.nodes.conversions import read_diagnostic
from hunt_ros.nodes.roller_speed import RollerSpeedNode

pytestmark = pytest.mark.ros

#: Largest step between two set points: what passes at most between them, and the default limit.
_STEP = 0.25 * 1.0 + 1e-9


class Drive:
    """A drive in memory: the roller runs at the set point at once."""

    def __init__(self, speed_mps: float = 0.0) -> None:
        self.speed_mps = speed_mps
        self.set_points: list[float] = []
        self.refusal = ''
        self.absent = False
        self._angle = 0.0

    def open(self) -> None:
        if self.absent:
            raise DriverError('drive: nobody there')

    def read(self, timeout_s: float) -> DriveBlock:
        time.sleep(min(timeout_s, 0.01))
        if self.absent:
            raise DriverError('drive: gone')
        self._angle += 1e-3
        return DriveBlock(
            np.array([time.time_ns()]), np.array([self._angle]), np.array([self.speed_mps])
        )

    def set_speed(self, speed_mps: float) -> None:
        if self.refusal:
            raise DriverError(self.refusal)
        self.set_points.append(speed_mps)
        self.speed_mps = speed_mps

    def close(self) -> None:
        pass


def _node(drive: Drive) -> Callable[[], RollerSpeedNode]:
    def make() -> RollerSpeedNode:
        node = RollerSpeedNode()
        node._make_driver = lambda: drive
        return node

    return make


def _configure(graph, *, activate: bool) -> None:
    graph.change_state('roller_speed', Transition.TRANSITION_CONFIGURE)
    if activate:
        graph.change_state('roller_speed', Transition.TRANSITION_ACTIVATE)


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


def test_an_emergency_stop_says_whether_the_drive_took_it_in_every_state(graph, resident) -> None:
    drive = Drive(6.0)
    resident(_node(drive), autostart=False)
    unconfigured = graph.call('speed/emergency_stop')
    assert not unconfigured.success
    assert 'not configured' in unconfigured.message
    assert not drive.set_points

    _configure(graph, activate=False)
    graph.spin_until(lambda: drive.set_points)
    assert set(drive.set_points) == {0.0}, 'the stop stays in force until the drive can take it'
    inactive = graph.call('speed/emergency_stop')
    assert inactive.success, inactive.message

    graph.change_state('roller_speed', Transition.TRANSITION_ACTIVATE)
    drive.refusal = 'drive: illegal data address'
    refused = graph.call('speed/emergency_stop')
    assert not refused.success
    assert drive.refusal in refused.message
    drive.refusal = ''
    graph.spin_until(lambda: graph.call('speed/emergency_stop').success)


def test_a_refused_set_point_stays_in_the_diagnostics(graph, resident) -> None:
    drive = Drive(6.0)
    health = graph.collect(DiagnosticArray, '/diagnostics')

    def told(level: str, words: str) -> bool:
        texts = [read_diagnostic(message) for message in health]
        return any(text['level'] == level and words in text['message'] for text in texts)

    resident(
        _node(drive),
        autostart=False,
        profile_times_s=[0.0],
        profile_speeds_mps=[6.0],
        profile_autostart=True,
    )
    _configure(graph, activate=True)
    graph.spin_until(lambda: drive.set_points)
    drive.refusal = 'drive: illegal data address'
    graph.spin_until(lambda: told('ERROR', drive.refusal))
    drive.refusal = ''
    graph.spin_until(lambda: read_diagnostic(health[-1])['level'] == 'OK')
    assert float(read_diagnostic(health[-1])['refused_set_points']) > 0
    assert health[-1].status[0].hardware_id


def test_a_step_of_the_machines_clock_does_not_move_the_roller(
    graph, resident, monkeypatch
) -> None:
    drive = Drive(6.0)
    targets = graph.collect(TwistStamped, 'speed/target')
    resident(
        _node(drive),
        autostart=False,
        profile_times_s=[0.0, 1000.0],
        profile_speeds_mps=[6.0, 106.0],
    )
    _configure(graph, activate=True)
    graph.spin_until(lambda: graph.call('speed/start_profile').success)
    graph.spin_until(lambda: len(targets) > 3)
    _step_clock(monkeypatch, 200.0)
    count = len(targets)
    graph.spin_until(lambda: len(targets) > count + 3)
    assert np.abs(np.diff(drive.set_points)).max() <= _STEP

    graph.change_state('roller_speed', Transition.TRANSITION_DEACTIVATE)
    sent = len(drive.set_points)
    _step_clock(monkeypatch, 400.0)
    graph.change_state('roller_speed', Transition.TRANSITION_ACTIVATE)
    graph.spin(0.3)
    assert len(drive.set_points) == sent, 'nothing moves by itself after an activation'
    assert graph.call('speed/resume_profile').success
    graph.spin_until(lambda: len(drive.set_points) > sent + 3)
    assert np.abs(np.diff(drive.set_points)).max() <= _STEP


def test_a_set_point_that_jumps_is_ramped_and_does_not_run_ahead_of_a_drive_that_is_gone(
    graph, resident
) -> None:
    drive = Drive(1.0)
    resident(
        _node(drive),
        autostart=False,
        profile_times_s=[0.0, 0.0, 100.0],
        profile_speeds_mps=[1.0, 2.0, 12.0],
    )
    _configure(graph, activate=True)
    graph.spin_until(lambda: graph.call('speed/start_profile').success)
    graph.spin_until(lambda: len(drive.set_points) > 3)
    drive.absent, drive.refusal = True, 'drive: gone'
    count = len(drive.set_points)
    graph.spin(0.6)
    drive.absent, drive.refusal = False, ''
    graph.spin_until(lambda: len(drive.set_points) > count + 3)
    assert np.abs(np.diff([1.0, *drive.set_points])).max() <= _STEP


def test_the_speed_of_an_emergency_stop_can_be_set_while_the_node_runs(graph, resident) -> None:
    drive = Drive(6.0)
    node = resident(_node(drive), autostart=False)
    _configure(graph, activate=True)
    (result,) = node.set_parameters([Parameter('emergency_speed_mps', value=1.5)])
    assert result.successful
    graph.spin_until(lambda: graph.call('speed/emergency_stop').success)
    assert drive.set_points[-1] == 1.5


def test_a_second_speed_node_of_the_same_name_refuses_to_start_or_is_an_error(
    graph, resident
) -> None:
    drive = Drive(6.0)
    health = graph.collect(DiagnosticArray, '/diagnostics')
    resident(_node(drive), autostart=False)
    namesake = graph.beside('roller_speed')  # as of another machine, which holds its own names

    def told() -> bool:
        texts = [read_diagnostic(message) for message in health]
        return any('another node is named /rig/roller_speed' in t['message'] for t in texts)

    graph.spin_until(told)
    namesake.destroy_node()
    graph.start('roller_speed')
    assert graph.wait('roller_speed') == 2
    last = graph.log('roller_speed').read_text().strip().splitlines()[-1]
    assert '/rig/roller_speed runs already' in last
