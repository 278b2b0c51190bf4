"""
A profile under way: which set point holds after how much time of its own, and what is left.

Time is what has passed, never a clock: a profile stands still as long as nobody says that time
has passed for it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from hunt_ros.dynamics.profile import Leg, Motion, Profile, Scene, Step

#: A profile is asked for its set point so often, s.
SET_POINT_S = 0.05
#: A step that does not know its speed asks again after this, s.
_LOOK_AGAIN_S = 1.0
#: So many legs in a row that take no time are a loop that the detector does not end.
_MOST_AT_ONCE = 1000


class ProfileRun:
    """
    Runs a profile from its beginning.

    Parameters
    ----------
    profile : Profile
        What to run.
    speed_mps : float
        Where the roller runs now: the first way begins there.

    Attributes
    ----------
    elapsed_s : float
        Time of the profile that has passed.
    finished : bool
        True when the last step is over; its speed is held.
    note : str
        Of the step that is under way.
    """

    def __init__(self, profile: Profile, speed_mps: float) -> None:
        self._durations = profile.durations_s(speed_mps)
        self._steps = iter(profile.steps)
        self._number = -1
        self._step: Step | None = None
        self._scene = Scene(Motion())
        self._legs: Iterator[Leg] = iter(())
        self._leg: Leg | None = None
        self._from = self.speed_mps = speed_mps
        self._in_leg = 0.0
        self.elapsed_s = 0.0
        self.finished = False
        self.note = ''

    @property
    def remaining_s(self) -> float:
        """Time that is left, s; at most, where the detector decides."""
        if self.finished:
            return 0.0
        number = max(self._number, 0)
        here = max(0.0, self._durations[number] - self._scene.elapsed_s)
        return here + sum(self._durations[number + 1 :])

    @property
    def resumable(self) -> bool:
        """Whether the step that is under way goes on where it was stopped."""
        return self._step is None or self._step.resumable

    def advance(self, passed_s: float, motion: Motion) -> float:
        """
        Let time pass.

        Parameters
        ----------
        passed_s : float
            Not negative, s.
        motion : Motion
            What the detector sees now; where it tells no form, the last one holds.

        Returns
        -------
        float
            The set point, m/s.
        """
        self._scene.motion = motion = motion.with_form(self._scene.motion)
        left_s, idle = passed_s, 0
        while not self.finished and idle < _MOST_AT_ONCE:
            if self._leg is None:
                self._begin()
                idle += 1
                continue
            if self._leg.cut(motion):
                self._end_leg(self._leg)
                continue
            used_s = self._use(self._leg, left_s)
            left_s -= used_s
            idle = 0 if used_s > 0.0 else idle
            if self._leg is not None:
                break
        return self.speed_mps

    def _begin(self) -> None:
        """Take the next leg, of the next step where this one is over."""
        leg = next(self._legs, None)
        while leg is None:
            self._step = next(self._steps, None)
            if self._step is None:
                self.finished = True
                return
            self._number += 1
            self._scene = Scene(self._scene.motion)
            self._legs = self._step.legs(self._scene)
            self.note = getattr(self._step, 'note', '')
            leg = next(self._legs, None)
        if math.isnan(leg.speed_mps):  # no form was ever in force: stay here, and say so
            self.note = 'the step has to know v_n and v_c, and no normal form tells them'
            leg = Leg(self.speed_mps, hold_s=_LOOK_AGAIN_S)
        self.note = leg.note or self.note
        self._leg, self._in_leg, self._from = leg, 0.0, self.speed_mps

    def _use(self, leg: Leg, left_s: float) -> float:
        """Spend time on the leg; return how much. A leg that is over is None from then on."""
        way_s = abs(leg.speed_mps - self._from) / leg.rate_mps2
        end_s = way_s + leg.hold_s
        used_s = min(left_s, max(0.0, end_s - self._in_leg))
        self._in_leg += used_s
        self._scene.elapsed_s += used_s
        self.elapsed_s += used_s
        if self._in_leg >= way_s:
            self.speed_mps = leg.speed_mps
        else:
            way = math.copysign(leg.rate_mps2 * self._in_leg, leg.speed_mps - self._from)
            self.speed_mps = self._from + way
        if self._in_leg >= end_s:
            self._end_leg(leg)
        return used_s

    def _end_leg(self, leg: Leg) -> None:
        self._leg, self.finished = None, leg.last
