"""
What the instruments themselves show, judged without the detector: roller speed, displacement.

The roller is to follow its set point, to stay below the ceiling, and to turn as fast as its
encoder says; the wheelset is to stay within the limit. No clock is read here.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from hunt_ros.drivers.base import DriveBlock
from hunt_ros.samples import NANOSECONDS

#: Readings are kept no closer than this, s, for so long, s.
_SPACING_S, _KEPT_S = 0.02, 3.0
#: The roller is at its set point within this, m/s and share: lag and deceleration of the simulated
#: drive stay below.
_NEAR_MPS, _NEAR = 0.5, 0.05
#: Away from it, it has to come nearer by this, m/s, in each of these, s: a tenth of the slowest
#: acceleration at which a drive is driven (0.4 m/s2); and one that does not for so long, s, does
#: not follow; half as long where it is too fast and still rises: no dead time makes that.
_COMES_MPS, _HALF_S, _FOLLOWS_S = 0.02, 0.5, 2.0
#: Above the ceiling by so much, share and m/s, is no noise of the reading; in so many readings.
_ABOVE, _ABOVE_MPS, _READINGS = 0.02, 0.1, 3
#: Encoder and drive are apart by more than this, m/s and share, over so long, s; pairs of
#: readings that are farther apart, s, are left out (a clock that was set, a pause).
_APART_MPS, _APART, _APART_S, _PAIR_S = 0.2, 0.05, 2.0, 0.25
#: A drive that sends nothing for so long may not hear either, s.
_SILENT_S = 2.0
#: A limit is exceeded where so many samples of the last moments, s, are above it: one alone may be
#: a spike. Half a second holds a period of anything above 2 Hz.
_SAMPLES, _MOMENT_S = 3, 0.5
#: A roller that is slower than this, m/s, is at rest: a wave of hunting would take a minute. So
#: much its drive may show where it stands; an encoder that has moved by more, m, says that it
#: creeps: ten counts of one of 1000 on a roller of 0.3 m.
_AT_REST_MPS, _CREEPS_M = 0.05, 0.01


class _Reading(NamedTuple):
    at_s: float  # when it came, steady clock
    stamp_ns: int
    angle_rad: float
    speed_mps: float


class RollerReadings:
    """
    The last readings of the drive, and whether the roller does as it is told.

    `take` is called by the drive's thread, everything else by others.

    Parameters
    ----------
    roller_diameter_m : float
        0: not known, then the encoder says nothing of the speed.

    Attributes
    ----------
    speed_mps : float
        The last one; NaN before the first.
    """

    def __init__(self, roller_diameter_m: float) -> None:
        self._radius_m = 0.5 * roller_diameter_m
        self._kept: deque[_Reading] = deque(maxlen=round(_KEPT_S / _SPACING_S))
        self.speed_mps = math.nan
        self._foreign_mps = math.nan
        self._followed_s = 0.0

    def take(self, at_s: float, block: DriveBlock) -> None:
        """Take what the drive sent, at least one reading, at `at_s` of the steady clock."""
        self.speed_mps = float(block.speed_mps[-1])
        self._foreign_mps = block.foreign_mps
        if not self._kept or at_s - self._kept[-1].at_s >= _SPACING_S:
            angle = float(block.angle_rad[-1])
            self._kept.append(_Reading(at_s, int(block.stamps_ns[-1]), angle, self.speed_mps))

    def silent(self, passed_s: float) -> str:
        """Return '' or that the drive sends nothing, by the time since the last reading."""
        if math.isnan(self.speed_mps):
            return 'the drive has not sent anything yet'
        if passed_s < _SILENT_S:
            return ''
        return f'the drive has sent nothing for {passed_s:.1f} s'

    def slower(self, limit_mps: float, since_s: float) -> bool:
        """Return True if all of the last readings came since then and are below a speed."""
        last = list(self._kept)[-_READINGS:]
        return len(last) == _READINGS and all(
            each.at_s > since_s and each.speed_mps <= limit_mps for each in last
        )

    def at_rest(self) -> bool:
        """Return True if all of the last readings are those of a roller that stands."""
        kept = list(self._kept)  # the drive's thread goes on
        crept_m = self._radius_m * abs(kept[-1].angle_rad - kept[0].angle_rad) if kept else 0.0
        slow = abs(self.lowest_mps()) <= _AT_REST_MPS and self.slower(_AT_REST_MPS, -math.inf)
        return slow and not crept_m > _CREEPS_M

    def lowest_mps(self) -> float:
        """Return the lowest of the last readings, m/s; 0 where there is none."""
        return min((each.speed_mps for each in list(self._kept)[-_READINGS:]), default=0.0)

    def fault(self, now_s: float, target_mps: float, ceiling_mps: float) -> str:
        """
        Return '' or what the roller does that nobody told it.

        Parameters
        ----------
        now_s : float
            Steady clock; to be called again and again.
        target_mps : float
            Set point that the drive took; NaN: it is left alone.
        ceiling_mps : float
            inf: none.
        """
        kept = list(self._kept)  # the drive's thread goes on
        recent = [each for each in kept if now_s - each.at_s <= _HALF_S]
        if not recent:  # a silent drive is another matter
            self._followed_s = now_s
            return ''
        last, most = recent[-_READINGS:], ceiling_mps * (1.0 + _ABOVE) + _ABOVE_MPS
        speed = last[-1].speed_mps
        said = ''
        if len(last) == _READINGS and all(each.speed_mps > most for each in last):
            said = f'the roller runs at {speed:.2f} m/s, above the ceiling, {ceiling_mps:.2f} m/s'
        elif not self._follows(now_s, kept, recent, target_mps):
            said = (
                f'the roller runs at {speed:.2f} m/s and does not follow its set point,'
                f' {target_mps:.2f} m/s'
            )
        elif not math.isnan(self._foreign_mps):
            said = (
                f'the drive holds a set point of {self._foreign_mps:.2f} m/s, and'
                f' {target_mps:.2f} m/s was sent: another master commands it, or a limit of its'
            )
        elif apart := self._apart(kept):
            said = f'the drive tells {apart[0]:.2f} m/s, and its encoder {apart[1]:.2f} m/s'
        return f'{said}: use the hard-wired stop' if said else ''

    def _follows(
        self, now_s: float, kept: list[_Reading], recent: list[_Reading], target_mps: float
    ) -> bool:
        """Return False if the roller has been away from its set point, and came no nearer."""
        earlier = [e.speed_mps for e in kept if _HALF_S < now_s - e.at_s <= 2.0 * _HALF_S]
        before = float(np.mean(earlier)) if earlier else math.inf
        speed = float(np.mean([each.speed_mps for each in recent]))
        away = abs(speed - target_mps)
        nearer = abs(before - target_mps) - away
        if not away > max(_NEAR_MPS, _NEAR * target_mps) or nearer > _COMES_MPS:
            self._followed_s = now_s
        runs_away = speed > target_mps and speed - before > _COMES_MPS
        return now_s - self._followed_s < _FOLLOWS_S * (0.5 if runs_away else 1.0)

    def _apart(self, kept: list[_Reading]) -> tuple[float, float] | None:
        """Return speeds of drive and encoder, m/s, where they contradict each other."""
        if not self._radius_m or len(kept) < 2:
            return None
        _, stamps, angles, speeds = np.array(kept, dtype=np.float64).T
        steps = np.diff(stamps) / NANOSECONDS
        near = (steps > 0.0) & (steps < _PAIR_S) & np.isfinite(np.diff(angles))
        total_s = float(steps[near].sum())
        if total_s < _APART_S:
            return None
        told = float((0.5 * (speeds[1:] + speeds[:-1]) * steps)[near].sum()) / total_s
        turned = self._radius_m * float(np.diff(angles)[near].sum()) / total_s
        far = abs(abs(told) - abs(turned)) > max(_APART_MPS, _APART * abs(told))
        return (told, turned) if far else None


class Displacement:
    """The displacement of the wheelset as its sensor shows it, whatever is made of it."""

    def __init__(self) -> None:
        self._kept: deque[tuple[int, float]] = deque(maxlen=4000)
        self._came_s = -math.inf

    def take(self, at_s: float, samples: list[tuple[int, float]]) -> None:
        """Take samples (stamp, ns, and m) that came at `at_s` of the steady clock."""
        self._came_s = at_s
        self._kept.extend(sample for sample in samples if math.isfinite(sample[1]))

    def largest(self, now_s: float) -> float:
        """
        Return what the last samples have reached, m, their mean included.

        NaN: not known. One or two samples do not count: it is the third largest.
        """
        if now_s - self._came_s > _MOMENT_S or not self._kept:
            return math.nan
        newest_ns = self._kept[-1][0]
        while self._kept and not 0 <= newest_ns - self._kept[0][0] <= _MOMENT_S * NANOSECONDS:
            self._kept.popleft()
        sizes = sorted(abs(value) for _, value in self._kept)
        return sizes[-_SAMPLES] if len(sizes) >= _SAMPLES else math.nan
