"""
The speed node: publishes roller angle and running speed, and commands the drive.

The set point follows a profile, or whoever holds the profile's services. Every
set point that goes to the drive is published on `speed/target`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from hunt_ros.drivers.base import DriveDriver
from hunt_ros.drivers.profile import ProfileRunner
from hunt_ros.drivers.simulated import SimulatedDrive
from hunt_ros.errors import DriverError
from hunt_ros.nodes.conversions import joint_layout, twist
from hunt_ros.nodes.diagnostics import Diagnostics, Health, steady_clock
from hunt_ros.nodes.driver_node import READ_S, DriverNode
from hunt_ros.nodes.parameters import declare, warn_unknown
from hunt_ros.nodes.qos import stream
from hunt_ros.settings import Settings, setting

_SET_POINT_S = 0.05


@dataclass(frozen=True)
class SpeedConfig(Settings):
    """Parameters of the speed node."""

    driver: str = setting('simulated', 'The drive.', choices=('simulated',), fixed=True)
    host: str = setting('127.0.0.1', 'Address of the rig simulator.', fixed=True)
    port: int = setting(47100, 'TCP port of the rig simulator.', low=1, high=65535, fixed=True)
    frame_id: str = setting('roller_rig', 'frame_id of the messages.', fixed=True)
    roller_diameter_m: float = setting(
        0.3, 'Roller diameter: roller rate = 2 v / D.', unit='m', low=0.01, high=10.0, fixed=True
    )
    profile_times_s: tuple[float, ...] = setting(
        (0.0,), 'Corner times of the speed profile, from its start.', unit='s', fixed=True
    )
    profile_speeds_mps: tuple[float, ...] = setting(
        (0.0,), 'Speeds at the corners of the profile.', unit='m/s', fixed=True
    )
    profile_autostart: bool = setting(False, 'Start the profile at activation.', fixed=True)
    emergency_speed_mps: float = setting(
        0.0, 'Set point of speed/emergency_stop.', unit='m/s', low=0.0, high=100.0
    )
    autostart: bool = setting(True, 'Configure and activate without being told.', fixed=True)


class RollerSpeedNode(DriverNode):
    """Publishes `roller` and `speed`; runs the profile; commands the drive."""

    def __init__(self) -> None:
        super().__init__('roller_speed')
        self._config = declare(self, SpeedConfig)
        warn_unknown(self)
        self._profile = ProfileRunner(
            self._config.profile_times_s, self._config.profile_speeds_mps
        )
        self._began = False  # a profile was started: before that the drive is left alone
        self._stopped = False  # emergency stop: stays until rearmed
        self._held_mps: float | None = (
            None  # instead of the profile, until it is started or resumed
        )
        self._target_mps = float('nan')
        self._speed_mps = float('nan')
        self._published = 0
        self._last_count = 0
        self._layout = joint_layout(['roller'], self._config.frame_id, velocity=True)
        self._roller = self._announced = self.create_publisher(JointState, 'roller', stream(100))
        self._speed = self.create_publisher(TwistStamped, 'speed', stream(100))
        self._target = self.create_publisher(TwistStamped, 'speed/target', stream(20))
        for name, action in (
            ('emergency_stop', self._emergency_stop),
            ('rearm', self._rearm),
            ('start_profile', self._start_profile),
            ('stop_profile', self._stop_profile),
            ('resume_profile', self._resume_profile),
        ):
            self.create_service(Trigger, f'speed/{name}', self._answer(action))
        self._timer = self.create_timer(_SET_POINT_S, self._command, clock=steady_clock())
        self._diagnostics = Diagnostics(self, self._health)

    def _make_driver(self) -> DriveDriver:
        return SimulatedDrive(self._config.host, self._config.port)

    def _publish_block(self) -> None:
        block = self._driver.read(READ_S)
        readings = zip(
            block.stamps_ns.tolist(),
            block.angle_rad.tolist(),
            block.speed_mps.tolist(),
            strict=True,
        )
        for stamp_ns, angle_rad, speed_mps in readings:
            rate = 2.0 * speed_mps / self._config.roller_diameter_m
            self._roller.publish(self._layout.encode(stamp_ns, angle_rad, rate))
            self._speed.publish(twist(stamp_ns, speed_mps, self._config.frame_id))
            self._speed_mps = speed_mps
        self._published += block.stamps_ns.size

    def _command(self) -> None:
        """Send the set point that holds now, if there is one."""
        if not self._active.is_set():
            return
        now_ns = self.get_clock().now().nanoseconds
        if now_ns == 0:
            return  # simulated time has not begun
        if self._config.profile_autostart and not self._began:
            self._began = True
            self._profile.start(now_ns)
        if self._held_mps is not None:
            self._send(now_ns, self._held_mps)
        elif self._began:
            self._send(now_ns, self._profile.set_point(now_ns))

    def _send(self, now_ns: int, speed_mps: float) -> None:
        try:
            self._driver.set_speed(speed_mps)
        except DriverError as error:
            self._trouble = str(error)
            return
        self._target_mps = speed_mps
        self._target.publish(twist(now_ns, speed_mps, self._config.frame_id))

    def _answer(self, action: Callable[[int], str]) -> Callable[..., Trigger.Response]:
        """Make a service callback of an action that returns '' or the reason of a refusal."""

        def callback(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            refusal = action(self.get_clock().now().nanoseconds)
            response.success, response.message = not refusal, refusal
            return response

        return callback

    def _emergency_stop(self, now_ns: int) -> str:
        self._stopped, self._held_mps = True, self._config.emergency_speed_mps
        self._profile.stop(now_ns)
        self.get_logger().warning('emergency stop: set point held until speed/rearm')
        self._command()
        return ''

    def _rearm(self, now_ns: int) -> str:
        # The roller stays where it is: only starting or resuming a profile moves it again.
        self._stopped = False
        return ''

    def _start_profile(self, now_ns: int) -> str:
        if self._stopped:
            return 'emergency stop is in force: call speed/rearm first'
        self._began, self._held_mps = True, None
        self._profile.start(now_ns)
        return ''

    def _stop_profile(self, now_ns: int) -> str:
        self._profile.stop(now_ns)
        return ''

    def _resume_profile(self, now_ns: int) -> str:
        if self._stopped:
            return 'emergency stop is in force: call speed/rearm first'
        if not self._began:
            return 'no profile was started'
        self._held_mps = None
        self._profile.resume(now_ns)
        return ''

    def _health(self) -> Health:
        fresh = self._published - self._last_count
        self._last_count = self._published
        values = {'speed_mps': self._speed_mps, 'target_mps': self._target_mps, 'readings': fresh}
        if self._trouble:
            return 'ERROR', self._trouble, values
        if not self._active.is_set():
            return 'OK', 'inactive', values
        if self._stopped:
            return 'WARN', 'emergency stop is in force', values
        if not fresh:
            return 'STALE', 'the drive sends nothing', values
        return 'OK', f'{self._speed_mps:.2f} m/s', values


make_node = RollerSpeedNode
