"""
Clearance of a speed, as flight flutter tests give it: may the rig stay at this speed, or go on?

A speed is cleared once it has been held for long enough that the noise there is known, nothing
was in doubt meanwhile, the margin kept above its limit with 95 %, and a normal form expects no
escape from the noise that is seen. What is not known is never cleared.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import doubts, health
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.output import blank_rows, joined_rows
from hunt_ros.detection.regions import Region, State
from hunt_ros.detection.words.reasons import reason_counts
from hunt_ros.samples import CHANNELS, NANOSECONDS, as_json

#: Of the reference rig, s: twice the time constant of the noise floor, some
#: sixty periods, which tell a mean square to 13 %. As many periods of any other rig.
_LEAST_S = 20.0
#: A speed is held while it stays within this band, m/s or a part of it: half a percent of v_c
#: moves the unstable amplitude by less than it is known to.
_BAND_MPS, _BAND = 0.04, 0.01
#: For so long no escape is to be expected, in minutes, and up to this chance none is.
MINUTES, _CHANCE = 10, 0.05
#: These make a row WARN, and are judged by their numbers.
_JUDGED = doubts.HYSTERESIS | doubts.MARGIN
#: So many holds are kept, the newest.
_KEPT = 5000


@dataclass(frozen=True)
class Clearance:
    """
    The verdict on a speed that is held.

    Parameters
    ----------
    begin_ns : int
        Stamp of the second in which the hold began.
    speed_mps, held_s : float
        Its last speed, m/s; whole seconds for which it was held.
    margin : float
        The least of the last `_LEAST_S` at the lower end of its 95 % interval: unstable amplitude
        over amplitude; inf: no motion grows at this speed; 0: it hunts; NaN: unknown, or in doubt.
    escape_chance : float
        Chance that noise starts hunting within `MINUTES`, by the same rows; 1: it hunts;
        NaN: unknown, or in doubt.
    reason : str
        Why it is not cleared; '' where it is.
    """

    begin_ns: int = 0
    speed_mps: float = math.nan
    held_s: float = 0.0
    margin: float = math.nan
    escape_chance: float = math.nan
    reason: str = 'no estimates yet'

    @property
    def cleared(self) -> bool:
        """True where nothing speaks against this speed."""
        return not self.reason

    @property
    def words(self) -> str:
        """The verdict as a sentence."""
        if not self.cleared:
            held = math.isfinite(self.speed_mps) and self.held_s > 0.0
            what = f'{self.speed_mps:.2f} m/s is not cleared' if held else 'not cleared'
            return f'{what}: {self.reason}'
        room = f'margin {min(self.margin, 99.9):.1f} (95 %)'
        if math.isinf(self.margin):
            room = 'every motion dies out'
        return (
            f'{self.speed_mps:.2f} m/s is cleared: {room}, no escape expected in {MINUTES} minutes'
        )

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON types; what is unknown is None, and so is a margin without end."""
        return {**as_json(self), 'cleared': self.cleared}

    @property
    def values(self) -> dict[str, object]:
        """It as it is published in `hunting/status`."""
        return {
            'clearance': self.words,
            'cleared': self.cleared,
            'held_speed_mps': self.speed_mps,
            'held_s': self.held_s,
            'held_margin': self.margin,
            'held_escape_chance': self.escape_chance,
        }


class _Second(NamedTuple):
    """
    What the rows of one second come to, and of the hold it is in the first one and the range.

    By itself it is a hold of its own.
    """

    number: int
    speed: float
    margin: float
    minute: float
    trouble: str
    hunts: bool
    first: int
    low: float
    high: float

    @classmethod
    def of(cls, rows: NDArray[np.void]) -> _Second:
        """Sum up the rows of a second."""
        wrong = np.bitwise_or.reduce([rows[f'{name}_wrong'] for name in CHANNELS])
        hunting = (rows['state'] == State.ESCAPING) | (rows['state'] == State.LIMIT_CYCLE)
        bad = (rows['doubts'] & ~np.uint32(_JUDGED)) | (wrong & ~np.uint32(health.ABSENT))
        bad = (bad != 0) | hunting | (rows['limits'] != 0)
        trouble = ''
        if bad.any():
            row = rows[np.flatnonzero(bad)[:1]].copy()
            row['doubts'] &= ~np.uint32(_JUDGED)
            trouble = next(iter(reason_counts(row)), 'the inputs cannot be trusted')
        calm = (rows['region'] == Region.STABLE) & np.isnan(rows['margin'])
        margin = np.where(calm & np.isfinite(rows['outlook']), math.inf, rows['margin_low'])
        number = int(rows['stamp_ns'][0]) // NANOSECONDS
        speed = float(rows['speed'].mean())  # a reading may scatter
        least, most = float(margin.min()), float(rows['outlook'].max())
        hold = number, speed, speed
        return cls(number, speed, least, most, trouble, bool(hunting.any()), *hold)

    def after(self, last: _Second | None) -> _Second:
        """Return it as one of the hold of the second before, where that goes on."""
        if last is None or self.number != last.number + 1:
            return self
        # Of numpy: what is not known does not vanish.
        low, high = np.minimum(last.low, self.speed), np.maximum(last.high, self.speed)
        if not high - low <= max(_BAND_MPS, _BAND * high):
            return self
        return self._replace(first=last.first, low=float(low), high=float(high))


