"""
Running a speed profile: which set point holds at which time, with pause and stop.

A profile is a list of (time, speed) corners joined by straight lines, counted
from its start.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hunt_ros.errors import ConfigError
from hunt_ros.samples import NANOSECONDS


class ProfileRunner:
    """
    Set points of a profile against time; stamps are arguments.

    Parameters
    ----------
    times_s : sequence of float, shape (n,)
        Corner times from the start, s, not decreasing, the first not negative.
    speeds_mps : sequence of float, shape (n,)
        Speeds at the corners, m/s, not negative.

    Raises
    ------
    ConfigError
        If the two do not make a profile.
    """

    def __init__(self, times_s: Sequence[float], speeds_mps: Sequence[float]) -> None:
        self._times = np.asarray(times_s, dtype=np.float64)
        self._speeds = np.asarray(speeds_mps, dtype=np.float64)
        if self._times.size != self._speeds.size or not self._times.size:
            raise ConfigError(
                f'profile: {self._times.size} times and {self._speeds.size} speeds,'
                ' expected as many of one as of the other, and at least one'
            )
        if not np.isfinite(self._times).all() or np.any(np.diff(self._times, prepend=0.0) < 0.0):
            raise ConfigError(f'profile: times must not decrease, got {self._times.tolist()}')
        if not np.isfinite(self._speeds).all() or np.any(self._speeds < 0.0):
            raise ConfigError(f'profile: negative or no speed in {self._speeds.tolist()}')
        self._started_ns: int | None = None
        self._done_ns = 0  # how far the profile had run when it was last stopped

    @property
    def duration_s(self) -> float:
        """Time of the last corner, s."""
        return float(self._times[-1])

    @property
    def running(self) -> bool:
        """True between start and stop."""
        return self._started_ns is not None

    def start(self, now_ns: int) -> None:
        """Run from the beginning."""
        self._started_ns, self._done_ns = now_ns, 0

    def stop(self, now_ns: int) -> None:
        """Hold the set point of this moment."""
        if self._started_ns is not None:
            self._done_ns += now_ns - self._started_ns
            self._started_ns = None

    def resume(self, now_ns: int) -> None:
        """Go on from where it was stopped."""
        if self._started_ns is None:
            self._started_ns = now_ns

    def elapsed_s(self, now_ns: int) -> float:
        """How far the profile has run, s."""
        running = 0 if self._started_ns is None else now_ns - self._started_ns
        return (self._done_ns + running) / NANOSECONDS

    def finished(self, now_ns: int) -> bool:
        """True after the last corner."""
        return self.elapsed_s(now_ns) >= self.duration_s

    def set_point(self, now_ns: int) -> float:
        """Speed of the profile at this moment, m/s; the last corner's after the end."""
        return float(np.interp(self.elapsed_s(now_ns), self._times, self._speeds))
