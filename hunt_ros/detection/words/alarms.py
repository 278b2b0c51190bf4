"""
What the alarm was for: the last alarms, the highest amplitude, and how long it hunted.

Fed with the rows and the events of the detector, and with the acknowledgements: it knows no
clock. It is not journalled, for it follows from what is.
"""

from __future__ import annotations

import itertools
import json
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection.decision.limits import ALARMS, LIMITS
from hunt_ros.detection.output import Event
from hunt_ros.detection.regions import State
from hunt_ros.samples import NANOSECONDS, known

#: Alarms that are kept.
KEPT = 100
#: Who acknowledged, where no name came with it.
UNKNOWN = 'unknown'

#: After a kick, and while the filter starts, an amplitude may be far off: one whose standard
#: deviation is a larger part of it than this is not the highest.
_SURE = 0.1
#: How far an alarm came, from less to more.
_FAR = ('amplitude_limit', State.ESCAPING.label, State.LIMIT_CYCLE.label)
_COLUMNS = (('lateral', 'highest_amplitude_m'), ('yaw', 'highest_yaw_amplitude_rad'))


@dataclass
class Alarm:
    """
    One alarm: hunting, or an amplitude above an alarm limit, from its beginning to its end.

    Parameters
    ----------
    began_ns, decided_ns : int
        First row that showed it, and the row at which it was said.
    cause : str
        Why it was said, as a sentence with its numbers.
    test : str
        Which test decided.
    reached : str
        How far it came: 'amplitude_limit', 'escaping' or 'limit_cycle'.
    over_ns : int
        Row at which it was over; 0 while it lasts.
    highest_amplitude_m, highest_yaw_amplitude_rad : float
        Highest amplitudes that were known to 10 %; NaN where none was.
    acknowledged_ns : int
        0 where nobody has.
    acknowledged_by : str
        The name that came with it, or 'unknown'; '' where nobody has.
    causes : int
        What latched it, as `decide` counts it: 1 the hunting, 2 << k the limit k.
    """

    began_ns: int
    decided_ns: int
    cause: str
    test: str
    reached: str
    over_ns: int = 0
    highest_amplitude_m: float = math.nan
    highest_yaw_amplitude_rad: float = math.nan
    acknowledged_ns: int = 0
    acknowledged_by: str = ''
    causes: int = 0

    @property
    def codes(self) -> list[str]:
        """Codes of what latched it (docs/alarm.md)."""
        limits = [each.setting for k, each in enumerate(LIMITS) if self.causes & 2 << k]
        return [self.reached, *limits] if self.causes & 1 else limits

    def to_json(self, origin_ns: int = 0) -> dict[str, Any]:
        """
        Return it for JSON, with null for what is not known or has not been.

        Stamps are in seconds from `origin_ns` on.
        """

        def seconds(stamp_ns: int, there: object = True) -> float | None:
            """Return a stamp in seconds from the origin; None where it is not there."""
            return (stamp_ns - origin_ns) / NANOSECONDS if there else None

        return {
            'began_s': seconds(self.began_ns),
            'decided_s': seconds(self.decided_ns),
            'over_s': seconds(self.over_ns, self.over_ns),
            'reached': self.reached,
            'test': self.test,
            'cause': self.cause,
            **{name: known(getattr(self, name)) for _, name in _COLUMNS},
            'acknowledged_s': seconds(self.acknowledged_ns, self.acknowledged_by),
            'acknowledged_by': self.acknowledged_by or None,
        }


def _begins(event: Event) -> bool:
    """Return True for an event with which an alarm may begin."""
    return event.event in _FAR or (
        event.event == 'limit_exceeded' and event.test.startswith('alarm_')
    )


