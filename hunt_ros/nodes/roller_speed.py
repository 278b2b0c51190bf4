"""
The speed node: publishes roller angle and running speed, commands the drive, and slows it down.

Here is only what comes in and what goes out; `hunt_ros.drivers.speed_guard` decides. Every set
point that the drive took is published on `speed/target`, and how things stand on `speed/status`.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from hunt_ros.drivers import safety_state
from hunt_ros.drivers.base import DriveBlock, DriveDriver
from hunt_ros.drivers.command import DriveLimits
from hunt_ros.drivers.interlock import Change, InterlockSettings
from hunt_ros.drivers.safety_state import SafetyState
from hunt_ros.drivers.speed_guard import SpeedGuard
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.profile import Profile
from hunt_ros.dynamics.profile.run import SET_POINT_S
from hunt_ros.errors import ConfigError, DriverError, HuntError
from hunt_ros.nodes.support.conversions import diagnostic, heard_of, joint_writer, twist
from hunt_ros.nodes.support.diagnostics import Health, NewSince, log, steady_clock
from hunt_ros.nodes.support.driver_node import DriverNode
from hunt_ros.nodes.support.ending import abandoned
from hunt_ros.nodes.support.hearing import Calls, Channels, Said
from hunt_ros.nodes.support.parameters import declare
from hunt_ros.nodes.support.qos import announce, hear
from hunt_ros.nodes.support.worker import Worker
from hunt_ros.rig import of_rig
from hunt_ros.samples import NANOSECONDS
from hunt_ros.settings import Settings, fixed
from hunt_ros.suite import AGAIN

#: The interlock looks so often, s.
_WATCH_S = 0.02
#: ... and how things stand is told, and kept where it has changed, so often, s.
_STATUS_S, _KEPT_S = 0.1, 0.05
#: In a longer gap between two set points the process or the machine stood still, s.
_LONGEST_STEP_S = 0.25
#: An emergency stop has to show on the encoder within this, s.
_CONFIRM_S = 0.5
#: At the end the roller has this longer than its ramp to reach the safe speed, s; and it is there
#: within this, m/s. A drive that was never heard is waited for so long, s.
_ENDING_S, _THERE_MPS, _FIRST_S = 10.0, 0.03, 5.0
_LEVELS = {'tripped': 'ERROR', 'disarmed': 'WARN', 'armed': 'OK'}


@dataclass(frozen=True)
class SpeedConfig(Settings):
    """Parameters of the speed node."""

    driver: str = fixed(
        'simulated', 'The drive, docs/drivers.md; its settings are parameters too.'
    )
    roller_diameter_m: float = of_rig('roller_diameter_m')
    profile: str = fixed(
        '', 'Speed profile (docs/profiles.md): its text, or the path of a file; empty: none.'
    )
    profile_autostart: bool = fixed(
        False, 'Start the profile as soon as the interlock allows it; any stop ends that.'
    )
    state_file: str = fixed(
        '', 'File that keeps emergency stop, trip and alarm over a restart; empty: none.'
    )
    slow_down_at_end: bool = fixed(
        True, 'Take the roller to the safe speed before the node ends; false: leave it.'
    )


class RollerSpeedNode(DriverNode[DriveDriver]):
    """Publishes `roller` and `speed`; hands in and sends what the guard of the roller decides."""

    #: The longest way down, s: from 100 m/s at 1 m/s2.
    winding_s = 120.0

    def __init__(self) -> None:
        super().__init__('roller_speed')
        self._config = declare(self, SpeedConfig)
        self._use_driver(self._config.driver, 'Drive', self._config.roller_diameter_m)
        limits = declare(
            self, DriveLimits, lambda new: setattr(self._guard.command, 'limits', new), self._check
        )
        settings = declare(self, InterlockSettings, self._reconfigure_interlock, self._check)
        # The machine's clock may be set while the roller turns: only a simulated rig, whose
        # time is that of /clock, is driven by another clock than the steady one.
        simulated_time = self.get_parameter('use_sim_time').value
        if simulated_time and self._config.driver != SpeedConfig.driver:
            raise ConfigError('use_sim_time: a drive that is real runs by the steady clock')
        self._steady = steady_clock()
        self._profile_clock = self.get_clock() if simulated_time else self._steady
        state, damaged = self._kept()
        self._guard = SpeedGuard(
            limits,
            settings,
            self._config.roller_diameter_m,
            state,
            damaged,
            self._config.profile_autostart,
            not simulated_time,
            math.inf if simulated_time else _LONGEST_STEP_S,
            self._connection,
            self._silent_s,
        )
        try:
            if self._config.profile:
                profile = Profile.read(self._config.profile)
                profile.check(limits.speed_ceiling_mps)
                self._guard.command.profile = profile
        except ConfigError as error:
            if not state.running:
                raise
            # It guarded until it died: a profile that was edited since keeps no guard away.
            self.get_logger().error(f'profile: {error}')
        self._since_ns = 0  # of the interlock's state, clock of the stamps
        self._read_ns = 0  # when the last reading came, profile clock
        self._note = ''
        self._diameter_m = self._config.roller_diameter_m or RigParameters.roller_diameter_m
        self._published = 0
        #: When the end was asked for, and when the node ends at the latest, steady clock.
        self._asked_s, self._ends_s = math.inf, -math.inf
        self._left = False  # at the end, as it is: nothing trips any more
        self._ending = False  # it was asked to end
        self._new = NewSince()
        self._written = joint_writer(['roller'], velocity=True)
        self._speed = announce(self, 'speed')
        self._announced = announce(self, 'roller')
        self._target = announce(self, 'speed/target')
        self._status = announce(self, 'speed/status')
        self._events = announce(self, 'hunting/events')
        hear(self, 'hunting/status', self._on_detector)
        self._lateral = Channels(self, ['lateral'])
        guard, now = self._guard, self._steady_ns
        asked: dict[str, Callable[[Said], str]] = {
            'rearm': self._rearm,
            'arm-interlock': partial(self._arm, True),
            'disarm-interlock': partial(self._arm, False),
            'stop-profile': lambda said: guard.stop(said.who),
            'start-profile': lambda said: _done(guard.start(now(), said.who)),
            'resume-profile': lambda said: _done(guard.start(now(), said.who, resume=True)),
            'emergency-stop': self._emergency_stop,
        }
        self.create_timer(SET_POINT_S, self._send_next, clock=self._steady)
        self.create_timer(_WATCH_S, self._watch, clock=self._steady)
        self.create_timer(_STATUS_S, self._report, clock=self._steady)
        # The stop of its own thread: it waits for the encoder, and works where the executor hangs.
        Calls(self, asked, beside=['emergency-stop'])
        self._keeper = Worker(self._diagnostics.failed, 'safety state', self._keep)
        interlock = self._guard.interlock
        if interlock.state != 'armed':
            event = f'interlock_{interlock.state}'
            self._tell(Change(event, interlock.cause, self._steady_ns()))

    def close(self) -> None:
        """Let go of the drive; an end that was asked for is no failure."""
        super().close()
        self._keeper.stop()

    def _kept(self) -> tuple[SafetyState, str]:
        """Return what was in force before, and '' or why that is not known."""
        path = self._config.state_file
        try:
            found = safety_state.read(Path(path)) if path else None
        except ConfigError as error:
            return SafetyState(), str(error)
        again = AGAIN in os.environ  # it has ended, whoever asked for that, and the run has not
        lost = 'the speed node ended, and its state is gone' if again and found is None else ''
        found = found or SafetyState()
        return (replace(found, running=True) if again else found), lost

    def _keep(self, stopping: Event) -> None:
        """Write what must outlive the process where it changes, fails to be, or was deleted."""
        path, text, written = Path(self._config.state_file), '', ''
        while True:
            last = stopping.wait(_KEPT_S)
            ended = last and (self._ending or math.isinf(self._decided_s))  # or never began
            text = self._guard.unsaved(running=not ended) or text
            if text and self._config.state_file and not (text == written and path.exists()):
                try:
                    safety_state.write(path, text)
                    written = text
                    self._diagnostics.done('safety state')
                except (HuntError, OSError) as error:
                    self._diagnostics.failed('safety state', error)
                    stopping.wait(1.0)
            if last:
                return

    def _check(self, settings: Mapping[type, Any]) -> None:
        """Refuse a ceiling below the profile, and a safe speed that is none."""
        if (profile := self._guard.command.profile) is not None:
            profile.check(settings[DriveLimits].speed_ceiling_mps)
        safe = settings[InterlockSettings].safe_speed_mps
        v_n = self._guard.interlock.heard.motion.v_n
        if safe != self._guard.interlock.settings.safe_speed_mps and v_n <= safe < math.inf:
            raise ConfigError(f'safe_speed_mps: {safe:g} is not below v_n, {v_n:.3f} m/s')

    def _reconfigure_interlock(self, settings: InterlockSettings) -> None:
        self._tell(self._guard.reconfigure(self._steady_ns(), settings))

    def _attend(self, driver: DriveDriver) -> None:
        """Send the drive its set point, and publish what it took."""
        refused, taken_mps = self._guard.refusal, self._guard.hand_over(driver)
        if taken_mps is not None:
            now_ns = self.get_clock().now().nanoseconds
            self._target.publish(twist(now_ns, taken_mps))
        if self._guard.refusal and not refused:
            self.get_logger().error(f'set point: {self._guard.refusal}')

    def _take(self, block: DriveBlock) -> None:
        """Hand in the readings of the drive, and publish them."""
        self._guard.readings.take(time.monotonic(), block)
        self._read_ns = self._profile_ns()
        readings = zip(
            block.stamps_ns.tolist(),
            block.angle_rad.tolist(),
            block.speed_mps.tolist(),
            strict=True,
        )
        for stamp_ns, angle_rad, speed_mps in readings:
            rate = 2.0 * speed_mps / self._diameter_m
            if not math.isnan(angle_rad):  # a drive may have no encoder
                self._announced.publish(self._written(stamp_ns, angle_rad, rate))
            self._speed.publish(twist(stamp_ns, speed_mps))
        self._published += block.stamps_ns.size

    def _lose(self, count: int) -> None:
        self.get_logger().warning(f'{count} readings came too late and are left out')

    def _on_detector(self, message: DiagnosticArray) -> None:
        """Take a status of the detector, with the moment at which it came."""
        self._guard.hear(self._steady_ns(), heard_of(message))
        self._watch()

    def _watch(self) -> None:
        """Have the interlock judge, and slow the roller down at once where it trips."""
        self._decided_s = now_s = time.monotonic()
        for _, stamps_ns, values, _ in self._lateral.take():
            samples = list(zip(stamps_ns.tolist(), values.tolist(), strict=True))
            self._guard.displacement.take(now_s, samples)
        if not self._left:
            self._tell(self._guard.watch(self._steady_ns(), self._profile_ns()))

    def _connection(self) -> tuple[str, str]:
        """Return level and words of what is wrong with the connection, as the guard wants them."""
        if link := self._link():
            return link[0], f'drive: {link[1]}'
        namesake = 'another speed node of this name commands the drive, too'
        return ('ERROR', namesake) if self._diagnostics.namesake else ('OK', '')

    def _silent_s(self) -> float:
        """Return since when the drive sends nothing, s."""
        # The time of a simulated rig stands still while it waits for the detector.
        passed_s = (self._profile_ns() - self._read_ns) / NANOSECONDS
        return min(time.monotonic() - self._heard_s, passed_s)

    def _profile_ns(self) -> int:
        return self._profile_clock.now().nanoseconds

    def _steady_ns(self) -> int:
        return self._steady.now().nanoseconds

    def _tell(self, change: Change | None) -> None:
        """Publish a transition of the interlock, and log it."""
        if change is None:
            return
        now_ns = self.get_clock().now().nanoseconds
        self._since_ns = now_ns
        since_ns = now_ns - (self._steady_ns() - change.since_ns)
        level = _LEVELS[self._guard.interlock.state]
        cause = change.cause
        if self._guard.interlock.state == 'tripped':
            goal_mps = self._guard.command.forced_mps
            cause += f'; the roller goes to {goal_mps:.2f} m/s until rearmed (hunt call rearm)'
        values = {
            'event': change.event,
            'since_s': f'{since_ns / NANOSECONDS:.3f}',
            'decided_s': f'{now_ns / NANOSECONDS:.3f}',
            'test': 'interlock',
            'cause': cause,
            'speed_mps': self._guard.readings.speed_mps,
            'amplitude_m': self._guard.interlock.heard.motion.amplitude_m,
        }
        rig = self.get_namespace().strip('/')
        self._events.publish(diagnostic(now_ns, change.event, level, cause, values, rig))
        log(self, level, f'{change.event}: {cause}')

    def _rearm(self, said: Said) -> str:
        change, refusal = self._guard.rearm(self._steady_ns(), said.who)
        self._tell(change)
        return _done(refusal)

    def _arm(self, armed: bool, said: Said) -> str:
        """Arm or disarm the interlock; what it holds is held until `rearm`."""
        change, refusal = self._guard.arm(self._steady_ns(), armed, said.who)
        self._tell(change)
        return _done(refusal) or self._guard.interlock.state

    def _send_next(self) -> None:
        """Post the set point that holds now, if there is one and a drive to take it."""
        self._guard.decide(self._steady_ns(), self._profile_ns(), not self._connecting)
        before, self._note = self._note, self._guard.command.note
        if self._note not in ('', before):
            self.get_logger().info(f'profile: {self._note}')

    def _emergency_stop(self, said: Said) -> str:
        """
        Stop, and say whether the roller slows down.

        Only the encoder tells that: a set point that was sent may not have arrived, and a
        drive that took it may not obey. The stop is sent again until `rearm`.
        """
        guard = self._guard
        number, slowed_mps = guard.emergency_stop(self._profile_ns(), said.who)
        began_s = time.monotonic()
        while not (problem := self._absence()):
            if guard.answered >= number and guard.refusal:
                problem = guard.refusal
                break
            if guard.readings.slower(slowed_mps, began_s):
                break
            if time.monotonic() - began_s > _CONFIRM_S:
                shown_mps = guard.readings.speed_mps
                problem = guard.silent or (
                    f'the encoder shows {shown_mps:.2f} m/s after {_CONFIRM_S:g} s'
                )
                break
            time.sleep(0.005)
        held = problem or 'confirmed by the encoder'
        self.get_logger().warning(f'emergency stop: {held}; held until rearmed (hunt call rearm)')
        if problem:
            raise DriverError(
                f'the drive may not have taken it ({problem}): use the hard-wired stop; the stop'
                ' stays in force and is sent again until rearmed (hunt call rearm)'
            )
        return ''

    def wind_down(self) -> bool:
        """Take the roller to where it is safe; return True when it is there, or cannot be."""
        guard, now_s, self._ending = self._guard, time.monotonic(), True
        left_alone = math.isnan(guard.target_mps) and not guard.command.forced
        unguarded = left_alone and guard.interlock.state == 'disarmed'
        self._left = unguarded or not self._config.slow_down_at_end
        if self._left:
            return True
        # Again and again: no rearm ends it. Nobody watches where who started this one has died.
        speed_mps, safe_mps = guard.readings.speed_mps, guard.end(abandoned())
        lasts_s, self._asked_s = _FIRST_S, min(now_s, self._asked_s)
        if not math.isnan(speed_mps):
            ramp_s = max(0.0, speed_mps - safe_mps) / guard.command.limits.safe_deceleration_mps2
            lasts_s = min(ramp_s + _ENDING_S, self.winding_s - 1.0)
        self._ends_s = max(self._ends_s, self._asked_s + lasts_s)
        if guard.measured_mps <= safe_mps + _THERE_MPS:
            self._report()  # the last that is heard of it
            return True
        if now_s > self._ends_s:
            runs = f'may still run at {speed_mps:.2f} m/s, expected {safe_mps:.2f} m/s'
            if math.isnan(speed_mps):
                runs = f'may turn: {self._absence() or "the drive has told no speed"}'
            self.failed = f'ended, and the roller {runs}: use the hard-wired stop'
        return bool(self.failed)

    def _absence(self) -> str:
        """Return '' or why there is no drive."""
        return '' if self._driver is not None else self._trouble or 'not connected yet'

    def _report(self) -> None:
        """Publish how things stand."""
        level, text = self._present()
        values = self._guard.values()
        values |= {'interlock_since_ns': self._since_ns, 'ending': self._asked_s < math.inf}
        now_ns = self.get_clock().now().nanoseconds
        self._status.publish(
            diagnostic(now_ns, 'roller_speed', level, text, values, self.get_namespace()[1:])
        )

    def _present(self) -> tuple[str, str]:
        guard = self._guard
        if self._asked_s < math.inf and not guard.trouble()[1]:
            way = f'{guard.measured_mps:.2f} m/s on the way to {guard.command.forced_mps:.2f} m/s'
            return 'OK', f'ending: {way}'
        return guard.present()

    def _health(self) -> Health:
        guard = self._guard
        values: dict[str, object] = {
            'speed_mps': guard.readings.speed_mps,
            'target_mps': guard.target_mps,
            'readings': self._new('readings', self._published),
            'refused_set_points': guard.refused,
            'interlock': guard.interlock.state,
        }
        level, text = self._present()
        if level == 'OK':
            text = f'{guard.readings.speed_mps:.2f} m/s'
        return level, text, values


def _done(refusal: str) -> str:
    """Refuse a call; '' where nothing speaks against it."""
    if refusal:
        raise DriverError(refusal)
    return ''


make_node = RollerSpeedNode
