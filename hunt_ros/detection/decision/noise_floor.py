"""
The noise floor: what amplitude counts as quiet, learnt from the motion itself.

It is learnt on what may be noise alone (`likelihood.excess`), and neither while the wheelset
hunts nor while the amplitude seems to grow. Called by the kernel of the decisions, row by row.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection.decision import likelihood
from hunt_ros.detection.decision.rules import Rules

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

#: The floor follows at once where the recent mean square lies below this part of it.
_FALLEN = 0.1
_RECENT_S = 3.0
#: The floor rises this much more slowly on a disturbance, which may be a new level of the noise.
_DISTURBED = 0.1
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
def learn(rules: Rules, memory: Any, ratios: Any, a: float, basin: bool = True) -> bool:
    """
    Learn the floor from a row that is not hunting: amplitude, m.

    Without a quiet `basin` at this speed, by the form, what grows is hunting that begins: the
    floor does not rise on it.

    Returns
    -------
    bool
        True where the row is one of the quiet motion, by the floor there was.
    """
    some = likelihood.SOME * rules.evidence
    if not likelihood.settled(ratios) or likelihood.excess(rules, ratios) > some:
        return False
    if math.isnan(memory['square']):
        memory['square'] = max(memory['recent'], 1e-300)
        memory['learnt'] = _RECENT_S / rules.stride
        return False
    if memory['recent'] < _FALLEN * memory['square']:
        memory['square'] += rules.stride / _RECENT_S * (memory['recent'] - memory['square'])
    limit = rules.disturbed_in**2 * memory['square']
    quiet = a * a <= limit
    rises = a * a > memory['square']
    pace = 1.0 if quiet else _DISTURBED
    if rises and (not basin or ratios['growth'] > some):
        pace = 0.0
    memory['learnt'] += pace
    weight = pace * max(1.0 / memory['learnt'], 1.0 / rules.floor_rows)
    memory['square'] += weight * (min(a * a, limit) - memory['square'])
    return bool(quiet)


@compiled_part
def floor_of(memory: Any, ratios: Any, s: float) -> float:
    """
    Return the amplitude (r.m.s.) that counts as quiet, m; NaN before anything is known.

    `s` is the standard deviation of the amplitude in this row, m, NaN without one: it stands
    in while the motion has been more than noise from the start.
    """
    floor = math.nan
    if not math.isnan(memory['square']):
        floor = math.sqrt(memory['square'])
    elif likelihood.settled(ratios):
        floor = STD_FLOORS * s
    return floor if floor > 0.0 else math.nan


@compiled_part
def begin_anew(memory: Any) -> None:
    """Forget a floor that was learnt at another speed."""
    memory['square'] = math.nan
    memory['learnt'] = 0.0
    memory['rows'] = 0.0


@compiled_part
def unlearnt(memory: Any) -> bool:
    """Return True while no floor has been learnt."""
    return bool(math.isnan(memory['square']))


@compiled_part
def reconsider(memory: Any, a: float) -> None:
    """Forget a floor that was learnt on the hunting itself, now seen at amplitude `a`, m."""
    if a * a < _FLOOR_CLEAR * memory['square']:
        memory['square'] = math.nan
        memory['rows'] = 0.0
