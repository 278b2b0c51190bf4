"""
Steadiness: does the amplitude stay as a limit cycle's does, or wander as noise-driven motion?

Running means over the rows in which the amplitude is well known. Called by the kernel
of the decisions, row by row.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection.rules import Rules

#: What is remembered of the well-known amplitude: how many rows it was taken from, its means
#: (m) over `_FAST_S`, `_SLOW_S` and `_LONG_S`, the mean squares (m^2) beside the latter two,
#: and the mean of its standard deviation (m).
STEADINESS: np.dtype[np.void] = np.dtype(
    [
        ('rows', np.float64),
        ('fast', np.float64),
        ('slow', np.float64),
        ('slow_square', np.float64),
        ('long', np.float64),
        ('long_square', np.float64),
        ('long_rows', np.float64),
        ('std', np.float64),
    ],
    align=True,
)

#: An amplitude is well known when its standard deviation is below this part of it.
SURE = 0.1
#: Time constants, s. The difference of the first two means tells the trend.
_FAST_S, _SLOW_S, _LONG_S = 0.5, 1.5, 4.0
#: Relative fluctuation of the amplitude that a limit cycle may have (noise-driven motion: 0.52).
_STEADY = 0.1
#: Steady over `_LONG_S` is a limit cycle, however large the noise floor seems to be.
#: Narrow-band noise of a damping as low as 0.08 1/s does not keep its amplitude within
#: this for 3 s once in 24 hours (simulated).
_VERY_STEADY = 0.08
#: The long means begin anew where the fast one leaves them by this part.
_ELSEWHERE = 0.25
#: How long the amplitude must have been steady, in units of `_LONG_S`.
_FROM_START, _AFTER_CHANGE = 0.5, 2.0


@compiled_part
def well_known(a: float, s: float) -> bool:
    """Tell an amplitude (m) that its standard deviation (m) leaves no doubt about."""
    return bool(s < SURE * a)


@compiled_part
def watch(rules: Rules, memory: Any, a: float, s: float) -> None:
    """Take in the amplitude of a row and its standard deviation, m."""
    if not well_known(a, s):
        return
    square = a * a
    memory['rows'] += 1.0
    rows = memory['rows']
    memory['fast'] += max(1.0 / rows, rules.stride / _FAST_S) * (a - memory['fast'])
    weight = max(1.0 / rows, rules.stride / _SLOW_S)
    memory['slow'] += weight * (a - memory['slow'])
    memory['slow_square'] += weight * (square - memory['slow_square'])
    memory['std'] += weight * (s - memory['std'])
    # The motion before a growth or a decay says nothing of what it has come to.
    if abs(memory['fast'] - memory['long']) > _ELSEWHERE * memory['long']:
        memory['long_rows'] = 0.0
        memory['long'] = memory['long_square'] = 0.0
    memory['long_rows'] += 1.0
    weight = max(1.0 / memory['long_rows'], rules.stride / _LONG_S)
    memory['long'] += weight * (a - memory['long'])
    memory['long_square'] += weight * (square - memory['long_square'])


@compiled_part
def trend(rules: Rules, memory: Any) -> float:
    """Relative rate of change of the well-known amplitude, 1/s; NaN before it is known."""
    if memory['rows'] * rules.stride < _SLOW_S:
        return math.nan
    lead = memory['fast'] - memory['slow']
    return float(lead / ((_SLOW_S - _FAST_S) * memory['slow']) * rules.stride / rules.period_s)


@compiled_part
def steady(rules: Rules, memory: Any) -> bool:
    """Tell an amplitude that neither moves nor fluctuates, as that of a limit cycle."""
    variance = memory['slow_square'] - memory['slow'] ** 2
    calm = variance < (_STEADY * memory['slow']) ** 2
    return bool(calm and abs(trend(rules, memory)) < rules.cycle_growth)


@compiled_part
def very_steady(rules: Rules, memory: Any) -> bool:
    """Tell an amplitude that noise cannot hold as steady for as long."""
    # After a change it takes longer: a noise-driven motion lingers at the top of its excursions.
    changed = memory['long_rows'] < memory['rows']
    span = _AFTER_CHANGE if changed else _FROM_START
    if memory['long_rows'] * rules.stride < span * _LONG_S or not steady(rules, memory):
        return False
    variance = memory['long_square'] - memory['long'] ** 2
    return bool(variance < (_VERY_STEADY * memory['long']) ** 2)
