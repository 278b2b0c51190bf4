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

from hunt_ros.dynamics.profile import Motion, Profile
from hunt_ros.dynamics.profile.run import ProfileRun
from hunt_ros.rig import of_rig
from hunt_ros.settings import Settings, setting

#: The jerk limit is kept in steps of this, s.
_SUBSTEP_S = 0.01
_STOPPED = 'emergency stop is in force: call speed/rearm first'
_TRIPPED = 'the interlock has tripped: call speed/rearm first'


@dataclass(frozen=True)
class DriveLimits(Settings):
    """What no profile may exceed; the speed node declares its parameters from these fields."""

    acceleration_mps2: float = setting(
        1.0,
        'The set point changes no faster than this, except in an emergency stop.',
        unit='m/s2',
        low=0.001,
        high=100.0,
        fixed=True,
    )
    jerk_mps3: float = setting(
        5.0,
        'Its acceleration changes no faster than this, except where the roller is stopped.',
        unit='m/s3',
        low=0.01,
        high=1e4,
        fixed=True,
    )
    speed_ceiling_mps: float = of_rig('speed_ceiling_mps')
    safe_deceleration_mps2: float = setting(
        1.0,
        'The interlock slows the roller down at this rate.',
        unit='m/s2',
        low=0.001,
        high=100.0,
        fixed=True,
    )


@dataclass(frozen=True)
class _Forced:
    """
    A set point that stands above everything.

    Parameters
    ----------
    speed_mps : float
        Where to.
    rate_mps2 : float
        How fast.
    begin_mps : float
        Where the roller was: one that lags behind a rising set point is not sped up further.
    words : str
        Why nothing else reaches the drive.
    """

    speed_mps: float
    rate_mps2: float
    begin_mps: float
    words: str


