"""
The state machine: from the evidence of a row to the state, and the alarm that it latches.

From each state, the first line whose evidence holds names the state that is wanted; it
is taken when it has been wanted for its hold time on end (settings of `DetectorConfig`).

==================  =========  ===========  ====================
from                evidence   to           hold time
==================  =========  ===========  ====================
quiet, disturbed    beyond     escaping     escape_hold
                    arrived    limit cycle  limit_cycle_hold
                    steady     limit cycle  3 limit_cycle_hold
                    growing    escaping     growth_hold
                    disturbed  disturbed    disturbed_hold
                    -          quiet        quiet_hold
escaping, decaying  arrived    limit cycle  limit_cycle_hold
                    steady     limit cycle  3 limit_cycle_hold
                    beyond     escaping     escape_hold
                    growing    escaping     growth_hold
                    over       quiet        quiet_hold
                    -          decaying     decay_hold
limit cycle         lost       decaying     decay_hold
                    -          limit cycle  -
==================  =========  ===========  ====================

Whatever else is wanted, quiet ends after `disturbed_hold` of a disturbance: what is on its
way to a limit cycle is not quiet until that is sure.

Called by the kernel of the decisions, row by row.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection import noise_floor
from hunt_ros.detection.evidence import Evidence
from hunt_ros.detection.regions import State, held
from hunt_ros.detection.rules import Rules

#: What is remembered: the state, the state that was asked for and for how many rows; for how
#: many rows on end the motion has been disturbed; the alarm.
STATE: np.dtype[np.void] = np.dtype(
    [
        ('state', np.int64),
        ('wanted', np.int64),
        ('waited', np.int64),
        ('stirred', np.int64),
        ('alarm', np.bool_),
        ('acknowledged', np.bool_),
    ],
    align=True,
)

#: The states as the kernel compares them.
QUIET, DISTURBED, ESCAPING, LIMIT_CYCLE, DECAYING = map(int, State)

#: The amplitude of the limit cycle is followed at this pace, a row, while the speed changes.
_FOLLOW = 0.002


@compiled_part
def wanted(rules: Rules, state: int, evidence: Evidence) -> tuple[int, int]:
    """Return the state the evidence asks for, and the rows for which it must: the table."""
    if state == LIMIT_CYCLE:
        return (DECAYING, rules.decay_hold) if evidence.lost else (LIMIT_CYCLE, 0)
    hunting = state in (ESCAPING, DECAYING)
    if evidence.beyond and not hunting:
        return ESCAPING, rules.escape_hold  # a bump may land on the limit cycle: no waiting
    if evidence.arrived:
        return LIMIT_CYCLE, rules.cycle_hold
    if evidence.steady:
        return LIMIT_CYCLE, 3 * rules.cycle_hold
    if evidence.beyond:
        return ESCAPING, rules.escape_hold
    if evidence.growing:
        return ESCAPING, rules.growth_hold
    if hunting:
        return (QUIET, rules.quiet_hold) if evidence.over else (DECAYING, rules.decay_hold)
    return (DISTURBED, rules.disturbed_hold) if evidence.disturbed else (QUIET, rules.quiet_hold)


@compiled_part
def next_state(
    rules: Rules, memory: Any, seen: Any, floor_memory: Any, evidence: Evidence, a: float
) -> None:
    """
    Take the state that is wanted, once it has been for long enough.

    Parameters
    ----------
    rules, memory, seen, floor_memory
        Thresholds; records of STATE, EVIDENCE and NOISE_FLOOR.
    evidence : Evidence
        Of the row.
    a : float
        Amplitude, m.
    """
    memory['stirred'] = memory['stirred'] + 1 if evidence.disturbed else 0
    state = memory['state']
    if state == QUIET and memory['stirred'] > rules.disturbed_hold:
        state = DISTURBED
    want, hold = wanted(rules, state, evidence)
    leaves = want in (QUIET, DECAYING) and memory['wanted'] in (QUIET, DECAYING)
    # Whether quiet or still dying: from one to the other and back, the escape is over.
    same = want == memory['wanted'] or (state == ESCAPING and leaves)
    waited = memory['waited'] if same else 0
    memory['wanted'] = want
    new, waited = held(state, want, waited, hold)
    memory['state'] = new
    memory['waited'] = waited
    if new in (LIMIT_CYCLE, ESCAPING):
        if new != state:
            seen['reference'] = a
            if new == LIMIT_CYCLE:
                noise_floor.reconsider(floor_memory, a)
        elif new == ESCAPING:
            seen['reference'] = max(seen['reference'], a)
        else:
            seen['reference'] += _FOLLOW * (a - seen['reference'])


@compiled_part
def latch(memory: Any) -> None:
    """Latch the alarm; an acknowledgement counts once the hunting is over."""
    if memory['state'] == ESCAPING or memory['state'] == LIMIT_CYCLE:
        memory['alarm'] = True
    elif memory['acknowledged']:
        memory['alarm'] = False
        memory['acknowledged'] = False
