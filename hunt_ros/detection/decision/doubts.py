"""
Doubts: what makes the level WARN at least, as bits of a row, each held against chatter.

Called by the kernel of the decisions, row by row.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection.decision.rules import Rules
from hunt_ros.detection.regions import HELD, Region, State, hold, switched

MARGIN, DISAGREE, NO_FORM, NO_SPEED, SETTLING, NO_ESTIMATE = 1, 2, 4, 8, 16, 32
DECAYING, HYSTERESIS, UNSTABLE = 64, 128, 256
#: Of the estimates themselves, told by `rows`: the lateral amplitude is that of yaw through the
#: mode shape; only yaw is known, and judged; the motion is outside the range that is tracked.
FROM_YAW, IN_YAW, TOO_SLOW, TOO_FAST = 512, 1024, 2048, 4096
OUTSIDE = TOO_SLOW | TOO_FAST
#: The motion holds, and is not at the frequency of the hunting that the form gives.
OTHER = 8192
#: The sensors contradict each other; the motion cannot be told from a line of the roller.
CONTRARY, ON_LINE = 16384, 32768

_UNKNOWN, _STABLE, _HYSTERESIS, _UNSTABLE = map(int, Region)
_ESCAPING, _DECAYING = int(State.ESCAPING), int(State.DECAYING)

#: What is remembered: the doubts that are held, each 0 or 1.
DOUBTS: np.dtype[np.void] = np.dtype([('margin', HELD), ('disagree', HELD)], align=True)


@compiled_part
def hold_doubts(
    rules: Rules,
    memory: Any,
    region: int,
    state: int,
    known: bool,
    disagree: bool,
    margin: float,
    stamp_ns: int,
) -> int:
    """
    Take in a row; return the doubts in force about margin and agreement.

    Parameters
    ----------
    rules, memory
        Thresholds, and a record of DOUBTS.
    region : int
        Region of the speed.
    state : int
        Of the motion.
    known : bool
        The amplitude is known.
    disagree : bool
        The two amplitude estimates differ in this row.
    margin : float
        Unstable amplitude over amplitude; NaN without the first.
    stamp_ns : int
        Of the row.
    """
    on = memory['margin']['word'] > 0
    low = switched(on, -margin, -rules.margin_in, -rules.margin_out)
    rows = rules.margin_hold
    if math.isnan(margin):
        # No unstable branch: below v_n there is room enough, above v_c there is none. What
        # hunts, or is not known, has none to be restored.
        low = on and (region != _STABLE or state >= _ESCAPING or not known)
    elif on:
        rows = rules.margin_restore
    hold(memory['margin'], int(low), rows, stamp_ns)
    hold(memory['disagree'], int(disagree), rules.disagree_hold, stamp_ns)
    bits = MARGIN if memory['margin']['word'] > 0 else 0
    return bits | DISAGREE if memory['disagree']['word'] > 0 else bits


@compiled_part
def present(region: int, state: int, v: float, known: bool, settling: bool, other: bool) -> int:
    """Return the doubts that need no memory: speed, form, estimate, floor, state, frequency."""
    bits = 0
    if math.isnan(v):
        bits |= NO_SPEED
    elif region == _UNKNOWN:
        bits |= NO_FORM
    if not known:
        bits |= NO_ESTIMATE
    elif settling:
        bits |= SETTLING
    if other:
        bits |= OTHER
    if state == _DECAYING:
        bits |= DECAYING
    if region == _HYSTERESIS:
        bits |= HYSTERESIS
    if region == _UNSTABLE:
        bits |= UNSTABLE
    return bits
