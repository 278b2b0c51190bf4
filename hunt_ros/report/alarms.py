"""
How the alarms of recordings compare with what a person can take: rate, chattering, standing.

Definitions and limits are those of ANSI/ISA-18.2-2016 and IEC 62682:2022, the part on monitoring
and assessment. An alarm that comes while it is still on is the same alarm; one that was on before
the recording began is not of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any

from scipy.stats import chi2

from hunt_ros.drivers.alarms import alarm_of
from hunt_ros.report.numbers import shown
from hunt_ros.report.tables import place, table
from hunt_ros.samples import NANOSECONDS, Record, Uncertain

if TYPE_CHECKING:
    from hunt_ros.detection import Event

#: Alarms an hour that one person very likely copes with, and at most manages, on average.
ACCEPTABLE, MANAGEABLE = 6.0, 12.0
#: An alarm chatters that comes so often within so many s; no such alarm is acceptable.
CHATTERS, CHATTERS_S = 3, 60.0
#: An alarm that is on for longer stands ("stale" in the standards), s.
STANDS_S = 86_400.0

#: The suite ends its nodes one after the other: what falls silent so short before the end of a
#: recording calls nobody, s.
_ENDING_S = 5.0


def rate_per_hour(count: int, seconds: float) -> Uncertain:
    """Return events an hour, with the exact 95 % interval of a Poisson count (Garwood, 1936)."""
    hours = seconds / 3600.0
    if hours <= 0.0:
        return Uncertain(math.nan, math.nan)
    low = chi2.ppf(0.025, 2 * count) / 2.0 if count else 0.0
    high = chi2.ppf(0.975, 2 * count + 2) / 2.0
    return Uncertain(count / hours, math.sqrt(count) / hours, low / hours, high / hours)


@dataclass(frozen=True)
class AlarmLoad:
    """
    The alarms of one recording.

    Parameters
    ----------
    source : str
        The recording.
    live : bool
        True: as they were said live. False: as the detector says them with the form of the report.
    duration_s : float
        Of the recording.
    alarms : mapping of str to sequence of (float, float)
        Code of the alarm -> when it came and was over, s since the start; inf: it was on at the
        end.
    clips : sequence of str
        Names of its clips, which stand beside it.
    """

    source: str
    live: bool
    duration_s: float
    alarms: Mapping[str, Sequence[tuple[float, float]]]
    clips: Sequence[str] = ()

    @property
    def count(self) -> int:
        """How many came."""
        return sum(map(len, self.alarms.values()))

    @property
    def per_hour(self) -> Uncertain:
        """Alarms an hour, see `rate_per_hour`."""
        return rate_per_hour(self.count, self.duration_s)

    @cached_property
    def chattering(self) -> list[str]:
        """Those that came `CHATTERS` times within `CHATTERS_S`, by name."""
        return [
            name
            for name, times in self.alarms.items()
            if any(
                third - first <= CHATTERS_S
                for (first, _), (third, _) in zip(times, times[CHATTERS - 1 :], strict=False)
            )
        ]

    @cached_property
    def on_at_end(self) -> list[str]:
        """Those that were on when the recording ended, by name."""
        return [name for name, times in self.alarms.items() if times[-1][1] == math.inf]

    @property
    def longest_s(self) -> float:
        """How long an alarm was on at most, s; at least so long where it was on at the end."""
        ends = [spell for times in self.alarms.values() for spell in times]
        return max((min(over, self.duration_s) - began for began, over in ends), default=0.0)

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON types."""
        return {
            'recording': self.source,
            'live': self.live,
            'alarms': self.count,
            'per_hour': self.per_hour.to_json(),
            'chattering': self.chattering,
            'longest_s': self.longest_s,
            'on_at_end': self.on_at_end,
            'clips': list(self.clips),
        }


def load_of(
    events: Sequence[Event], record: Record, live: bool, clips: Sequence[str] = ()
) -> AlarmLoad:
    """
    Count the alarms among the events of a recording.

    Parameters
    ----------
    events : sequence of Event
        In the order of time. Those of level WARN and OK begin no alarm: they call nobody.
    record : Record
        For its start and its length.
    live, clips
        See `AlarmLoad`.
    """
    alarms: dict[str, list[tuple[float, float]]] = {}
    on: set[str] = set()
    for event in events:
        told = alarm_of(event.event, event.level.label, event.test, event.cause)
        if told is None:
            continue
        name, begins = told
        at_s = (event.stamp_ns - record.start_ns) / NANOSECONDS
        if begins and name not in on:
            on.add(name)
            alarms.setdefault(name, []).append((at_s, math.inf))
        elif not begins and name in on:
            on.remove(name)
            alarms[name][-1] = (alarms[name][-1][0], at_s)
    for name in [name for name in on if name.endswith('_silent')]:
        if alarms[name][-1][0] > record.duration_s - _ENDING_S:
            alarms[name].pop()
    kept = {name: times for name, times in alarms.items() if times}
    return AlarmLoad(record.source, live, record.duration_s, kept, clips)


def alarm_table(loads: Sequence[AlarmLoad]) -> str:
    """Return the table of the report, a row for each recording."""
    rows = [
        [
            place(load.source),
            'live' if load.live else 'with this form',
            str(load.count),
            shown(load.per_hour),
            _names(load.chattering),
            shown(load.longest_s, digits=3)
            + (' <b>standing</b>' if load.longest_s > STANDS_S else ''),
            _names(load.on_at_end),
            f'<span class="path">{_names(load.clips)}</span>',
        ]
        for load in loads
    ]
    caption = (
        'Alarms: what calls somebody (ERROR, STALE, a trip). ISA-18.2 and IEC 62682, for one'
        f' person, on average over a month: {ACCEPTABLE:g} an hour are very likely acceptable,'
        f' {MANAGEABLE:g} the most that can be managed; none may chatter ({CHATTERS} times within'
        f' {CHATTERS_S:g} s), or stand (for more than {STANDS_S / 3600.0:g} h) without a plan.'
    )
    header = [
        'recording', 'said', 'alarms', 'an hour', 'chattering', 'longest (s)', 'still on',
        'clips',
    ]  # fmt: skip
    return table(header, rows, caption)


def _names(names: Sequence[str]) -> str:
    return escape(', '.join(names)) or 'none'
