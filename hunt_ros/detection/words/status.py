"""The detector's present view, and every value of it as it is published."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from hunt_ros.detection import doubts, health
from hunt_ros.detection.door import Door
from hunt_ros.detection.output import PUBLIC, no_row, seconds_text
from hunt_ros.detection.regions import Level, Region, State
from hunt_ros.detection.words.alarms import AlarmHistory
from hunt_ros.detection.words.reasons import absent_words, causes_of
from hunt_ros.detection.words.transitions import Transitions
from hunt_ros.samples import CLOCK_OFFSET_NS


@dataclass(frozen=True)
class DetectorStatus:
    """
    The detector's present view.

    Parameters
    ----------
    stamp_ns : int
        Row it was taken at; 0 before the first.
    level : Level
    region : Region
    state : State
    alarm : bool
        Latched: hunting was seen and has not been acknowledged.
    reasons : tuple of str
        Why the level is what it is: one short sentence each, empty when OK.
    absent : tuple of str
        Optional channels that are absent, and what that costs: no reason for a level.
    dropped : mapping of str to int
        Refused samples, 'channel reason' to count.
    clock_offsets_s : mapping of str to float
        Channel and by how much the detector's clock is ahead of its clock, transport delay
        included, s; without those not known.
    values : mapping of str to object
        All of it as it is published in `hunting/status`, with the unit in the key; NaN and ''
        where unknown.
    """

    stamp_ns: int
    level: Level
    region: Region
    state: State
    alarm: bool
    reasons: tuple[str, ...]
    absent: tuple[str, ...]
    dropped: Mapping[str, int]
    clock_offsets_s: Mapping[str, float]
    values: Mapping[str, object]

    def number(self, key: str) -> float:
        """Return one of the values that are numbers, e.g. 'amplitude_m'; NaN: unknown."""
        value = self.values[key]
        return float(value) if isinstance(value, (int, float)) else math.nan


def status_of(
    transitions: Transitions,
    door: Door,
    present: tuple[State, bool],
    history: AlarmHistory,
    sequence: int,
) -> DetectorStatus:
    """
    Put the last row and the counts of the channels into a status.

    Parameters
    ----------
    transitions : Transitions
        The last row, why it is so, and since when.
    door : Door
        What the channels refused, their clocks, and those that the others wait for: then the row
        is an old one, and its level STALE.
    present : tuple of (State, bool)
        State and alarm in force, also before the first row.
    history : AlarmHistory
        The alarms there were.
    sequence : int
        Number of rows so far.
    """
    offsets, behind = door.clock_offsets_s, door.behind
    refused = [
        f'{name}: clocks differ by {abs(offsets[name]):.1f} s,'
        f' more than the {1e-9 * CLOCK_OFFSET_NS:g} s that are followed'
        for name, channel in door.channels.items()
        if not channel.clock.believed
    ]
    if not sequence:
        row, until_ns, level = no_row(), 0, Level.STALE
        reasons = ['no data yet', *refused]
    else:
        row = transitions.row
        until_ns = int(row['stamp_ns']) if door.watermark_ns is None else door.watermark_ns
        level = Level.STALE if behind else Level(int(row['level']))
        apart = {
            f'{name}: {health.WORDS[health.CLOCK]}': f' by {abs(offset):.1f} s'
            for name, offset in offsets.items()
        }
        reasons = [told + apart.get(told, '') for told in transitions.reasons(row)]
        reasons += [*behind, *refused]
        reasons += [
            f'{name}: {channel.refused_since} samples refused for their stamps'
            for name, channel in door.channels.items()
            if channel.refused_since
        ]
    (state, alarm), region, absent = present, Region(int(row['region'])), absent_words(row)
    dropped, basis = door.dropped, transitions.basis
    # Where no rows come, the last one does not tell all: `inputs`, which cannot be shelved.
    blind = ['inputs'] if behind or not until_ns else []
    causes = [*causes_of(row), *blind, *(history.codes if alarm else [])]
    values: dict[str, object] = {
        'state': state.label,
        'region': region.label,
        'alarm': alarm,
        'causes': ' '.join(dict.fromkeys(causes)),
        # What cannot be told from a line of the roller is a doubt of another kind.
        'undecided': int(row['doubts']) & (doubts.SETTLING | doubts.ON_LINE) == doubts.SETTLING,
        'sequence': sequence,
        'inputs_until_ns': until_ns,
        'since_s': seconds_text(transitions.level_since_ns),
        'test': transitions.test,
        'state_since_s': seconds_text(int(row['state_since_ns'])),
        'state_decided_s': seconds_text(transitions.decided_ns),
        'normal_form': basis.normal_form,
        'v_n_mps': basis.v_n if basis.v_n > 0.0 else math.nan,  # no number where it is unknown
        'v_c_mps': basis.v_c,
        'fold_amplitude_m': basis.fold_amplitude,
        'absent': '; '.join(absent),
        **{name: '' if x is None else x for name, x in history.totals().items()},
        **{public: float(row[name]) for name, public in PUBLIC.items()},
        **{f'dropped {what}': count for what, count in dropped.items()},
        **{f'clock_offset_s {name}': x for name, x in offsets.items()},
    }
    stamp_ns = int(row['stamp_ns'])
    return DetectorStatus(
        stamp_ns, level, region, state, alarm, tuple(reasons), absent, dropped, offsets, values
    )
