"""
Doubts: what makes the level WARN at least, as bits of a row, each held against chatter.

Called by the kernel of the decisions, row by row.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection.regions import Region, State, held, switched
from hunt_ros.detection.rules import Rules

MARGIN, DISAGREE, NO_FORM, NO_SPEED, SETTLING, NO_ESTIMATE = 1, 2, 4, 8, 16, 32
DECAYING, HYSTERESIS, UNSTABLE = 64, 128, 256
#: Of the estimates themselves, told by `rows`: the lateral amplitude is that of yaw through the
#: mode shape; only yaw is known, and judged; the motion is outside the range that is tracked.
FROM_YAW, IN_YAW, TOO_SLOW, TOO_FAST = 512, 1024, 2048, 4096
OUTSIDE = TOO_SLOW | TOO_FAST

_UNKNOWN, _STABLE, _HYSTERESIS, _UNSTABLE = map(int, Region)
_ESCAPING, _DECAYING = int(State.ESCAPING), int(State.DECAYING)

#: What is remembered: doubts in force (0 or 1), and the rows for which the contrary was seen.
DOUBTS: np.dtype[np.void] = np.dtype(
    [
        ('margin_low', np.int64),
        ('margin_waited', np.int64),
        ('disagree', np.int64),
        ('disagree_waited', np.int64),
    ],
    align=True,
)


@compiled_part
def hold_doubts(
    rules: Rules,
    memory: Any,
    region: int,
    state: int,
    known: bool,
    disagree: bool,
    margin: float,
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
    """
    on = memory['margin_low'] > 0
    low = switched(on, -margin, -rules.margin_in, -rules.margin_out)
    hold = rules.margin_hold
    if math.isnan(margin):
        # No unstable branch: below v_n there is room enough, above v_c there is none. What
        # hunts, or is not known, has none to be restored.
        low = on and (region != _STABLE or state >= _ESCAPING or not known)
    elif on:
        hold = rules.margin_restore
    now, waited = held(memory['margin_low'], int(low), memory['margin_waited'], hold)
    memory['margin_low'] = now
    memory['margin_waited'] = waited
    bits = MARGIN if now > 0 else 0
    now, waited = held(
        memory['disagree'], int(disagree), memory['disagree_waited'], rules.disagree_hold
    )
    memory['disagree'] = now
    memory['disagree_waited'] = waited
    return bits | DISAGREE if now > 0 else bits


@compiled_part
def present(region: int, state: int, v: float, known: bool, settling: bool) -> int:
    """Return the doubts that need no memory: about speed, form, estimate, floor and state."""
    bits = 0
    if math.isnan(v):
        bits |= NO_SPEED
    elif region == _UNKNOWN:
        bits |= NO_FORM
    if not known:
        bits |= NO_ESTIMATE
    elif settling:
        bits |= SETTLING
    if state == _DECAYING:
        bits |= DECAYING
    if region == _HYSTERESIS:
        bits |= HYSTERESIS
    if region == _UNSTABLE:
        bits |= UNSTABLE
    return bits
