"""
The speed node: publishes roller angle and running speed, and commands the drive.

The set point follows a profile, or whoever holds the profile's services. Every
set point that goes to the drive is published on `speed/target`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from geometry_msgs.msg import TwistStamped
from rclpy.lifecycle import State, TransitionCallbackReturn
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from hunt_ros.drivers.base import DriveBlock
from hunt_ros.drivers.command import RollerCommand
from hunt_ros.drivers.profile import ProfileRunner
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.errors import DriverError
from hunt_ros.nodes.conversions import joint_layout, twist
from hunt_ros.nodes.diagnostics import Diagnostics, Health, NewSince, one_line, steady_clock
from hunt_ros.nodes.driver_node import DriverNode
from hunt_ros.nodes.parameters import declare, warn_unknown
from hunt_ros.nodes.qos import stream
from hunt_ros.rig import of_rig
from hunt_ros.samples import NANOSECONDS
from hunt_ros.settings import Settings, setting

_SET_POINT_S = 0.05
#: In a longer gap between two set points the process or the machine stood still, s.
_LONGEST_STEP_S = 0.25
#: A drive that sends nothing for so long may not hear either, s.
_SILENT_S = 2.0


@dataclass(frozen=True)
class SpeedConfig(Settings):
    """Parameters of the speed node."""

    driver: str = setting(
        'simulated', 'The drive, docs/drivers.md; its settings are parameters too.', fixed=True
    )
    frame_id: str = setting('roller_rig', 'frame_id of the messages.', fixed=True)
    roller_diameter_m: float = of_rig('roller_diameter_m')
    profile_times_s: tuple[float, ...] = setting(
        (0.0,), 'Corner times of the speed profile, from its start.', unit='s', fixed=True
    )
    profile_speeds_mps: tuple[float, ...] = setting(
        (0.0,), 'Speeds at the corners of the profile.', unit='m/s', fixed=True
    )
    profile_autostart: bool = setting(
        False, 'Start the profile at the first activation.', fixed=True
    )
    acceleration_mps2: float = setting(
        1.0,
        'The set point changes no faster than this, except in an emergency stop.',
        unit='m/s2',
        low=0.001,
        high=100.0,
        fixed=True,
    )
    emergency_speed_mps: float = setting(
        0.0, 'Set point of speed/emergency_stop.', unit='m/s', low=0.0, high=100.0
    )
    autostart: bool = setting(True, 'Configure and activate without being told.', fixed=True)


class RollerSpeedNode(DriverNode):
    """Publishes `roller` and `speed`; runs the profile; commands the drive."""

    def __init__(self) -> None:
        super().__init__('roller_speed')
        self._config = declare(self, SpeedConfig, self._reconfigure)
        hardware = self._use_driver(self._config.driver, 'Drive', self._config.roller_diameter_m)
        warn_unknown(self)
        # The machine's clock may be set while the roller turns: only a simulated rig, whose
        # time is that of /clock, is driven by another clock than the steady one.
        simulated_time = self.get_parameter('use_sim_time').value
        self._profile_clock = self.get_clock() if simulated_time else steady_clock()
        self._command = RollerCommand(
            ProfileRunner(self._config.profile_times_s, self._config.profile_speeds_mps),
            self._config.acceleration_mps2,
            math.inf if simulated_time else _LONGEST_STEP_S,
        )
        self._asked_ns = 0  # when the last set point was asked for, profile clock
        self._target_mps = float('nan')
        self._speed_mps = float('nan')
        self._diameter_m = self._config.roller_diameter_m or RigParameters.roller_diameter_m
        self._published = 0
        self._refusal = ''  # of the last set point
        self._refused = 0
        self._new = NewSince()
        self._layout = joint_layout(['roller'], self._config.frame_id, velocity=True)
        self._roller = self._announced = self.create_publisher(JointState, 'roller', stream(100))
        self._speed = self.create_publisher(TwistStamped, 'speed', stream(100))
        self._target = self.create_publisher(TwistStamped, 'speed/target', stream(20))
        for name, action in (
            ('emergency_stop', self._emergency_stop),
            ('rearm', self._command.rearm),
            ('start_profile', lambda: self._inactive() or self._command.start()),
            ('stop_profile', self._command.stop),
            ('resume_profile', lambda: self._inactive() or self._command.resume()),
        ):
            self.create_service(Trigger, f'speed/{name}', _answer(action))
        self._timer = self.create_timer(_SET_POINT_S, self._send_next, clock=steady_clock())
        self._diagnostics = Diagnostics(self, self._health, hardware)

    def on_activate(self, state: State) -> TransitionCallbackReturn:
        """Publish from now on; `profile_autostart` starts the profile, the first time."""
        if self._config.profile_autostart and not self._command.begun:
            self._command.start()
        return super().on_activate(state)

    def on_deactivate(self, state: State) -> TransitionCallbackReturn:
        """Stop the profile and leave the drive alone; only a service starts it again."""
        self._command.let_go()
        return super().on_deactivate(state)

    def _reconfigure(self, config: SpeedConfig) -> None:
        self._config = config

    def _take(self, block: DriveBlock, publish: bool) -> None:
        self._speed_mps = float(block.speed_mps[-1])
        if not publish:
            return
        readings = zip(
            block.stamps_ns.tolist(),
            block.angle_rad.tolist(),
            block.speed_mps.tolist(),
            strict=True,
        )
        for stamp_ns, angle_rad, speed_mps in readings:
            rate = 2.0 * speed_mps / self._diameter_m
            self._roller.publish(self._layout.encode(stamp_ns, angle_rad, rate))
            self._speed.publish(twist(stamp_ns, speed_mps, self._config.frame_id))
        self._published += block.stamps_ns.size

    def _lose(self, count: int) -> None:
        self.get_logger().warning(f'{count} readings came too late and are left out')

    def _send_next(self) -> None:
        """Send the set point that holds now, if there is one and a drive to take it."""
        now_ns = self._profile_clock.now().nanoseconds
        passed_ns = now_ns - self._asked_ns if self._asked_ns else 0
        self._asked_ns = now_ns
        if not (self._active.is_set() or self._command.stopped):
            return
        speed_mps = self._command.next(passed_ns / NANOSECONDS, self._measured())
        if speed_mps is not None and not self._connecting:
            self._send(speed_mps)

    def _send(self, speed_mps: float) -> str:
        """Send the drive a set point; return '' or why it did not take it."""
        driver = self._driver
        try:
            if driver is None:
                raise DriverError(self._absence())
            driver.set_speed(speed_mps)
        except Exception as error:  # whatever a library of the hardware raises
            self._refused += 1
            if not self._refusal:
                self.get_logger().error(f'set point {speed_mps:.2f} m/s: {one_line(error)}')
            self._refusal = one_line(error)
            return self._refusal
        self._refusal = ''
        self._command.taken(speed_mps)
        self._target_mps = speed_mps
        now_ns = self.get_clock().now().nanoseconds
        if self._active.is_set():
            self._target.publish(twist(now_ns, speed_mps, self._config.frame_id))
        return ''

    def _measured(self) -> float:
        """Return what the roller runs at, m/s; NaN where the drive does not say."""
        return math.nan if self._silent() else self._speed_mps

    def _silent(self) -> str:
        """Return '' or since when the drive sends nothing."""
        silent_s = time.monotonic() - self._heard_s
        if silent_s < _SILENT_S:
            return ''
        if math.isinf(silent_s):
            return 'the drive has not sent anything yet'
        return f'the drive has sent nothing for {silent_s:.1f} s'

    def _absence(self) -> str:
        """Return why there is no drive."""
        if self._worker is None:
            return 'the node is not configured'
        return self._trouble or 'not connected yet'

    def _inactive(self) -> str:
        return '' if self._active.is_set() else 'the node is not active'

    def _emergency_stop(self) -> str:
        """
        Stop in every state of the node, and say whether the drive took it.

        A set point that was sent to a drive which sends nothing may not have arrived: that
        is no success either.
        """
        speed_mps = self._command.emergency_stop(
            self._config.emergency_speed_mps, self._measured()
        )
        problem = self._send(speed_mps) or self._silent()
        self.get_logger().warning(
            f'emergency stop: {problem or "taken"}; set point held until speed/rearm'
        )
        if not problem:
            return ''
        return (
            f'the drive may not have taken it ({problem}): use the hard-wired stop; the stop'
            ' stays in force and is sent again until speed/rearm'
        )

    def _health(self) -> Health:
        fresh = self._new('readings', self._published)
        refused = self._new('refused', self._refused)
        values = {
            'speed_mps': self._speed_mps,
            'target_mps': self._target_mps,
            'readings': fresh,
            'refused_set_points': self._refused,
        }
        if link := self._link():
            return *link, values
        if self._refusal:
            return 'ERROR', f'set point refused: {self._refusal}', values
        if refused:
            return 'WARN', f'{refused} set points were refused', values
        if self._command.stopped:
            return 'WARN', 'emergency stop is in force', values
        if not self._active.is_set():
            return 'OK', 'inactive', values
        if not fresh:
            return 'STALE', 'the drive sends nothing', values
        return 'OK', f'{self._speed_mps:.2f} m/s', values


def _answer(action: Callable[[], str]) -> Callable[..., Trigger.Response]:
    """Make a service callback of an action that returns '' or the reason of a refusal."""

    def callback(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        refusal = action()
        response.success, response.message = not refusal, refusal
        return response

    return callback


make_node = RollerSpeedNode
