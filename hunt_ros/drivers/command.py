"""
Which set point the drive gets: that of the profile, a held one, or a forced one.

A forced set point is that of an emergency stop or of the interlock; it stays in force until
`rearm`. No clock is read here. Time enters as what has passed since the last call, and counts
only when the drive has taken the new set point: a profile does not run ahead while the drive,
the connection or the process stands still.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

from hunt_ros.dynamics.profile import Motion, Profile
from hunt_ros.dynamics.profile.run import ProfileRun
from hunt_ros.rig import of_rig
from hunt_ros.settings import Settings, setting

#: A drive that answers late, or is opened again, holds a set point up for so long, s.
_HELD_UP_S = 1.0
#: The jerk limit is kept in steps of this, s.
_SUBSTEP_S = 0.01
_limit = partial(setting, fixed=True, low=0.001, high=100.0, unit='m/s2')


@dataclass(frozen=True)
class DriveLimits(Settings):
    """What no profile may exceed; the speed node declares its parameters from these fields."""

    acceleration_mps2: float = _limit(
        1.0, 'The set point changes no faster than this, except in an emergency stop.'
    )
    jerk_mps3: float = _limit(
        5.0,
        'Its acceleration changes no faster than this, except where the roller is stopped.',
        unit='m/s3',
        low=0.01,
        high=1e4,
    )
    speed_ceiling_mps: float = of_rig('speed_ceiling_mps')
    #: At 0.1 m/s2 from 12 m/s a stop takes as long as the end of a run waits for it.
    safe_deceleration_mps2: float = _limit(
        1.0, 'The interlock slows the roller down at this rate.', low=0.1
    )


class RollerCommand:
    """
    Decides the next set point, and limits how fast it changes.

    Parameters
    ----------
    limits : DriveLimits
        Acceleration, jerk, ceiling; may be replaced at any time.
    longest_step_s : float
        More than this never passes between two calls; a longer gap, as of a process that was
        stopped, counts as this, s. On the way down of a forced set point it is a second.

    Attributes
    ----------
    profile : Profile or None
        What `start` runs.
    forced_mps : float
        Set point of an emergency stop or the interlock, m/s; inf where there is none.
    held_mps : float
        Set point that a person has it hold instead of the profile, m/s; inf where there is none.
    stopped : bool
        An emergency stop is in force: nothing else reaches the drive.
    """

    def __init__(self, limits: DriveLimits, longest_step_s: float = math.inf) -> None:
        self.limits = limits
        self._longest_s = longest_step_s
        self.profile: Profile | None = None
        self._run: ProfileRun | None = None
        self._state = 'idle'
        self.forced_mps, self.held_mps, self.stopped = math.inf, math.inf, False
        #: Where the roller was then: one that lags behind a rising set point is not sped up.
        self._begin_mps = math.inf
        self._last = math.nan  # what the drive took last
        self._rate = self._pending_rate = 0.0  # of the set point then, and of the one after, m/s2
        self._was_taken = True

    @property
    def forced(self) -> bool:
        """True while an emergency stop or the interlock holds the drive."""
        return self.forced_mps < math.inf

    @property
    def state(self) -> str:
        """Of the profile: idle, running, paused or finished."""
        if self._state == 'running' and self._run is not None and self._run.finished:
            return 'finished'
        return self._state

    @property
    def elapsed_s(self) -> float:
        """How far the profile has run, s."""
        return 0.0 if self._run is None else self._run.elapsed_s

    @property
    def remaining_s(self) -> float:
        """What is left of the profile, s; of one that was not begun, all of it."""
        if self._run is not None:
            return self._run.remaining_s
        return 0.0 if self.profile is None else self.profile.duration_s

    @property
    def note(self) -> str:
        """What the step that is under way tells the operator."""
        return '' if self._run is None else self._run.note

    def start(self, motion: Motion | None = None, against: str = '') -> str:
        """
        Run the profile from its beginning; return '' or why not.

        Parameters
        ----------
        motion : Motion, optional
            What the detector sees: a profile may need to know of it.
        against : str
            What else speaks against it; '' where nothing does.
        """
        motion = motion or Motion()
        if self.profile is None or self._refusal or against:
            return self._refusal or ('no profile is given' if self.profile is None else against)
        if self.profile.reacts and math.isnan(motion.amplitude_m):
            return 'the profile reacts to the amplitude, and the detector tells none'
        if lacking := self.profile.missing(motion):
            return lacking
        self._run, self._state, self.held_mps = None, 'running', math.inf
        return ''

    def stop(self) -> str:
        """Hold the speed of this moment; one that is changing comes to rest first."""
        if self.state == 'running':
            self._state = 'paused'
        if math.isinf(self.held_mps) and not math.isnan(self._last):
            rest = self._rate * abs(self._rate) / (2.0 * self.limits.jerk_mps3)
            self.held_mps = self._within(self._last + rest)
        return ''

    def resume(self, against: str = '') -> str:
        """Go on where the profile was stopped; return '' or why not, `against` at the last."""
        never = 'no profile was started' if self._state == 'idle' else ''
        if self._state == 'paused' and self._run is not None and not self._run.resumable:
            never = 'a climb does not go on where it was stopped: start the profile again'
        if not (against := self._refusal or never or against):
            self._state, self.held_mps = 'running', math.inf
        return against

    @property
    def _refusal(self) -> str:
        """Why nothing but a forced set point reaches the drive; '' where that is not so."""
        why = 'emergency stop is in force' if self.stopped else 'the interlock has tripped'
        return f'{why}: rearm it first (hunt call rearm)' if self.forced else ''

    def trip(self, speed_mps: float, measured_mps: float, stop: bool = False) -> float:
        """
        Go to a set point at the safe deceleration, and hold it until `rearm`; return it.

        Of two the lower one holds, and a stop stays a stop.

        Parameters
        ----------
        speed_mps : float
            m/s; where the roller is known to be slower, it is not sped up to this.
        measured_mps : float
            What the roller runs at, m/s; NaN where it is not known.
        stop : bool
            An emergency stop: at once.
        """
        self.stopped |= stop
        self.stop()
        known = [speed for speed in (measured_mps, self._last) if not math.isnan(speed)]
        self._begin_mps = min(known, default=math.inf)
        self.forced_mps = max(0.0, min(speed_mps, self._begin_mps, self.forced_mps))
        return self.forced_mps

    def rearm(self) -> None:
        """End what is forced; its speed is held until a profile is started or resumed."""
        if self.forced:
            # What the drive has never taken is not held: the roller may be slower.
            self.held_mps = math.inf if math.isnan(self._last) else self.forced_mps
            self.forced_mps, self.stopped = math.inf, False

    def next(
        self, passed_s: float, measured_mps: float, motion: Motion | None = None
    ) -> float | None:
        """
        Return the set point that is due.

        Parameters
        ----------
        passed_s : float
            Time since the last call, s, on whatever clock the profile follows.
        measured_mps : float
            What the roller runs at, m/s: where a ramp begins when the drive has taken no
            set point yet. NaN where it is not known.
        motion : Motion, optional
            What the detector sees: a profile may react to it.

        Returns
        -------
        float or None
            m/s; None where the drive is left alone, and where the roller's speed is not
            known: a first set point without it could be a jump.
        """
        before = measured_mps if math.isnan(self._last) else self._last
        if self.forced:  # on its way down it never rises
            self._pending_rate = 0.0
            if not math.isnan(before):  # nor where it was not known how slow the roller is
                self.forced_mps = min(self.forced_mps, before)
            if self.stopped or math.isnan(before):
                return self.forced_mps if self.stopped else None
            passed_s = min(max(passed_s, 0.0), max(self._longest_s, _HELD_UP_S))
            fallen = self.limits.safe_deceleration_mps2 * passed_s
            return max(self.forced_mps, min(before, self._begin_mps) - fallen)
        if math.isnan(before):
            return None
        passed_s = min(max(passed_s, 0.0), self._longest_s)
        if self.held_mps < math.inf:
            wanted = self.held_mps
        elif self._state == 'running' and self.profile is not None:
            if self._run is None:
                self._run, self._was_taken = ProfileRun(self.profile, before), True
            # Time that passed while the drive took nothing is none of the profile's.
            spent_s = passed_s if self._was_taken else 0.0
            wanted = self._run.advance(spent_s, motion or Motion())
        else:
            return None
        self._was_taken = False
        return self._limited(self._within(wanted), passed_s, before)

    def _limited(self, wanted: float, passed_s: float, before: float) -> float:
        """Approach a speed within the limits of acceleration and jerk."""
        most, jerk = self.limits.acceleration_mps2, self.limits.jerk_mps3
        speed, rate = before, self._rate
        count = max(1, min(1000, math.ceil(passed_s / _SUBSTEP_S)))
        step_s = passed_s / count
        for _ in range(count if step_s > 0.0 else 0):
            left = wanted - speed
            # The rate from which `jerk` still comes to rest at `wanted`.
            root = math.sqrt(0.25 * step_s * step_s + 2.0 * abs(left) / jerk)
            reach = jerk * (root - 0.5 * step_s)
            goal = math.copysign(min(most, reach), left)
            rate += min(max(goal - rate, -jerk * step_s), jerk * step_s)
            after = speed + rate * step_s
            if (wanted - after) * left <= 0.0 and abs(rate) <= 2.0 * jerk * step_s:
                after, rate = wanted, 0.0
            speed = after
        self._pending_rate = rate
        return max(0.0, speed)

    def _within(self, speed_mps: float) -> float:
        return min(max(speed_mps, 0.0), self.limits.speed_ceiling_mps)

    def taken(self, speed_mps: float) -> None:
        """Note that the drive took a set point: only now has its time passed."""
        self._last, self._rate, self._was_taken = speed_mps, self._pending_rate, True
