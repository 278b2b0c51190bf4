"""
Which set point the drive gets: that of the profile, a held one, or the emergency stop's.

No clock is read here. Time enters as what has passed since the last call, and counts
only when the drive has taken the new set point: a profile does not run ahead while the
drive, the connection or the process stands still.
"""

from __future__ import annotations

import math

from hunt_ros.drivers.profile import ProfileRunner
from hunt_ros.samples import NANOSECONDS


class RollerCommand:
    """
    Decides the next set point, and limits how fast it changes.

    Parameters
    ----------
    profile : ProfileRunner
        What `start` runs.
    acceleration_mps2 : float
        The set point changes no faster than this, m/s2. An emergency stop is not held
        back by it.
    longest_step_s : float
        More than this never passes between two calls; a longer gap, as of a process
        that was stopped, counts as this, s.

    Attributes
    ----------
    stopped : bool
        An emergency stop is in force: nothing else reaches the drive until `rearm`.
    """

    def __init__(
        self,
        profile: ProfileRunner,
        acceleration_mps2: float,
        longest_step_s: float = math.inf,
    ) -> None:
        self._profile = profile
        self._acceleration = acceleration_mps2
        self._longest_s = longest_step_s
        self.stopped = False
        self._begun = False
        self._held: float | None = None  # instead of the profile
        self._last = math.nan  # what the drive took last
        self._now_ns = self._next_ns = 0  # of the profile's own time

    @property
    def begun(self) -> bool:
        """True once a profile was started."""
        return self._begun

    def start(self) -> str:
        """Run the profile from its beginning; return '' or why not."""
        if self.stopped:
            return 'emergency stop is in force: call speed/rearm first'
        self._begun, self._held = True, None
        self._profile.start(self._now_ns)
        return ''

    def stop(self) -> str:
        """Hold the speed the drive was told last."""
        self._profile.stop(self._now_ns)
        if self._held is None and not math.isnan(self._last):
            self._held = self._last
        return ''

    def resume(self) -> str:
        """Go on with the profile from where it was stopped; return '' or why not."""
        if self.stopped:
            return 'emergency stop is in force: call speed/rearm first'
        if not self._begun:
            return 'no profile was started'
        self._held = None
        self._profile.resume(self._now_ns)
        return ''

    def emergency_stop(self, speed_mps: float, measured_mps: float) -> float:
        """
        Hold a set point until `rearm`, and return it.

        Parameters
        ----------
        speed_mps : float
            m/s; where the roller is known to be slower, it is not sped up to this.
        measured_mps : float
            What the roller runs at, m/s; NaN where it is not known.
        """
        self._profile.stop(self._now_ns)
        self.stopped = True
        self._held = speed_mps if math.isnan(measured_mps) else min(speed_mps, measured_mps)
        self._held = max(0.0, self._held)
        return self._held

    def rearm(self) -> str:
        """End the emergency stop; the roller stays as it is until a profile is started."""
        self.stopped = False
        return ''

    def let_go(self) -> None:
        """Stop the profile and leave the drive alone; an emergency stop stays in force."""
        self._profile.stop(self._now_ns)
        self._last = math.nan
        if not self.stopped:
            self._held = None

    def next(self, passed_s: float, measured_mps: float) -> float | None:
        """
        Return the set point that is due.

        Parameters
        ----------
        passed_s : float
            Time since the last call, s, on whatever clock the profile follows.
        measured_mps : float
            What the roller runs at, m/s: where a ramp begins when the drive has taken no
            set point yet. NaN where it is not known.

        Returns
        -------
        float or None
            m/s; None where the drive is left alone, and where the roller's speed is not
            known: a first set point without it could be a jump.
        """
        self._next_ns = self._now_ns
        passed_s = min(max(passed_s, 0.0), self._longest_s)
        if self._held is not None:
            wanted = self._held
        elif self._begun and self._profile.running:
            self._next_ns += round(passed_s * NANOSECONDS)
            wanted = self._profile.set_point(self._next_ns)
        else:
            return None
        if self.stopped:
            return wanted
        before = measured_mps if math.isnan(self._last) else self._last
        if math.isnan(before):
            return None
        most = self._acceleration * passed_s
        return min(max(wanted, before - most), before + most)

    def taken(self, speed_mps: float) -> None:
        """Note that the drive took a set point: only now has its time passed."""
        self._last, self._now_ns = speed_mps, self._next_ns