class Clearances:
    """
    Judges the speeds that are held, from the rows of the detector in order.

    Parameters
    ----------
    config : DetectorConfig
        Its `margin_in` is the least margin.

    Attributes
    ----------
    least_s : int
        A speed is cleared no sooner than after so many whole seconds.
    ended : deque of Clearance
        Of the holds that were long enough and are over, the verdict at their end.

    Notes
    -----
    Smallest, largest, first or mean of what falls into each second: in whatever blocks the rows
    come, the verdict is the same. A row is missing where nothing was heard: that ends the hold.
    """

    def __init__(self, config: DetectorConfig) -> None:
        self.ended: deque[Clearance] = deque(maxlen=_KEPT)
        self.begin_anew(config)

    def begin_anew(self, config: DetectorConfig) -> None:
        """Forget the hold that is under way: there is another form."""
        self.least_s = math.ceil(_LEAST_S / config.faster)
        self.margin_in = config.margin_in
        #: Rows of the second that is not over yet.
        self._open = blank_rows(np.zeros(0, dtype=np.int64))
        #: The last ones of the hold.
        self._seconds: deque[_Second] = deque(maxlen=self.least_s)

    def update(self, rows: NDArray[np.void]) -> None:
        """Take rows of ESTIMATE_DTYPE, in order."""
        rows = joined_rows([self._open, rows])
        seconds = rows['stamp_ns'] // NANOSECONDS
        *over, self._open = np.split(rows, np.flatnonzero(np.diff(seconds)) + 1)
        for part in over:
            second = _Second.of(part).after(self._last)
            if second.first == second.number:  # of another hold
                self.ended.extend(self._long_enough())
                self._seconds.clear()
            self._seconds.append(second)

    @property
    def _last(self) -> _Second | None:
        return self._seconds[-1] if self._seconds else None

    @property
    def _held_s(self) -> int:
        return self._seconds[-1].number + 1 - self._seconds[-1].first if self._seconds else 0

    def now(self, doubt: str = '', forecast_high_mps: float = math.nan) -> Clearance:
        """
        Return the verdict on the speed that is held now.

        Parameters
        ----------
        doubt : str
            '' or why the rows so far do not tell what is now.
        forecast_high_mps : float
            Upper end of the 95 % interval of the forecast of v_c, m/s; NaN: there is none.
        """
        if not self._open.size:
            return Clearance(reason=doubt or Clearance.reason)
        newest = _Second.of(self._open)
        if self._seconds and self._open['stamp_ns'][-1] % NANOSECONDS < NANOSECONDS // 2:
            newest = newest._replace(speed=self._seconds[-1].speed)  # too few for a mean
        newest = newest.after(self._last)
        if doubt or newest.first == newest.number:
            # Not held yet, but whether it hunts is known.
            reason = doubt or newest.trouble or 'the speed is not held yet'
            hunts = (0.0, 1.0) if newest.hunts and not doubt else (math.nan, math.nan)
            return Clearance(newest.number * NANOSECONDS, newest.speed, 0.0, *hunts, reason)
        return self._judged([*self._seconds, newest], forecast_high_mps)

    def all(self) -> list[Clearance]:
        """Return the verdicts of all holds that were long enough, that of now among them."""
        return [*self.ended, *self._long_enough()]

    def _long_enough(self) -> list[Clearance]:
        """Return the verdict on the hold, if it was long enough for one."""
        return [self._judged(self._seconds)] if self._held_s >= self.least_s else []

    def _judged(
        self, seconds: Sequence[_Second], forecast_high_mps: float = math.nan
    ) -> Clearance:
        """Judge the last seconds of the hold, at least one."""
        # The hold may have begun with the end of a ramp, and end with the beginning of the next.
        held_s, speed = self._held_s, float(np.median([one.speed for one in seconds]))
        trouble = next((one.trouble for one in reversed(seconds) if one.trouble), '')
        short = held_s < self.least_s
        # Form and forecast contradict each other: then neither number is known.
        below = forecast_high_mps < speed
        margin = chance = math.nan
        if seconds[-1].hunts:
            margin, chance = 0.0, 1.0
        elif not (trouble or below or short):
            margin = float(np.min([one.margin for one in seconds]))
            minute = float(np.max([one.minute for one in seconds]))
            chance = 1.0 - (1.0 - minute) ** MINUTES
        against = {
            trouble: bool(trouble),
            'the speed is not known': math.isnan(speed),
            f'held for {held_s} s of {self.least_s} s': short,
            f'the forecast of v_c is {forecast_high_mps:.2f} m/s at most': below,
            'margin and chance of escape are not known': math.isnan(margin + chance),
            f'margin {margin:.1f} (95 %), expected {self.margin_in:g} or more': (
                margin < self.margin_in
            ),
            f'chance of an escape in {MINUTES} minutes {100.0 * chance:.0f} %': chance > _CHANCE,
        }
        reason = next((words for words, wrong in against.items() if wrong), '')
        begin_ns = seconds[-1].first * NANOSECONDS
        return Clearance(begin_ns, speed, float(held_s), margin, chance, reason)
