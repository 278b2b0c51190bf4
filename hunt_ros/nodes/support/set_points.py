"""Set points on their way to the drive: the executor posts them, the drive's thread sends them."""

from __future__ import annotations

import math
from collections.abc import Callable

from hunt_ros.drivers.base import DriveDriver
from hunt_ros.drivers.speed_guard import SpeedGuard
from hunt_ros.nodes.support.diagnostics import one_line
from hunt_ros.nodes.support.worker import Newest
from hunt_ros.samples import NANOSECONDS


class SetPoints:
    """
    The newest set point, and what the drive said to the last one.

    Parameters
    ----------
    guard : SpeedGuard
        Decides them.
    taken : callable
        Called by the drive's thread with each set point, m/s, that the drive took.
    complain : callable
        Called by it with set point and reason of the first one of several that were refused.

    Attributes
    ----------
    last : (float, int)
        What the drive took last, and when that was decided; (NaN, 0): it is left alone.
    refusal : str
        Why it did not take the last one; '' where it did.
    refused : int
        How many it refused.
    answered : int
        Number of the last one that was answered.
    """

    def __init__(
        self,
        guard: SpeedGuard,
        taken: Callable[[float], None],
        complain: Callable[[float, str], None],
    ) -> None:
        self._guard, self._taken, self._complain = guard, taken, complain
        self._box: Newest[tuple[int, float, int]] = Newest()
        self._posted = self.answered = self.refused = 0
        self.refusal = ''
        self.last = math.nan, 0
        self._asked_ns = 0  # when the last one was asked for, profile clock

    @property
    def target_mps(self) -> float:
        """What the drive took last, m/s."""
        return self.last[0]

    @property
    def busy(self) -> bool:
        """True while one is on its way."""
        return self.answered < self._posted

    def post(self, speed_mps: float, decided_ns: int) -> int:
        """Leave a set point for the drive, and when it was decided; return its number."""
        self._posted += 1
        self._box.post((self._posted, speed_mps, decided_ns))
        return self._posted

    def decide(
        self, steady_ns: int, now_ns: int, measured_mps: float, active: bool, there: bool
    ) -> None:
        """
        Post the set point that holds now, if there is one.

        Parameters
        ----------
        steady_ns, now_ns : int
            Steady clock, and that of the profile.
        measured_mps : float
            Speed of the roller; NaN: not known.
        active, there : bool
            The node is active; there is a drive, or was one.
        """
        guard, busy = self._guard, self.busy
        with guard.deciding:  # an emergency stop comes before or after, not between
            forced, (target_mps, decided_ns) = guard.command.forced, self.last
            if not math.isnan(target_mps) and (forced or not (busy or self.refusal)):
                guard.command.taken(target_mps)
            # On the way down time counts from the set point that the drive has: none may rise.
            since_ns = (decided_ns if forced else 0) or self._asked_ns
            passed_s = (now_ns - since_ns) / NANOSECONDS if since_ns else 0.0
            speed_mps = guard.set_point(steady_ns, passed_s, measured_mps, active, busy)
            if speed_mps is not None and there:
                self.post(speed_mps, now_ns)
            elif not busy:
                self.last = math.nan, 0  # the drive is left alone
        if not busy:
            self._asked_ns = now_ns

    def hand_over(self, drive: DriveDriver) -> None:
        """Send what waits; to be called by the thread that owns the drive."""
        waiting = self._box.take()
        if waiting is None:
            return
        number, speed_mps, decided_ns = waiting
        try:
            drive.set_speed(speed_mps)
        except Exception as error:  # whatever a library of the hardware raises
            self.refused += 1
            if not self.refusal:
                self._complain(speed_mps, one_line(error))
            self.refusal = one_line(error)
        else:
            self.refusal, self.last = '', (speed_mps, decided_ns)
            self._taken(speed_mps)
        self.answered = number
