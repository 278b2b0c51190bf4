"""
The noise floor: what amplitude counts as quiet, learnt from the motion itself.

Learning stops while the wheelset hunts, and is wary of a motion that may be hunting on
its way up. Called by the kernel of the decisions, row by row.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection.rules import Rules
from hunt_ros.detection.steadiness import steady, well_known

#: What is remembered: mean square of the quiet amplitude (m^2, NaN before it is known) and the
#: rows it was learnt from; rows with an estimate since the start; mean square of the amplitude
#: over a few seconds (m^2).
NOISE_FLOOR: np.dtype[np.void] = np.dtype(
    [
        ('square', np.float64),
        ('learnt', np.float64),
        ('rows', np.float64),
        ('recent', np.float64),
    ],
    align=True,
)

#: Rows of the quiet motion, s, from which the first noise floor is taken.
_SETTLE_S = 2.0
#: A motion that is large from the start, and not steady, is given this long, s, before it is
#: taken for the quiet motion of a lively rig.
_PATIENCE_S = 5.0
#: Share of the rows in which the amplitude must be well known for it to be large.
_MOSTLY = 0.5
#: The floor follows at once where the recent mean square lies below this part of it.
_FALLEN = 0.1
_RECENT_S = 3.0
#: The floor rises this much more slowly on a motion that stands clear of the sensor noise: it
#: may be hunting on its way up.
_WARY = 0.25
#: And this much more slowly on a disturbance, which may be a new level of the noise.
_DISTURBED = 0.1
#: A floor learnt for no longer than this, s, may be half of what it will be, or less.
_YOUNG_S = 4.0
#: Hunting that stands less clear of the floor than this (squared) shows the floor to be wrong.
_FLOOR_CLEAR = 9.0
#: Without a floor yet, the standard deviation of the amplitude estimate stands in, so often.
STD_FLOORS = 1.5


@compiled_part
def observe(rules: Rules, memory: Any, a: float) -> None:
    """Take in the amplitude of a row, m, whatever the wheelset does."""
    memory['rows'] += 1.0
    weight = max(1.0 / memory['rows'], rules.stride / _RECENT_S)
    memory['recent'] += weight * (a * a - memory['recent'])


@compiled_part
def learn(
    rules: Rules, memory: Any, steadiness: Any, a: float, s: float, basin: bool = True
) -> bool:
    """
    Learn the floor from a row that is not hunting: amplitude and standard deviation, m.

    Without a quiet `basin` at this speed, by the form, what stands clear of the sensor noise
    is hunting that begins: the floor does not rise on it.

    Returns
    -------
    bool
        True where the row is one of the quiet motion, by the floor there was.
    """
    if math.isnan(memory['square']):
        elapsed = memory['rows'] * rules.stride
        large = steadiness['rows'] > _MOSTLY * memory['rows']
        patience = _PATIENCE_S if large else _SETTLE_S
        if elapsed >= patience and not (large and steady(rules, steadiness)):
            memory['square'] = max(memory['recent'], 1e-300)
            memory['learnt'] = _SETTLE_S / rules.stride
        return False
    if memory['recent'] < _FALLEN * memory['square']:
        memory['square'] += rules.stride / _RECENT_S * (memory['recent'] - memory['square'])
    square = a * a
    limit = rules.disturbed_in**2 * memory['square']
    quiet = square <= limit
    pace = 1.0
    if not quiet:
        square = limit
        pace = _DISTURBED if basin else 0.0
    elif square > memory['square'] and well_known(a, s):
        pace = _WARY if basin else 0.0
    memory['learnt'] += pace
    weight = pace * max(1.0 / memory['learnt'], 1.0 / rules.floor_rows)
    memory['square'] += weight * (square - memory['square'])
    return bool(quiet)


@compiled_part
def floor_of(rules: Rules, memory: Any, steadiness: Any, s: float) -> float:
    """
    Return the amplitude (r.m.s.) that counts as quiet, m; NaN before anything is known.

    `s` is the standard deviation of the amplitude in this row, m, NaN without one.
    """
    floor = rules.floor
    if not math.isnan(memory['square']):
        floor = max(floor, math.sqrt(memory['square']))
    elif floor == 0.0 and memory['rows'] * rules.stride >= _SETTLE_S:
        floor = STD_FLOORS * (steadiness['std'] if steadiness['rows'] > 0.0 else s)
    return floor if floor > 0.0 else math.nan


@compiled_part
def unlearnt(rules: Rules, memory: Any) -> bool:
    """Tell that no floor is set and none has been learnt."""
    return bool(math.isnan(memory['square']) and rules.floor == 0.0)


@compiled_part
def clearance(rules: Rules, memory: Any) -> float:
    """Return by how much more a motion must stand clear of a floor that is still young."""
    return float(1.0 + _YOUNG_S / (max(memory['learnt'], 1.0) * rules.stride))


@compiled_part
def reconsider(memory: Any, a: float) -> None:
    """Forget a floor that was learnt on the hunting itself, now seen at amplitude `a`, m."""
    if a * a < _FLOOR_CLEAR * memory['square']:
        memory['square'] = math.nan
        memory['rows'] = 0.0
