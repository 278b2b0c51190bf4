"""The detector's present view, as it is published."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hunt_ros.detection.channels import health
from hunt_ros.detection.merging.clocks import ChannelClock
from hunt_ros.detection.merging.intake import Intake
from hunt_ros.detection.output import NUMBERS
from hunt_ros.detection.regions import Level, Region, State
from hunt_ros.detection.words.alarms import AlarmHistory
from hunt_ros.detection.words.reasons import absent_words
from hunt_ros.detection.words.transitions import Transitions


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
    reasons : tuple of str
        Why the level is what it is: one short sentence each, empty when OK.
    alarm : bool
        Latched: hunting was seen and has not been acknowledged.
    sequence : int
        Number of rows so far.
    inputs_until_ns : int
        Stamp up to which all inputs are known; 0 before that.
    numbers : mapping of str to float
        Every number of `NUMBERS`; NaN where unknown.
    dropped : mapping of str to int
        Refused samples, 'channel reason' to count.
    clock_offsets_s : mapping of str to float
        Channel and by how much the detector's clock is ahead of its clock, transport delay
        included, s; without those not known.
    test : str
        Which test decided the state; '' before any.
    since_ns, state_since_ns, state_decided_ns : int
        Stamps of the rows at which the level came into force, at which the state began, and at
        which it was decided; 0 before any.
    normal_form : str
        The form in force, by its critical speeds; '' where there is none.
    absent : tuple of str
        Optional channels that are absent, and what that costs: no reason for a level.
    totals : mapping of str to int, float or None
        What `AlarmHistory.totals` gives.
    v_n, v_c : float
        Critical speeds in force, m/s; NaN: unknown, or none.
    fold_amplitude : float
        Of the limit cycle at v_n, m; NaN: unknown.
    """

    stamp_ns: int = 0
    level: Level = Level.STALE
    region: Region = Region.UNKNOWN
    state: State = State.QUIET
    reasons: tuple[str, ...] = ('no data yet',)
    alarm: bool = False
    sequence: int = 0
    inputs_until_ns: int = 0
    numbers: Mapping[str, float] = field(default_factory=lambda: dict.fromkeys(NUMBERS, math.nan))
    dropped: Mapping[str, int] = field(default_factory=dict)
    clock_offsets_s: Mapping[str, float] = field(default_factory=dict)
    test: str = ''
    since_ns: int = 0
    state_since_ns: int = 0
    state_decided_ns: int = 0
    normal_form: str = ''
    absent: tuple[str, ...] = ()
    totals: Mapping[str, Any] = field(default_factory=dict)
    v_n: float = math.nan
    v_c: float = math.nan
    fold_amplitude: float = math.nan

    def __getattr__(self, name: str) -> float:
        """Return one of the numbers by its name."""
        numbers = self.__dict__.get('numbers', {})
        if name in numbers:
            return float(numbers[name])
        raise AttributeError(name)


def status_of(
    row: np.void | None,
    transitions: Transitions,
    intakes: Mapping[str, Intake],
    clocks: Mapping[str, ChannelClock],
    present: tuple[State, bool],
    history: AlarmHistory,
    sequence: int,
    inputs_until_ns: int | None,
    behind: tuple[str, ...],
) -> DetectorStatus:
    """
    Put the last row and the counts of the channels into a status.

    Parameters
    ----------
    row : void of ESTIMATE_DTYPE or None
        The last row; None before the first.
    transitions : Transitions
        Why it is so, and since when.
    intakes : mapping of str to Intake
        The channels: what they refused is told.
    clocks : mapping of str to ChannelClock
        Theirs.
    present : tuple of (State, bool)
        State and latched alarm: an acknowledgement acts between two rows.
    history : AlarmHistory
        Its totals are told.
    sequence : int
        Number of rows so far.
    inputs_until_ns : int or None
        Stamp up to which all inputs are known; None: that of the row.
    behind : tuple of str
        Channels for which the others wait: the row is an old one, and its level STALE.
    """
    dropped = {
        f'{channel} {reason}': count
        for channel, intake in intakes.items()
        for reason, count in vars(intake.counts).items()
        if count
    }
    state, alarm = present
    basis = transitions.basis
    offsets = {
        name: 1e-9 * (clock.shift_ns if clock.offset_ns is None else clock.offset_ns)
        for name, clock in clocks.items()
        if clock.offset_ns is not None or clock.shift_ns
    }
    refused = tuple(
        f'{name}: clocks differ by {abs(offsets[name]):.1f} s,'
        f' more than the {1e-9 * clock.limit_ns:g} s that are followed'
        for name, clock in clocks.items()
        if not clock.believed
    )
    if row is None:
        return DetectorStatus(
            state=state,
            reasons=('no data yet', *refused),
            alarm=alarm,
            dropped=dropped,
            clock_offsets_s=offsets,
            normal_form=basis.normal_form,
            totals=history.totals(),
            v_n=basis.v_n,
            v_c=basis.v_c,
            fold_amplitude=basis.fold_amplitude,
        )
    refused += tuple(
        f'{channel}: {intake.refused_since} samples refused for their stamps'
        for channel, intake in intakes.items()
        if intake.refused_since
    )
    stamp_ns = int(row['stamp_ns'])
    return DetectorStatus(
        stamp_ns=stamp_ns,
        level=Level.STALE if behind else Level(int(row['level'])),
        region=Region(int(row['region'])),
        state=state,
        reasons=(*_with_offsets(transitions.reasons(row), offsets), *behind, *refused),
        alarm=alarm,
        sequence=sequence,
        inputs_until_ns=stamp_ns if inputs_until_ns is None else inputs_until_ns,
        numbers={name: float(row[name]) for name in NUMBERS},
        dropped=dropped,
        clock_offsets_s=offsets,
        test=transitions.test,
        since_ns=transitions.level_since_ns,
        state_since_ns=int(row['state_since_ns']),
        state_decided_ns=transitions.decided_ns,
        normal_form=basis.normal_form,
        absent=absent_words(row),
        totals=history.totals(),
        v_n=basis.v_n,
        v_c=basis.v_c,
        fold_amplitude=basis.fold_amplitude,
    )


def _with_offsets(reasons: tuple[str, ...], offsets_s: Mapping[str, float]) -> tuple[str, ...]:
    """Add to the reasons how far the clocks are apart."""
    numbers = {
        f'{name}: {health.WORDS[health.CLOCK]}': f' by {abs(offset):.1f} s'
        for name, offset in offsets_s.items()
    }
    return tuple(reason + numbers.get(reason, '') for reason in reasons)