class RollerCommand:
    """
    Decides the next set point, and limits how fast it changes.

    Parameters
    ----------
    limits : DriveLimits
        Acceleration, jerk, ceiling; may be replaced at any time.
    longest_step_s : float
        More than this never passes between two calls; a longer gap, as of a process
        that was stopped, counts as this, s.
    """

    def __init__(self, limits: DriveLimits, longest_step_s: float = math.inf) -> None:
        self.limits = limits
        self._longest_s = longest_step_s
        self._profile: Profile | None = None
        self._run: ProfileRun | None = None
        self._state = 'idle'
        self._held: float | None = None  # instead of the profile
        self._forced: _Forced | None = None
        self._last = math.nan  # what the drive took last
        self._rate = 0.0  # of the set point then, m/s2
        self._pending_rate = 0.0
        self._was_taken = True

    @property
    def stopped(self) -> bool:
        """True while an emergency stop is in force: nothing else reaches the drive."""
        return self._forced is not None and self._forced.words == _STOPPED

    @property
    def forced(self) -> bool:
        """True while an emergency stop or the interlock holds the drive."""
        return self._forced is not None

    @property
    def forced_mps(self) -> float:
        """Set point of an emergency stop or the interlock, m/s; inf where there is none."""
        return math.inf if self._forced is None else self._forced.speed_mps

    @property
    def state(self) -> str:
        """Of the profile: idle, running, paused or finished."""
        if self._state == 'running' and self._run is not None and self._run.finished:
            return 'finished'
        return self._state

    @property
    def profile(self) -> Profile | None:
        """The profile that `start` runs."""
        return self._profile

    @property
    def elapsed_s(self) -> float:
        """How far the profile has run, s."""
        return 0.0 if self._run is None else self._run.elapsed_s

    @property
    def remaining_s(self) -> float:
        """What is left of the profile, s; of one that was not begun, all of it."""
        if self._run is not None:
            return self._run.remaining_s
        return 0.0 if self._profile is None else self._profile.duration_s

    @property
    def note(self) -> str:
        """What the step that is under way tells the operator."""
        return '' if self._run is None else self._run.note

    def load(self, profile: Profile) -> None:
        """Take another profile; set points stay below the ceiling whatever it asks for."""
        self._profile, self._run, self._state = profile, None, 'idle'
        if self._held is None and not math.isnan(self._last):
            self._held = self._last

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
        if self._forced is not None:
            return self._forced.words
        if self._profile is None:
            return 'no profile is given'
        if against:
            return against
        motion = motion or Motion()
        if self._profile.reacts and math.isnan(motion.amplitude_m):
            return 'the profile reacts to the amplitude, and the detector tells none'
        if lacking := self._profile.missing(motion):
            return lacking
        self._run, self._state, self._held = None, 'running', None
        return ''

    def stop(self) -> str:
        """Hold the speed of this moment; one that is changing comes to rest first."""
        if self.state == 'running':
            self._state = 'paused'
        if self._held is None and not math.isnan(self._last):
            rest = self._rate * abs(self._rate) / (2.0 * self.limits.jerk_mps3)
            self._held = self._within(self._last + rest)
        return ''

    def resume(self, against: str = '') -> str:
        """Go on where the profile was stopped; return '' or why not, `against` at the last."""
        if self._forced is not None:
            return self._forced.words
        if self._state == 'idle':
            return 'no profile was started'
        if against:
            return against
        self._state, self._held = 'running', None
        return ''

    def emergency_stop(self, speed_mps: float, measured_mps: float) -> float:
        """
        Hold a set point until `rearm`, at once, and return it.

        Parameters
        ----------
        speed_mps : float
            m/s; where the roller is known to be slower, it is not sped up to this.
        measured_mps : float
            What the roller runs at, m/s; NaN where it is not known.
        """
        return self._force(speed_mps, math.inf, measured_mps, _STOPPED)

    def trip(self, speed_mps: float, measured_mps: float) -> float:
        """
        Go to a safe speed at the safe deceleration, and hold it until `rearm`; return it.

        Parameters
        ----------
        speed_mps : float
            m/s; where the roller is slower, it is not sped up to this.
        measured_mps : float
            What the roller runs at, m/s; NaN where it is not known.
        """
        rate = self.limits.safe_deceleration_mps2
        return self._force(speed_mps, rate, measured_mps, _TRIPPED)

    def _force(self, speed_mps: float, rate: float, measured_mps: float, words: str) -> float:
        self.stop()
        begin = min((x for x in (measured_mps, self._last) if not math.isnan(x)), default=math.inf)
        speed = max(0.0, min(speed_mps, begin))
        if self._forced is not None:  # the lower one, and a stop stays a stop
            speed = min(speed, self._forced.speed_mps)
            if self._forced.words == _STOPPED:
                rate, words = math.inf, _STOPPED
        self._forced = _Forced(speed, rate, begin, words)
        return speed

    def rearm(self) -> str:
        """End what is forced; its speed is held until a profile is started or resumed."""
        if self._forced is not None:
            self._held, self._forced = self._forced.speed_mps, None
        return ''

    def let_go(self) -> None:
        """Stop the profile and leave the drive alone; what is forced stays in force."""
        self.stop()
        self._last, self._rate, self._held = math.nan, 0.0, None

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
        passed_s = min(max(passed_s, 0.0), self._longest_s)
        before = measured_mps if math.isnan(self._last) else self._last
        if self._forced is not None:
            return self._slowed(self._forced, passed_s, before)
        if math.isnan(before):
            return None
        if self._held is not None:
            wanted = self._held
        elif self._state == 'running' and self._profile is not None:
            if self._run is None:
                self._run, self._was_taken = ProfileRun(self._profile, before), True
            # Time that passed while the drive took nothing is none of the profile's.
            spent_s = passed_s if self._was_taken else 0.0
            wanted = self._run.advance(spent_s, motion or Motion())
        else:
            return None
        self._was_taken = False
        return self._limited(self._within(wanted), passed_s, before)

    def _slowed(self, forced: _Forced, passed_s: float, before: float) -> float | None:
        """Return the set point on the way to a forced one; it never rises."""
        self._pending_rate = 0.0
        if math.isinf(forced.rate_mps2):
            return forced.speed_mps
        if math.isnan(before):
            return None
        return max(forced.speed_mps, min(before, forced.begin_mps) - forced.rate_mps2 * passed_s)

    def _limited(self, wanted: float, passed_s: float, before: float) -> float:
        """Approach a speed within the limits of acceleration and jerk."""
        most, jerk = self.limits.acceleration_mps2, self.limits.jerk_mps3
        speed, rate = before, self._rate
        count = max(1, min(1000, math.ceil(passed_s / _SUBSTEP_S)))
        step_s = passed_s / count
        for _ in range(count if step_s > 0.0 else 0):
            left = wanted - speed
            # The rate from which `jerk` still comes to rest at `wanted`.
            reach = jerk * (
                math.sqrt(0.25 * step_s * step_s + 2.0 * abs(left) / jerk) - 0.5 * step_s
            )
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
