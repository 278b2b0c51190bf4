"""
The two machines: what the motion is, whether it hunts, and the alarm that hunting latches.

The motion is quiet or disturbed, by the noise floor alone. Whether it hunts is another
question, with a machine of its own. From each word, the first line whose evidence holds
names the word that is wanted; it is taken when it has been wanted for its hold time on end
(settings of `DetectorConfig`). No line without evidence: what cannot be seen does not end.

===========  ============================  ===========  ====================
hunting      evidence                      to           hold time
===========  ============================  ===========  ====================
no           beyond                        escaping     escape_hold
             arrived                       limit cycle  limit_cycle_hold
             steady                        limit cycle  -
             growing                       escaping     -
escaping     arrived                       limit cycle  limit_cycle_hold
             steady                        limit cycle  -
             beyond, growing               escaping     -
             returns                       decaying     quiet_hold
             falls, or over                decaying     -
decaying     arrived                       limit cycle  limit_cycle_hold
             steady                        limit cycle  -
             beyond                        escaping     escape_hold
             growing                       escaping     -
             over                          no           quiet_hold
limit cycle  falls, or over                decaying     -
===========  ============================  ===========  ====================

What is a likelihood ratio (steady, growing, falls: `likelihood`) has taken its time already.
The two are shown as one word, the `State`: while it hunts that of the hunting, else that of
the motion. Called by the kernel of the decisions, row by row.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection.decision import likelihood, noise_floor
from hunt_ros.detection.decision.evidence import ESCAPES, FALLING, HOLDING, OPEN, RETURNS, Evidence
from hunt_ros.detection.decision.rules import Rules
from hunt_ros.detection.regions import HELD, State, hold

#: What is remembered: the two machines, the cause of the last step of the hunting (one of those
#: below), the alarm, and that it has been acknowledged.
STATE: np.dtype[np.void] = np.dtype(
    [
        ('motion', HELD),
        ('hunting', HELD),
        ('cause', np.int64),
        ('alarm', np.bool_),
        ('acknowledged', np.bool_),
    ],
    align=True,
)

#: The words as the kernel compares them; a motion that is no hunting has the word 0.
QUIET, DISTURBED, ESCAPING, LIMIT_CYCLE, DECAYING = map(int, State)
NO = 0

#: Which evidence led to the word of the hunting that is in force.
BEYOND, ARRIVED, STEADY, GROWING, COMES_BACK, FALLS, OVER = range(1, 8)

#: The amplitude of the limit cycle is followed at this pace while the speed changes, s.
_FOLLOW_S = 5.0


@compiled_part
def wanted(rules: Rules, hunting: int, evidence: Evidence) -> tuple[int, int, int]:
    """Return the word the evidence asks for, its hold time in rows, and the cause: the table."""
    if hunting == LIMIT_CYCLE:
        if evidence.falls:
            return DECAYING, 0, FALLS
        return (DECAYING, 0, OVER) if evidence.over else (LIMIT_CYCLE, 0, 0)
    beyond = evidence.outcome == ESCAPES
    if beyond and hunting == NO:
        return ESCAPING, rules.escape_hold, BEYOND  # a bump may land on the limit cycle
    if evidence.arrived:
        return LIMIT_CYCLE, rules.cycle_hold, ARRIVED
    if evidence.steady:
        return LIMIT_CYCLE, 0, STEADY
    if beyond:
        return ESCAPING, rules.escape_hold, BEYOND
    if evidence.growing:
        return ESCAPING, 0, GROWING
    if hunting == ESCAPING:
        if evidence.outcome == RETURNS:
            return DECAYING, rules.quiet_hold, COMES_BACK
        if evidence.outcome == OPEN and evidence.falls:
            return DECAYING, 0, FALLS
        if evidence.over:
            return DECAYING, 0, OVER
    if hunting == DECAYING and evidence.over:
        return NO, rules.quiet_hold, OVER
    return hunting, 0, 0


@compiled_part
def next_state(
    rules: Rules,
    memory: Any,
    seen: Any,
    floor_memory: Any,
    evidence: Evidence,
    a: float,
    s: float,
    stamp_ns: int,
) -> None:
    """
    Let both machines take the word that is wanted, once it has been for long enough.

    Parameters
    ----------
    rules, memory, seen, floor_memory
        Thresholds; records of STATE, EVIDENCE and NOISE_FLOOR.
    evidence : Evidence
        Of the row.
    a, s : float
        Amplitude and its standard deviation, m.
    stamp_ns : int
        Of the row.
    """
    if evidence.disturbed:
        hold(memory['motion'], DISTURBED, rules.disturbed_hold, stamp_ns)
    else:
        hold(memory['motion'], QUIET, rules.quiet_hold, stamp_ns)
    want, rows, cause = wanted(rules, memory['hunting']['word'], evidence)
    changed = hold(memory['hunting'], want, rows, stamp_ns)
    if changed:
        memory['cause'] = cause
    hunting = memory['hunting']['word']
    if hunting not in (ESCAPING, LIMIT_CYCLE):
        return
    if changed or math.isnan(seen['reference']):
        seen['reference'] = a if changed or likelihood.well_known(a, s) else math.nan
        if changed and hunting == LIMIT_CYCLE:
            noise_floor.reconsider(floor_memory, a)
    elif hunting == ESCAPING:
        seen['reference'] = max(seen['reference'], a)
    elif likelihood.well_known(a, s):
        seen['reference'] += rules.stride / _FOLLOW_S * (a - seen['reference'])


def word_of(memory: Any) -> int:
    """Return the one word for both machines, a `State`."""
    hunting = memory['hunting']['word']
    return int(hunting if hunting != NO else memory['motion']['word'])


@compiled_part
def hunts(memory: Any) -> bool:
    """Return True while it escapes or is in the limit cycle: what the alarm is for."""
    return bool(memory['hunting']['word'] in (ESCAPING, LIMIT_CYCLE))


#: The same for kernels: called from Python it would be compiled anew in each process.
shown = compiled_part(word_of)


@compiled_part
def ratio_behind(rules: Rules, ratios: Any, cause: int) -> tuple[float, float]:
    """Return the log likelihood ratio that decides for a cause, and its limit; NaN: no ratio."""
    if cause == GROWING:
        # Less is asked of what holds for sure as well.
        least = likelihood.SOME if ratios['growth'] <= rules.evidence else 1.0
        return float(ratios['growth']), least * rules.evidence
    if cause == STEADY:
        return float(ratios['hold']), HOLDING * rules.evidence
    if cause == FALLS:
        return float(ratios['fall']), FALLING * rules.evidence
    return math.nan, math.nan


@compiled_part
def since_ns(memory: Any) -> int:
    """Return the stamp of the first row that asked for the word that is shown, ns."""
    motion, hunting = memory['motion']['since_ns'], memory['hunting']['since_ns']
    # When it is quiet again the last to come to an end has made it so.
    return int(hunting if memory['hunting']['word'] != NO else max(motion, hunting))
