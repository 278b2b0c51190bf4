"""
The recordings by day: what each day shows, and how far the days are apart.

A day is what the recording calls it (note `day`), or else the date of its first stamp.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.analysis.day_spread import (
    DayAmplitude,
    DayBranches,
    Hit,
    branch_by_day,
    hits_by_speed,
)
from hunt_ros.analysis.steady_state import SteadyState, observed_critical_speeds
from hunt_ros.dynamics.normal_form import Criticality
from hunt_ros.identification.record.envelope import Envelope
from hunt_ros.identification.record.observed import resolved
from hunt_ros.identification.record.segments import Segment
from hunt_ros.samples import NANOSECONDS, Record

#: Stamps before this are seconds of a run, not dates (2000-01-01), ns.
_FIRST_DATE_NS = 946_684_800 * NANOSECONDS
#: Day of recordings that neither name one nor have a date.
UNDATED = 'undated'
#: A transient at one speed: change of the speed along it, relative.
_ONE_SPEED = 0.01
#: Free motion is larger than the quiet one by this factor: Rayleigh's amplitude is not.
_ABOVE_QUIET = 8.0


def day_of(record: Record) -> str:
    """Return the day of a recording: its note `day`, or the UTC date of its first stamp."""
    named = record.notes.get('day', '').strip()
    if named:
        return named
    if record.start_ns < _FIRST_DATE_NS:
        return UNDATED
    return f'{datetime.fromtimestamp(record.start_ns // NANOSECONDS, timezone.utc):%Y-%m-%d}'


@dataclass(frozen=True)
class DaySummary:
    """What one day shows; NaN where it shows nothing. Units: m, m/s."""

    day: str
    recordings: int
    steady_states: int
    shift: float = math.nan
    observed_v_c: float | None = None
    observed_v_n: float | None = None
    highest_decay: float | None = None
    lowest_growth: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `days.summary`."""
        return {
            'day': self.day,
            'recordings': self.recordings,
            'steady_states': self.steady_states,
            'shift_m': self.shift if math.isfinite(self.shift) else None,
            'observed_v_c': self.observed_v_c,
            'observed_v_n': self.observed_v_n,
            'highest_decay_mps': self.highest_decay,
            'lowest_growth_mps': self.lowest_growth,
        }


@dataclass(frozen=True, eq=False)
class Days:
    """
    All days side by side.

    Parameters
    ----------
    summaries : sequence of DaySummary
    branches : DayBranches
        The stable branch of each day.
    hits : sequence of Hit
        Free motion at one speed.
    seed : int
        Of the bootstrap over days.
    """

    summaries: Sequence[DaySummary]
    branches: DayBranches
    hits: Sequence[Hit]
    seed: int = 0

    @property
    def day_std(self) -> float:
        """Standard deviation of the limit cycle from day to day, m; NaN if not known."""
        return self.branches.day_std()

    def bracket(self) -> tuple[float | None, float | None]:
        """Highest speed at which free motion decayed, lowest at which it grew, m/s."""
        return highest_decay(self.hits), lowest_growth(self.hits)

    def to_json(self) -> dict[str, Any]:
        """Return the entry `days`."""
        branch = self.branches.spreads(self.seed)
        rates = hits_by_speed(self.hits, self.seed)
        std = self.day_std
        decay, growth = self.bracket()
        return {
            'summary': [one.to_json() for one in self.summaries],
            'day_std_m': std if math.isfinite(std) else None,
            'stable_branch': [one.to_json('amplitude', 'm') for one in branch],
            'growth_rates': [one.to_json('growth_rate', 'per_s') for one in rates],
            'hits': [hit.to_json() for hit in self.hits],
            'highest_decay_mps': decay,
            'lowest_growth_mps': growth,
        }


def highest_decay(hits: Sequence[Hit]) -> float | None:
    """Return the highest speed at which free motion decayed, m/s."""
    return max((hit.speed for hit in hits if not hit.grew), default=None)


def lowest_growth(hits: Sequence[Hit]) -> float | None:
    """Return the lowest speed at which free motion grew, m/s."""
    return min((hit.speed for hit in hits if hit.grew), default=None)