class AlarmHistory:
    """
    The last `KEPT` alarms, and totals over all.

    Parameters
    ----------
    period_ns : int
        Spacing of the rows, ns.

    Attributes
    ----------
    alarms : deque of Alarm
        Those that are kept, the oldest first.
    count : int
        Alarms so far, also those that are no longer kept.
    since_ns : int or None
        First row that was seen; None before any. What was before is not known here.
    highest : dict of str to float
        Highest amplitudes of the hunting by the names of `Alarm`; NaN before any.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self.alarms: deque[Alarm] = deque(maxlen=KEPT)
        #: Of the last row the causes of an alarm, and whether one lasts.
        self._causes, self._lasts = 0, False
        self._hunting_rows = 0
        self.count = 0
        self.since_ns: int | None = None
        self.highest = {name: math.nan for _, name in _COLUMNS}

    @property
    def _lasting(self) -> Alarm | None:
        """The alarm that lasts."""
        return self.alarms[-1] if self.alarms and not self.alarms[-1].over_ns else None

    @property
    def codes(self) -> list[str]:
        """Codes of those that nobody has acknowledged (docs/alarm.md)."""
        open_ones = (alarm.codes for alarm in self.alarms if not alarm.acknowledged_by)
        return list(itertools.chain.from_iterable(open_ones))

    @property
    def hunting_hours(self) -> float:
        """How long it hunted, until the hunting was over, h."""
        return self._hunting_rows * self._period_ns / (3600.0 * NANOSECONDS)

    def update(self, rows: NDArray[np.void], events: Sequence[Event]) -> None:
        """
        Take in rows and their events.

        Parameters
        ----------
        rows : ndarray of ESTIMATE_DTYPE, shape (m,)
            m > 0.
        events : sequence of Event
            Their transitions, in order.
        """
        if self.since_ns is None:
            self.since_ns = int(rows['stamp_ns'][0])
        hunting = rows['state'] >= State.ESCAPING
        self._hunting_rows += int(np.count_nonzero(hunting))
        limits = rows['limits'].astype(np.int64) & ALARMS
        causes = 2 * limits + (hunting & (rows['state'] != State.DECAYING))
        lasts = hunting | (limits != 0)
        new = causes & ~np.append(self._causes, causes[:-1])
        over = np.append(self._lasts, lasts[:-1]) & ~lasts
        self._causes, self._lasts = int(causes[-1]), bool(lasts[-1])
        cuts = np.flatnonzero((new != 0) | over).tolist()
        for begin, end in itertools.pairwise(sorted({0, *cuts, rows.size})):
            stamp_ns, alarm = int(rows['stamp_ns'][begin]), self._lasting
            # What comes beside one that nobody has acknowledged belongs to it.
            begins = new[begin] and (alarm is None or alarm.acknowledged_by)
            if alarm and (begins or over[begin]):
                alarm.over_ns = stamp_ns
            said = [event for event in events if event.stamp_ns == stamp_ns and _begins(event)]
            if begins and said:
                self.count += 1
                began_ns, cause, test = said[0].since_ns, said[0].cause, said[0].test
                self.alarms.append(Alarm(began_ns, stamp_ns, cause, test, _FAR[0]))
            if lasting := self._lasting:
                lasting.causes |= int(new[begin])
            self._measure(rows[begin:end])

    def _measure(self, rows: NDArray[np.void]) -> None:
        """Take in how far the alarm came in rows, and their amplitudes."""
        if (alarm := self._lasting) is None:
            return
        far = [state.label for state in State if state.label in _FAR and state in rows['state']]
        alarm.reached = max([alarm.reached, *far], key=_FAR.index)
        for channel, name in _COLUMNS:
            amplitude, std = rows[f'{channel}_amplitude'], rows[f'{channel}_amplitude_std']
            # Where lateral is that of yaw through the mode shape, its own sensors may be dead.
            sure = amplitude[~rows[f'{channel}_blind'] & (std < _SURE * amplitude)]
            if sure.size:
                highest = float(sure.max())
                self.highest[name] = float(np.fmax(self.highest[name], highest))
                setattr(alarm, name, float(np.fmax(getattr(alarm, name), highest)))

    def acknowledge(self, now_ns: int, by: str) -> None:
        """Note who has acknowledged all alarms there are."""
        for alarm in self.alarms:
            if not alarm.acknowledged_by:
                alarm.acknowledged_ns, alarm.acknowledged_by = now_ns, by or UNKNOWN

    def to_json(self, origin_ns: int = 0) -> dict[str, Any]:
        """Return the totals, and the alarms that are kept, the oldest first; s from an origin."""
        since_ns = self.since_ns
        return {
            'since_s': None if since_ns is None else (since_ns - origin_ns) / NANOSECONDS,
            **self.totals(),
            'alarms': [alarm.to_json(origin_ns) for alarm in self.alarms],
        }

    def totals(self) -> dict[str, Any]:
        """Return the totals by their public names; null for what is not known."""
        return {
            'alarm_count': self.count,
            'hunting_hours': self.hunting_hours,
            **{name: known(value) for name, value in self.highest.items()},
        }

    def to_text(self) -> str:
        """Return `to_json` as text."""
        return json.dumps(self.to_json(), allow_nan=False)
