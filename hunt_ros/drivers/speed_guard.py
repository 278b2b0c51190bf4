"""
What the speed node decides: the set point that the drive gets, when it trips, what is said.

Profile, interlock, the readings of roller and sensor, and the state that outlives the process
come together here. No hardware is waited for, nothing known of ROS, and no clock read but for
the history: the node hands in what came and when, and sends what is decided.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timezone
from typing import Any

from hunt_ros.drivers.base import DriveDriver
from hunt_ros.drivers.command import DriveLimits, RollerCommand
from hunt_ros.drivers.interlock import Change, Heard, Interlock, InterlockSettings
from hunt_ros.drivers.readings import Displacement, RollerReadings
from hunt_ros.drivers.safety_state import MOST_LINES, SafetyState
from hunt_ros.errors import one_line
from hunt_ros.samples import NANOSECONDS
from hunt_ros.suite import Awaited

#: An emergency stop has to show on the encoder by this much, m/s.
_SLOWED_MPS = 0.03
#: Readings are compared with what they should be so often, s.
_COMPARED_S = 0.1


class SpeedGuard:
    """
    Decides for one roller. Every method may be called from any thread.

    A set point goes through a mailbox of one to the thread that owns the drive (`hand_over`):
    nobody waits for the drive, and of two the newer one counts.

    Parameters
    ----------
    limits : DriveLimits
    settings : InterlockSettings
    diameter_m : float
        Of the roller; 0: not known.
    state : SafetyState
        Of before; what is in force there is in force again.
    damaged : str
        '' or why that state is not known: then the interlock is tripped.
    autostart : bool
        Start the profile as soon as nothing speaks against it, if nothing is in force.
    real_time : bool
        False for a rig whose time is not that of the clocks.
    longest_step_s : float
        See `RollerCommand`.
    connection : callable
        Returns level and words of what is wrong with the connection to the drive, ('OK', '')
        where nothing is.
    silent_s : callable
        Returns how long ago the drive sent its last reading, s.

    Attributes
    ----------
    autostart : bool
        The profile starts by itself yet; any stop ends that.
    taken : (float, int)
        What the drive took last, m/s, and when that was decided; (NaN, 0): it is left alone.
    refusal : str
        Why it did not take the last one; '' where it did.
    refused, answered : int
        How many it refused; number of the last one that was answered.
    """

    def __init__(
        self,
        limits: DriveLimits,
        settings: InterlockSettings,
        diameter_m: float,
        state: SafetyState,
        damaged: str = '',
        autostart: bool = False,
        real_time: bool = True,
        longest_step_s: float = math.inf,
        connection: Callable[[], tuple[str, str]] = lambda: ('OK', ''),
        silent_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        self.command = RollerCommand(limits, longest_step_s)
        self.interlock = Interlock(settings, real_time)
        self.readings = RollerReadings(diameter_m if real_time else 0.0)
        self.displacement = Displacement()
        self.deciding = threading.RLock()
        self._connection, self._silent_s = connection, silent_s
        self._mailbox: deque[tuple[int, float, int]] = deque(maxlen=1)
        self._posted = self.answered = self.refused = 0
        self.taken, self.refusal = (math.nan, 0), ''
        self._asked_ns = 0  # when the last set point was asked for, profile clock
        self.waits = ''  # why the profile does not start by itself
        #: The history and the alarm; what else is in force follows.
        self._kept, self._saved = state, SafetyState()
        self._alarmed = False  # the detector that is heard now has said so
        self._compared_s = -math.inf
        self._restore(state, damaged)
        self.autostart = autostart and not self.command.forced

    def _restore(self, state: SafetyState, damaged: str) -> None:
        """Put in force again what was in force when the process before ended."""
        # A way down that was over does not begin again at the speed of a roller that is faster.
        goal = state.goal_mps
        begin = goal if state.there else math.nan
        if state.emergency_stop:
            self.command.trip(goal, begin, stop=True)
        if state.running and not state.trip:
            damaged = damaged or 'the speed node ended without being asked'
        if state.trip or damaged:
            cause = state.trip or damaged
            if at := state.noted(cause):
                cause = f'before this start, at {at} UTC; until rearmed (hunt call rearm): {cause}'
            self.interlock.restore('tripped', cause, goal)
            self.command.trip(goal, begin)
        elif state.disarmed and self.interlock.state == 'armed':
            self.interlock.restore('disarmed', state.disarmed, 0.0)
        self.remember('started', damaged)

    def hear(self, now_ns: int, heard: Heard) -> None:
        """Take a status of the detector, steady clock."""
        with self.deciding:
            if heard.sequence < self.interlock.heard.sequence:
                self._alarmed = False  # started again: it has forgotten, and nobody acknowledged
            if heard.alarm and not self._alarmed:
                words = heard.words or 'an alarm of the detector'
                self.remember('alarm', words, alarm=words)
            elif self._alarmed and not heard.alarm and self._kept.alarm:
                self.remember('acknowledged', '', alarm='')
            self._alarmed = heard.alarm
            self.interlock.hear(now_ns, heard)

    @property
    def target_mps(self) -> float:
        """What the drive took last, m/s; NaN: it is left alone."""
        return self.taken[0]

    @property
    def measured_mps(self) -> float:
        """What the roller runs at, m/s; NaN where the drive does not say."""
        return math.nan if self.silent else self.readings.speed_mps

    @property
    def silent(self) -> str:
        """'' or since when the drive sends nothing."""
        return self.readings.silent(self._silent_s())

    def trouble(self) -> tuple[str, str]:
        """Return level and words of what is wrong with the drive; ('OK', '') where nothing is."""
        level, words = self._connection()
        if words:
            return level, words
        if self.refusal:
            return 'ERROR', f'set point refused: {self.refusal}'
        never = math.isnan(self.readings.speed_mps)
        silent = self.silent
        return (Awaited('STALE') if never else 'STALE', silent) if silent else ('OK', '')

    def watch(self, steady_ns: int, now_ns: int) -> Change | None:
        """
        Judge, and post a lower set point at once; return a transition of the interlock.

        Parameters
        ----------
        steady_ns, now_ns : int
            Steady clock, and that of the profile; to be called every 20 ms.
        """
        with self.deciding:
            now_s, measured_mps = steady_ns / NANOSECONDS, self.measured_mps
            if now_s - self._compared_s >= _COMPARED_S:
                self._compared_s = now_s
                ceiling = self.command.limits.speed_ceiling_mps
                self.interlock.fault = self.readings.fault(now_s, self.target_mps, ceiling)
                self.interlock.displacement_m = self.displacement.largest(now_s)
            self.interlock.lost = lost = self.trouble()[1]
            self.interlock.parked = not (lost or self.target_mps > 0) and self.readings.at_rest()
            change = self.interlock.judge(steady_ns, measured_mps)
            goal, before = self.interlock.goal_mps, self.command.forced_mps
            if self.interlock.state == 'tripped' and goal < before:
                self.autostart = False
                if self.command.trip(goal, measured_mps) < before:
                    self.decide(steady_ns, now_ns, there=True)
            return self._noted(change)

    def decide(self, steady_ns: int, now_ns: int, there: bool) -> None:
        """
        Post the set point that holds now, if there is one.

        Parameters
        ----------
        steady_ns, now_ns : int
            Steady clock, and that of the profile.
        there : bool
            There is a drive, or was one.
        """
        with self.deciding:  # an emergency stop comes before or after, not between
            busy, (target_mps, decided_ns) = self.answered < self._posted, self.taken
            forced = self.command.forced
            if not math.isnan(target_mps) and (forced or not (busy or self.refusal)):
                self.command.taken(target_mps)
            # On the way down time counts from the set point that the drive has: none may rise.
            since_ns = (decided_ns if forced else 0) or self._asked_ns
            passed_s = (now_ns - since_ns) / NANOSECONDS if since_ns else 0.0
            speed_mps = self._due(steady_ns, passed_s, busy)
            if speed_mps is not None and there:
                self.post(speed_mps, now_ns)
            elif not busy:
                self.taken = math.nan, 0  # the drive is left alone
            if not busy:
                self._asked_ns = now_ns

    def _due(self, steady_ns: int, passed_s: float, busy: bool) -> float | None:
        """Return the set point that is due; None where the drive is left alone."""
        if busy and not self.command.forced:
            return None
        if self.autostart:
            motion, against = self.interlock.motion(steady_ns), self.interlock.refusal(steady_ns)
            self.waits = self.command.start(motion, against)
            self.autostart = bool(self.waits)
        return self.command.next(passed_s, self.measured_mps, self.interlock.motion(steady_ns))

    def post(self, speed_mps: float, decided_ns: int) -> int:
        """Leave a set point for the drive, and when it was decided; return its number."""
        with self.deciding:
            self._posted += 1
            self._mailbox.append((self._posted, speed_mps, decided_ns))
            return self._posted

    def hand_over(self, drive: DriveDriver) -> float | None:
        """Send what waits, in the thread that owns the drive; return what the drive took, m/s."""
        if not self._mailbox:
            return None
        number, speed_mps, decided_ns = self._mailbox.popleft()
        try:
            drive.set_speed(speed_mps)
        except Exception as error:  # whatever a library of the hardware raises
            self.refused += 1
            self.refusal = one_line(error)
            if self.command.forced:  # it may have arrived: the way down goes on from there
                self.taken = speed_mps, decided_ns
        else:
            self.refusal, self.taken = '', (speed_mps, decided_ns)
        self.answered = number
        return None if self.refusal else speed_mps

    def _by_a_person(self) -> RollerCommand:
        """Return the command; from now on nothing starts by itself."""
        self.autostart, self.waits = False, ''
        return self.command

    def start(self, now_ns: int, who: str = '', resume: bool = False) -> str:
        """Start the profile, or go on with it; return '' or why not."""
        with self.deciding:
            command, against = self._by_a_person(), self.interlock.refusal(now_ns)
            motion = self.interlock.motion(now_ns)
            refusal = command.resume(against) if resume else command.start(motion, against)
            self.remember('resume_profile' if resume else 'start_profile', refusal, who)
            return refusal

    def stop(self, who: str = '') -> str:
        """Hold the speed of this moment; only a person starts anything after it."""
        with self.deciding:
            self.remember('stop_profile', '', who)
            return self._by_a_person().stop()

    def emergency_stop(self, now_ns: int, who: str = '') -> tuple[int, float]:
        """
        Stop until `rearm`; return the number of its set point, and what shows that it slows, m/s.

        Parameters
        ----------
        now_ns : int
            Clock of the profile.
        who : str, optional
            Of whoever asks.
        """
        with self.deciding:
            slowed_mps = max(_SLOWED_MPS, self.readings.lowest_mps() - _SLOWED_MPS)
            self._by_a_person().trip(0.0, self.measured_mps, stop=True)
            self.remember('emergency_stop', 'asked for', who)
            return self.post(0.0, now_ns), slowed_mps

    def end(self, abandoned: bool = False) -> float:
        """
        Take the roller to the safe speed, or as low as a trip wants it; return that, m/s.

        It is no trip, but nothing starts. Abandoned, or while the wheelset moves, the roller is
        taken to a stop: no speed is safe by a form that nobody watches.
        """
        with self.deciding:
            stops = abandoned or self.interlock.moving
            safe_mps = 0.0 if stops else self.interlock.safe_speed_mps()
            return self._by_a_person().trip(safe_mps, self.measured_mps)

    def rearm(self, now_ns: int, who: str = '') -> tuple[Change | None, str]:
        """End stop and trip where the cause is over; return the transition, and '' or why not."""
        with self.deciding:
            change, refusal = self.interlock.rearm(now_ns, who)
            if not refusal:
                self.command.rearm()
                self.remember('rearmed', '', who, alarm='')
            return change, refusal

    def arm(self, now_ns: int, armed: bool, who: str = '') -> tuple[Change | None, str]:
        """Arm or disarm; return the transition, and '' or why not."""
        with self.deciding:
            change, refusal = self.interlock.arm(now_ns, armed, who)
            return self._noted(change, who), refusal

    def reconfigure(self, now_ns: int, settings: InterlockSettings) -> Change | None:
        """Use other settings of the interlock."""
        with self.deciding:
            return self._noted(self.interlock.reconfigure(now_ns, settings))

    def _noted(self, change: Change | None, who: str = '') -> Change | None:
        if change is not None:
            self.remember(change.event, change.cause, who)
        return change

    def remember(self, what: str, why: str, who: str = '', **kept: Any) -> None:
        """Note what happened; `kept` are fields of the state that change with it."""
        at = datetime.now(timezone.utc).isoformat(timespec='milliseconds')
        line = {'at': at, 'what': what, 'why': why, 'who': who}
        history = (*self._kept.history[1 - MOST_LINES :], line)
        self._kept = replace(self._kept, history=history, **kept)

    def unsaved(self, running: bool) -> str:
        """Return '' or what the file has to hold now."""
        with self.deciding:
            interlock, command, state = self.interlock, self.command, self.interlock.state
            by_a_person = state == 'disarmed' and interlock.settings.interlock != 'off'
            asked = min(command.held_mps, interlock.safe_speed_mps())
            goal = command.forced_mps if command.forced else asked
            self._kept = replace(
                self._kept,
                emergency_stop='asked for' if command.stopped else '',
                trip=interlock.cause if state == 'tripped' else '',
                disarmed=interlock.cause if by_a_person else '',
                goal_mps=goal,
                there=self.target_mps <= goal,
                running=running,
            )
            before, self._saved = self._saved, self._kept
            return self._kept.to_json() if self._kept != before else ''

    def present(self) -> tuple[str, str]:
        """Return level and one line, the gravest first."""
        with self.deciding:
            interlock, command = self.interlock, self.command
            level, words = self.trouble()
            if command.forced:
                said = f'interlock tripped: {interlock.cause}'
                if command.stopped:
                    said = 'emergency stop is in force until rearmed (hunt call rearm)'
                elif interlock.state != 'tripped':
                    said = f'the end: the roller goes to {command.forced_mps:.2f} m/s'
                if words:
                    said += '; the safe set point is sent again and again'
                if (more := words or interlock.fault) and more != interlock.cause:
                    said += f' ({more})' if words else f'; {more}'
                return 'ERROR', said
            if words:
                return level, words
            if interlock.fault:
                return 'ERROR', interlock.fault
            if interlock.state == 'disarmed':
                return 'WARN', f'interlock is disarmed: {interlock.cause}'
            if unsafe := interlock.unsafe():
                return 'WARN', unsafe
            if self.waits:
                return Awaited('WARN'), f'the profile waits: {self.waits}'
            return 'OK', command.note or interlock.cause

    def values(self) -> dict[str, object]:
        """Return what `speed/status` tells of profile and interlock."""
        with self.deciding:
            command, interlock = self.command, self.interlock
            profile = command.profile
            mode = 'off' if interlock.state == 'disarmed' else interlock.settings.interlock
            return {
                'speed_mps': self.readings.speed_mps,
                'target_mps': self.target_mps,
                'profile': ''
                if profile is None
                else profile.name or f'{len(profile.steps)} steps',
                'profile_state': command.state,
                'profile_elapsed_s': float(command.elapsed_s),
                'profile_remaining_s': float(command.remaining_s),
                'interlock': interlock.settings.interlock,
                'operating_state': 'parked' if interlock.parked else mode,
                'interlock_state': interlock.state,
                'interlock_cause': interlock.cause,
                'interlock_code': interlock.code,
                'emergency_stop': str(command.stopped).lower(),
                'alarm_kept': '' if self._alarmed else self._kept.alarm,
                'safe_speed_mps': float(min(interlock.safe_speed_mps(), command.forced_mps)),
                'speed_ceiling_mps': command.limits.speed_ceiling_mps,
                'displacement_m': interlock.displacement_m,
            }
