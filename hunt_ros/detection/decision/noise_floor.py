"""
The noise floor: the amplitude that counts as quiet, and how hard noise drives it.

The *floor* is learnt on what may be noise alone by its `likelihood.excess`, neither in hunting nor
while the amplitude seems to grow, and as fast at another speed as at first. The *intensity* D is
that of the steps of the quiet amplitude, dA = ... + sqrt(2 D) dW. Called by the kernel
of the decisions, row by row.
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
#: over a few seconds, and the least that it was (m^2, 0 before it is known); D (m^2/s, NaN before
#: it is known), and the deviation of its logarithm.
_FLOOR = ('square', 'learnt', 'rows', 'recent', 'least', 'intensity', 'spread')
NOISE_FLOOR: np.dtype[np.void] = np.dtype([(name, np.float64) for name in _FLOOR], align=True)

#: Time constant, s: some sixty periods tell a mean square to 13 %.
_FLOOR_S = 20.0
#: A motion of so many floors (squared) is no longer quiet: see `states.CLEAR`.
_LOUD = 9.0
#: A motion of so many (squared) that falls for sure was kicked: of noise alone one in fifty is.
_KICKED = 4.0
#: The floor follows at once where the recent mean square lies below this part of it.
_FALLEN, _RECENT_S = 0.1, 3.0
#: Without a floor yet, the standard deviation of the amplitude estimate stands in, so often.
_STD_FLOORS = 1.5


@compiled_part
def observe(rules: Rules, memory: Any, a: float) -> None:
    """Take in the amplitude of a row, m, whatever the wheelset does."""
    memory['rows'] += 1.0
    weight = max(1.0 / memory['rows'], rules.stride / _RECENT_S)
    memory['recent'] += weight * (a * a - memory['recent'])
    if memory['rows'] * rules.stride >= _RECENT_S:
        recent, least = memory['recent'], memory['least']
        memory['least'] = min(least, recent) if least > 0.0 else recent


@compiled_part
def learn(
    rules: Rules, memory: Any, ratios: Any, a: float, growth: float, basin: bool, dying: bool
) -> None:
    """
    Learn floor and intensity from a row that is not hunting: amplitude, m, and the growth
    rate of a small motion, 1/s, NaN where it is not known.

    Without a quiet `basin` at this speed, by the form, what grows is hunting that begins: the
    floor neither begins nor rises on it. It begins with the least that was seen: what hunts just
    when the noise is known is not the noise. While hunting is `dying` out it follows slowly.
    """
    some = likelihood.SOME * rules.evidence
    if not likelihood.settled(ratios) or likelihood.excess(rules, ratios) > some:
        return
    if math.isnan(memory['square']):
        if not basin:
            return
        memory['square'] = max(memory['least'] or memory['recent'], 1e-300)
        memory['learnt'] = _RECENT_S / rules.stride
        return
    if memory['recent'] < _FALLEN * memory['square']:
        memory['square'] += rules.stride / _RECENT_S * (memory['recent'] - memory['square'])
    limit = _LOUD * memory['square']
    quiet = a * a <= limit
    grows = a * a > memory['square'] and (not basin or ratios['growth'] > some)
    # What was kicked dies out, and is no noise; noise that has risen jumps again and again.
    kicked = ratios['smooth'] < likelihood.HORIZONS[-1] and ratios['fall'] > some
    if not (grows or (kicked and a * a > _KICKED * memory['square'])):
        memory['learnt'] = min(memory['learnt'], likelihood.rows_near(rules, ratios)) + 1.0
        weight = max(0.0 if dying else 1.0 / memory['learnt'], rules.stride / _FLOOR_S)
        memory['square'] += weight * (min(a * a, limit) - memory['square'])
    if quiet:
        memory['intensity'], memory['spread'] = likelihood.intensity(rules, ratios, -growth)


@compiled_part
def amplitude_of(memory: Any, ratios: Any, s: float) -> float:
    """
    Return the amplitude (r.m.s.) that counts as quiet, m; NaN before anything is known.

    `s` is the standard deviation of the amplitude in this row, m, NaN without one: it stands
    in while the motion has been more than noise from the start.
    """
    floor = math.nan
    if not math.isnan(memory['square']):
        floor = math.sqrt(memory['square'])
    elif likelihood.settled(ratios):
        floor = _STD_FLOORS * s
    return floor if floor > 0.0 else math.nan
