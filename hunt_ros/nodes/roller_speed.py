"""
The speed node: publishes roller angle and running speed, commands the drive, and slows it down.

The set point follows a profile, within limits that no profile can break. Beside it stands the
interlock: it listens to the detector, and needs nobody's cooperation. Every set point that goes
to the drive is published on `speed/target`, and how things stand on `speed/status`.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from rclpy.lifecycle import State, TransitionCallbackReturn
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from hunt_ros.drivers.base import DriveBlock, DriveDriver
from hunt_ros.drivers.command import DriveLimits, RollerCommand
from hunt_ros.drivers.interlock import Change, Heard, Interlock, InterlockSettings
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.profile import Motion, Profile
from hunt_ros.dynamics.profile.run import SET_POINT_S
from hunt_ros.errors import ConfigError, DriverError
from hunt_ros.nodes.support.conversions import (
    diagnostic,
    joint_layout,
    read_diagnostic,
    to_ns,
    twist,
)
from hunt_ros.nodes.support.diagnostics import (
    Diagnostics,
    Health,
    NewSince,
    one_line,
    steady_clock,
)
from hunt_ros.nodes.support.driver_node import DriverNode
from hunt_ros.nodes.support.parameters import declare, warn_unknown
from hunt_ros.nodes.support.qos import EVENTS, MEASUREMENTS, STATUS, latched, stream
from hunt_ros.rig import of_rig
from hunt_ros.samples import NANOSECONDS, number_of
from hunt_ros.settings import Settings, setting

#: The interlock looks so often, s.
_WATCH_S = 0.02
_STATUS_S = 0.1
#: In a longer gap between two set points the process or the machine stood still, s.
_LONGEST_STEP_S = 0.25
#: A drive that sends nothing for so long may not hear either, s.
_SILENT_S = 2.0
#: An emergency stop has to show on the encoder within this, s, by this much, m/s, in so many
#: readings one after the other.
_CONFIRM_S, _SLOWED_MPS, _READINGS = 0.5, 0.03, 3
#: A roller that was told to slow down and is faster than its set point by so much, for so long,
#: does not obey; one of the simulated drive's lag and deceleration stays below, m/s and s.
_TOO_FAST_MPS, _DISOBEYS_S = 0.5, 2.0
_LEVELS = {'tripped': 'ERROR', 'disarmed': 'WARN', 'armed': 'OK'}


@dataclass(frozen=True)
class SpeedConfig(Settings):
    """Parameters of the speed node."""

    driver: str = setting(
        'simulated', 'The drive, docs/drivers.md; its settings are parameters too.', fixed=True
    )
    frame_id: str = setting('roller_rig', 'frame_id of the messages.', fixed=True)
    roller_diameter_m: float = of_rig('roller_diameter_m')
    profile: str = setting(
        '', 'Speed profile (docs/profiles.md): its text, or the path of a file; empty: none.'
    )
    profile_autostart: bool = setting(
        False,
        'Start the profile at the first activation, as soon as the interlock allows it.',
        fixed=True,
    )
    emergency_speed_mps: float = setting(
        0.0, 'Set point of speed/emergency_stop.', unit='m/s', low=0.0, high=100.0
    )
    autostart: bool = setting(True, 'Configure and activate without being told.', fixed=True)


class RollerSpeedNode(DriverNode[DriveDriver]):
    """Publishes `roller` and `speed`; runs the profile; commands the drive; guards it."""

    def __init__(self) -> None:
        super().__init__('roller_speed')
        self._config = declare(self, SpeedConfig, self._reconfigure, self._check)
        hardware = self._use_driver(self._config.driver, 'Drive', self._config.roller_diameter_m)
        limits = declare(self, DriveLimits, self._reconfigure_limits, self._check_limits)
        guard = declare(self, InterlockSettings, self._reconfigure_interlock)
        warn_unknown(self)
        # The machine's clock may be set while the roller turns: only a simulated rig, whose
        # time is that of /clock, is driven by another clock than the steady one.
        simulated_time = self.get_parameter('use_sim_time').value
        self._steady = steady_clock()
        self._profile_clock = self.get_clock() if simulated_time else self._steady
        self._command = RollerCommand(limits, math.inf if simulated_time else _LONGEST_STEP_S)
        if self._config.profile:
            self._command.load(Profile.read(self._config.profile))
        self._autostart = self._config.profile_autostart
        self._waits = ''  # why the profile does not start by itself
        self._note = ''
        self._interlock = Interlock(guard, real_time=not simulated_time)
        self._since_ns = 0  # of the interlock's state, clock of the stamps
        self._read_ns = 0  # when the last reading came, profile clock
        self._asked_ns = 0  # when the last set point was asked for, profile clock
        self._target_mps = float('nan')
        self._speed_mps = float('nan')
        self._diameter_m = self._config.roller_diameter_m or RigParameters.roller_diameter_m
        #: The last readings of the speed, with when they came, steady clock, s.
        self._readings: deque[tuple[float, float]] = deque(maxlen=_READINGS)
        self._followed_s = time.monotonic()  # when the roller was not faster than its set point
        self._published = 0
        self._refusal = ''  # of the last set point
        self._refused = 0
        self._new = NewSince()
        self._layout = joint_layout(['roller'], self._config.frame_id, velocity=True)
        self._target = self.create_publisher(TwistStamped, 'speed/target', STATUS)
        self._status = self.create_publisher(DiagnosticArray, 'speed/status', latched())
        self._events = self.create_publisher(DiagnosticArray, 'hunting/events', EVENTS)
        self._detector = self.create_subscription(
            DiagnosticArray, 'hunting/status', self._on_detector, STATUS
        )
        for name, action in (
            ('emergency_stop', self._emergency_stop),
            ('rearm', self._rearm),
            ('start_profile', self._start),
            ('stop_profile', self._command.stop),
            ('resume_profile', self._resume),
        ):
            self.create_service(Trigger, f'speed/{name}', _answer(action))
        self.create_service(SetBool, 'speed/arm_interlock', self._arm)
        self.create_timer(SET_POINT_S, self._send_next, clock=self._steady)
        self.create_timer(_WATCH_S, self._watch, clock=self._steady)
        self.create_timer(_STATUS_S, self._report, clock=self._steady)
        self._diagnostics = Diagnostics(self, self._health, hardware)
        if guard.interlock == 'off':
            self._tell(Change('interlock_disarmed', self._interlock.cause, self._steady_ns()))

    def on_deactivate(self, state: State) -> TransitionCallbackReturn:
        """Stop the profile and leave the drive alone; only a service starts it again."""
        self._command.let_go()
        self._autostart = False
        return super().on_deactivate(state)

    def _check(self, config: SpeedConfig) -> None:
        """Refuse a profile that is none, too fast, or comes while another one runs."""
        if config.profile == self._config.profile:
            return
        if self._command.state == 'running':
            raise ConfigError('profile: one is running, call speed/stop_profile first')
        if config.profile:
            Profile.read(config.profile).check(self._command.limits.ceiling_mps)

    def _reconfigure(self, config: SpeedConfig) -> None:
        before, self._config = self._config, config
        if config.profile and config.profile != before.profile:
            self._command.load(Profile.read(config.profile))

    def _check_limits(self, limits: DriveLimits) -> None:
        """Refuse a ceiling that the profile would break."""
        if self._command.profile is not None:
            self._command.profile.check(limits.ceiling_mps)

    def _reconfigure_limits(self, limits: DriveLimits) -> None:
        self._command.limits = limits

    def _reconfigure_interlock(self, settings: InterlockSettings) -> None:
        self._tell(self._interlock.reconfigure(self._steady_ns(), settings))

    def _advertise(self) -> Publisher:
        self._speed = self.create_publisher(TwistStamped, 'speed', stream(MEASUREMENTS))
        self._roller = self.create_publisher(JointState, 'roller', stream(MEASUREMENTS))
        return self._roller

    def _take(self, block: DriveBlock, publish: bool) -> None:
        """Publish the readings of the drive; the last ones are kept for the emergency stop."""
        self._speed_mps = float(block.speed_mps[-1])
        self._read_ns = self._profile_clock.now().nanoseconds
        now_s = time.monotonic()
        self._readings.extend((now_s, speed) for speed in block.speed_mps[-_READINGS:].tolist())
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
            if not math.isnan(angle_rad):  # a drive may have no encoder
                self._roller.publish(self._layout.encode(stamp_ns, angle_rad, rate))
            self._speed.publish(twist(stamp_ns, speed_mps, self._config.frame_id))
        self._published += block.stamps_ns.size

    def _lose(self, count: int) -> None:
        self.get_logger().warning(f'{count} readings came too late and are left out')

    def _on_detector(self, message: DiagnosticArray) -> None:
        """Take a status of the detector, with the moment at which it came."""
        said = read_diagnostic(message)
        motion = Motion(
            number_of(said, 'amplitude_m'),
            number_of(said, 'v_n_mps'),
            number_of(said, 'v_c_mps'),
            number_of(said, 'fold_amplitude_m'),
        )
        sequence = said.get('sequence', '')
        heard = Heard(
            said.get('level', 'STALE'),
            int(sequence) if sequence.isdecimal() else 0,
            to_ns(message.header.stamp),
            said.get('message', ''),
            number_of(said, 'envelope_m'),
            motion,
        )
        self._interlock.hear(self._steady_ns(), heard)
        self._watch()

    def _watch(self) -> None:
        """Trip the interlock where there is a reason to, and slow the roller down at once."""
        if not self._active.is_set():
            return
        self._interlock.drive(self._drive_trouble())
        change = self._interlock.judge(self._steady_ns())
        if change is None:
            return
        speed_mps = self._command.trip(self._interlock.safe_speed_mps(), self._measured())
        self._send_next()
        self._tell(change, f'; the roller goes to {speed_mps:.2f} m/s until speed/rearm')

    def _drive_trouble(self) -> str:
        """Return '' or what is wrong with the drive."""
        if link := self._link():
            return f'drive: {link[1]}'
        if self._refusal:
            return f'set point refused: {self._refusal}'
        return self._silent()

    def _disobeys(self) -> str:
        """Return '' or that the roller does not slow down although it was told to."""
        now_s = time.monotonic()
        if not self._speed_mps > self._target_mps + _TOO_FAST_MPS:
            self._followed_s = now_s
        if now_s - self._followed_s < _DISOBEYS_S:
            return ''
        return f'; the roller still runs at {self._speed_mps:.2f} m/s: use the hard-wired stop'

    def _steady_ns(self) -> int:
        return self._steady.now().nanoseconds

    def _tell(self, change: Change | None, consequence: str = '') -> None:
        """Publish a transition of the interlock, and log it."""
        if change is None:
            return
        now_ns = self.get_clock().now().nanoseconds
        self._since_ns = now_ns
        since_ns = now_ns - (self._steady_ns() - change.since_ns)
        level = _LEVELS[self._interlock.state]
        cause = change.cause + consequence
        values = {
            'event': change.event,
            'since_s': f'{since_ns / NANOSECONDS:.3f}',
            'decided_s': f'{now_ns / NANOSECONDS:.3f}',
            'test': 'interlock',
            'cause': cause,
            'speed_mps': self._speed_mps,
            'amplitude_m': self._interlock.heard.motion.amplitude_m,
        }
        rig = self.get_namespace().strip('/')
        self._events.publish(diagnostic(now_ns, change.event, level, cause, values, rig))
        text = f'{change.event}: {cause}'
        if level == 'ERROR':
            self.get_logger().error(text)
        elif level == 'OK':
            self.get_logger().info(text)
        else:
            self.get_logger().warning(text)

    def _start(self) -> str:
        self._autostart = False
        now_ns = self._steady_ns()
        against = self._inactive() or self._interlock.refusal(now_ns)
        return self._command.start(self._interlock.motion(now_ns), against)

    def _resume(self) -> str:
        against = self._inactive() or self._interlock.refusal(self._steady_ns())
        return self._command.resume(against)

    def _rearm(self) -> str:
        change, refusal = self._interlock.rearm(self._steady_ns())
        self._tell(change)
        return refusal or self._command.rearm()

    def _arm(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Arm or disarm the interlock; what it holds is held until speed/rearm."""
        change, refusal = self._interlock.arm(self._steady_ns(), request.data)
        self._tell(change)
        response.success, response.message = not refusal, refusal or self._interlock.state
        return response

    def _send_next(self) -> None:
        """Send the set point that holds now, if there is one and a drive to take it."""
        now_ns = self._profile_clock.now().nanoseconds
        passed_ns = now_ns - self._asked_ns if self._asked_ns else 0
        self._asked_ns = now_ns
        if not (self._active.is_set() or self._command.forced):
            return
        if self._autostart and self._active.is_set():
            self._waits = self._start()
            self._autostart = bool(self._waits)
        motion = self._interlock.motion(self._steady_ns())
        speed_mps = self._command.next(passed_ns / NANOSECONDS, self._measured(), motion)
        if self._command.note != self._note:
            self._note = self._command.note
            if self._note:
                self.get_logger().info(f'profile: {self._note}')
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
        if math.isinf(silent_s):
            return 'the drive has not sent anything yet'
        # The time of a simulated rig stands still while it waits for the detector.
        passed_s = (self._profile_clock.now().nanoseconds - self._read_ns) / NANOSECONDS
        silent_s = min(silent_s, passed_s)
        if silent_s < _SILENT_S:
            return ''
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
        Stop in every state of the node, and say whether the roller slows down.

        Only the encoder tells that: a set point that was sent may not have arrived, and a
        drive that took it may not obey. The node waits for it, and sends the stop again.
        """
        before = [speed for _, speed in self._readings]
        speed_mps = self._command.emergency_stop(
            self._config.emergency_speed_mps, self._measured()
        )
        problem = self._send(speed_mps) or self._silent()
        began_s = sent_s = time.monotonic()
        slowed = max(speed_mps + _SLOWED_MPS, min(before, default=0.0) - _SLOWED_MPS)
        while not problem and not self._slower(slowed, began_s):
            now_s = time.monotonic()
            if now_s - began_s > _CONFIRM_S:
                problem = f'the encoder shows {self._speed_mps:.2f} m/s after {_CONFIRM_S:g} s'
            elif now_s - sent_s > SET_POINT_S:
                sent_s, problem = now_s, self._send(speed_mps)
            time.sleep(0.005)
        self.get_logger().warning(
            f'emergency stop: {problem or "confirmed by the encoder"}; held until speed/rearm'
        )
        if not problem:
            return ''
        return (
            f'the drive may not have taken it ({problem}): use the hard-wired stop; the stop'
            ' stays in force and is sent again until speed/rearm'
        )

    def _slower(self, limit_mps: float, since_s: float) -> bool:
        """Return True if all of the last readings came since then and are below a speed."""
        readings = list(self._readings)
        return len(readings) == _READINGS and all(
            at_s > since_s and speed <= limit_mps for at_s, speed in readings
        )

    def _report(self) -> None:
        """Publish how things stand."""
        command, interlock = self._command, self._interlock
        profile = command.profile
        values: dict[str, object] = {
            'speed_mps': self._speed_mps,
            'target_mps': self._target_mps,
            'profile': '' if profile is None else profile.name or f'{len(profile.steps)} steps',
            'profile_state': command.state,
            'profile_elapsed_s': float(command.elapsed_s),
            'profile_remaining_s': float(command.remaining_s),
            'interlock': interlock.settings.interlock,
            'interlock_state': interlock.state,
            'interlock_cause': interlock.cause,
            'interlock_since_ns': self._since_ns,
            'emergency_stop': str(command.stopped).lower(),
            'safe_speed_mps': float(interlock.safe_speed_mps()),
            'speed_ceiling_mps': command.limits.speed_ceiling_mps,
        }
        level, text = self._present()
        now_ns = self.get_clock().now().nanoseconds
        self._status.publish(
            diagnostic(now_ns, 'roller_speed', level, text, values, self.get_namespace()[1:])
        )

    def _present(self) -> tuple[str, str]:
        """Return level and one line: the most serious first."""
        trouble = self._drive_trouble() if self._worker is not None else ''
        lost = self._disobeys()
        if trouble:
            why = '' if trouble == self._interlock.cause else f' ({trouble})'
            lost = f'; the safe set point is sent again and again{why}'
        if self._command.stopped:
            return 'ERROR', f'emergency stop is in force until speed/rearm{lost}'
        if self._command.forced:
            return 'ERROR', f'interlock tripped: {self._interlock.cause}{lost}'
        if trouble:
            level, _ = self._link() or ('ERROR' if self._refusal else 'STALE', '')
            return level, trouble
        if not self._active.is_set():
            return 'OK', 'inactive'
        if self._interlock.state == 'disarmed':
            return 'WARN', f'interlock is disarmed: {self._interlock.cause}'
        if self._waits:
            return 'WARN', f'the profile waits: {self._waits}'
        return 'OK', self._command.note or self._interlock.cause

    def _health(self) -> Health:
        fresh = self._new('readings', self._published)
        refused = self._new('refused', self._refused)
        values: dict[str, object] = {
            'speed_mps': self._speed_mps,
            'target_mps': self._target_mps,
            'readings': fresh,
            'refused_set_points': self._refused,
        }
        values['interlock'] = self._interlock.state
        if link := self._link():
            return *link, values
        if refused and not self._refusal:
            return 'WARN', f'{refused} set points were refused', values
        level, text = self._present()
        if level != 'OK' or not self._active.is_set():
            return level, text, values
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