def by_day(
    day: Mapping[str, str],
    states: Sequence[SteadyState],
    segments: Sequence[Segment],
    envelopes: Sequence[Envelope],
    threshold: float | None,
    seed: int = 0,
    criticality: Criticality | None = None,
) -> Days:
    """
    Sort what was seen by day.

    Parameters
    ----------
    day : mapping of str to str
        Of each source.
    states, segments, envelopes : sequences
        What was seen in them.
    threshold : float or None
        Amplitude that parts quiet from hunting, m.
    seed : int
        Of the bootstrap over days.
    criticality : 'subcritical', 'supercritical' or None
        Of the rig: one without a fold has no fall to be observed.
    """
    hunting = [s for s in states if threshold is not None and s.amplitude > threshold]
    branches = branch_by_day(
        [DayAmplitude(s.speed, s.amplitude, day.get(s.source, UNDATED)) for s in hunting]
    )
    hits = free_motion(segments, envelopes, threshold, day)
    shifts = branches.shifts()
    kicks = [(part.source, part.start_ns) for part in segments if part.kind == 'kick']
    summaries = []
    for name in sorted(set(day.values())):
        own = [state for state in states if day.get(state.source, UNDATED) == name]
        observed = resolved(observed_critical_speeds(own, kicks), criticality).speeds
        mine = [hit for hit in hits if hit.day == name]
        summaries.append(
            DaySummary(
                name,
                sum(value == name for value in day.values()),
                len(own),
                shifts.get(name, math.nan) if len(shifts) > 1 else math.nan,
                observed.v_c,
                observed.v_n,
                highest_decay(mine),
                lowest_growth(mine),
            )
        )
    return Days(tuple(summaries), branches, tuple(hits), seed)


def free_motion(
    segments: Sequence[Segment],
    envelopes: Sequence[Envelope],
    threshold: float | None,
    day: Mapping[str, str] = MappingProxyType({}),
) -> list[Hit]:
    """
    Return the free motion at one speed, out of the noise.

    Parameters
    ----------
    segments, envelopes : sequences
        What was seen.
    threshold : float or None
        Amplitude that parts quiet from hunting, m.
    day : mapping of str to str, optional
        Of each source.
    """
    if threshold is None:
        return []
    everywhere = np.concatenate([envelope.amplitude for envelope in envelopes])
    still = everywhere[np.isfinite(everywhere) & (everywhere <= threshold)]
    # Rayleigh's distribution by its median, which the hits themselves do not move.
    quiet = float(np.median(still)) / 0.83 if still.size else 0.0
    hits = []
    for segment in segments:
        if segment.kind != 'transient':
            continue
        if abs(segment.speed_end - segment.speed_start) > _ONE_SPEED * abs(segment.speed_start):
            continue
        amplitude = _along(segment, envelopes)
        # Below this it is noise that wanders, whatever its trend.
        if amplitude.size < 2 or float(amplitude.max()) < _ABOVE_QUIET * quiet:
            continue
        begin, end = float(amplitude[0]), float(amplitude[-1])
        # What shrinks onto the limit cycle from above has not decayed.
        if (end > begin) != (end > threshold):
            continue
        hits.append(
            Hit(
                round(segment.speed_start, 9),
                day.get(segment.source, UNDATED),
                segment.source,
                begin,
                end,
                segment.growth_rate,
                segment.growth_rate_std,
            )
        )
    return hits


def _along(segment: Segment, envelopes: Sequence[Envelope]) -> NDArray[np.float64]:
    """Amplitudes along a segment, m; empty where no envelope holds it."""
    for envelope in envelopes:
        if envelope.source == segment.source:
            stamps = envelope.start_ns + 1e9 * envelope.time
            inside = (stamps >= segment.start_ns - 1e6) & (stamps <= segment.end_ns + 1e6)
            amplitude = envelope.amplitude[inside & np.isfinite(envelope.amplitude)]
            if amplitude.size:
                return amplitude
    return np.zeros(0)
