"""
The noise: what amplitude counts as quiet, and how hard the quiet motion is driven.

The *floor* is learnt on what may be noise alone (`likelihood.excess`), and neither while the
wheelset hunts nor while the amplitude seems to grow.

The *intensity* is read off the steps of the quiet phasor. Averaged over a cycle that of hunting
diffuses, d<|z|^2> = (2 s |z|^2 + 4 D) dt, with s the growth rate of the form, Eq. (24). From one
mark to another T later it moves by

    <|z(t + T) - exp((s + i omega) T) z(t)|^2> = 4 D (exp(2 s T) - 1) / (2 s),

and that of the tracker by 4 D tau less, because the noise of the last tau (the lag of the
filter, the life of the second mode) does not show in it yet: the difference of a long
step and a short one is free of tau. A step tells as much as a whole memory 1 / |s| of
the amplitude does, so D is known some ten times sooner than from <|z|^2> = 2 D / |s|.
Called by the kernel of the decisions, row by row.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection.decision import likelihood
from hunt_ros.detection.decision.outlook import FormNumbers
from hunt_ros.detection.decision.prediction import growth_at
from hunt_ros.detection.decision.rules import Rules, rows_of
from hunt_ros.estimation.tracker_config import REFERENCE_HZ

#: What is remembered: mean square of the quiet amplitude (m^2, NaN before it is known) and the
#: rows it was learnt from; rows with an estimate since the start; mean square of the amplitude
#: over a few seconds (m^2).
NOISE_FLOOR: np.dtype[np.void] = np.dtype(
    [(name, np.float64) for name in ('square', 'learnt', 'rows', 'recent')], align=True
)

#: Time constant, s: some sixty periods tell a mean square to 13 %.
_FLOOR_S = 20.0
#: A motion of so many floors (squared) is no longer quiet: see `states.CLEAR`.
_LOUD = 9.0
#: The floor follows at once where the recent mean square lies below this part of it.
_FALLEN, _RECENT_S = 0.1, 3.0
#: The floor rises this much more slowly on a disturbance, which may be a new level of the noise.
_DISTURBED = 0.1
#: Without a floor yet, the standard deviation of the amplitude estimate stands in, so often.
_STD_FLOORS = 1.5

#: Marks in a long step; a short one has one. Spacing of the marks, s.
_LONG, _MARK_S = 3, 0.75 / REFERENCE_HZ
#: Steps before anything is said.
_FEWEST = 4
#: Standard deviation of ln D times the root of the long steps that fit into the time of
#: learning (of a Gaussian phasor, simulated), and its bound while they are few.
_SPREAD, _LARGEST_SPREAD = 1.3, 0.8
#: What the difference of the steps says is at least this part of what the long one says.
_LEAST = 0.3

#: What is remembered: D (m^2/s, NaN before it is known) and the standard deviation of its
#: logarithm; the phasors at the last marks (m), how many there are on end, and the rows since
#: the last one; how many steps were taken, and of those of either length the means of their
#: power, of what the ends have in common, and of their time.
NOISE_INTENSITY: np.dtype[np.void] = np.dtype(
    [
        ('intensity', np.float64),
        ('spread', np.float64),
        ('marks', np.int64),
        ('rows', np.int64),
        ('z', np.complex128, (_LONG + 1,)),
        ('steps', np.float64),
        ('power', np.float64, (2,)),
        ('turned', np.complex128, (2,)),
        ('time', np.float64, (2,)),
    ],
    align=True,
)


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
    limit = _LOUD * memory['square']
    quiet = a * a <= limit
    pace = 1.0 if quiet else _DISTURBED
    if a * a > memory['square'] and (not basin or ratios['growth'] > some):
        pace = 0.0
    memory['learnt'] += pace
    weight = pace * max(1.0 / memory['learnt'], rules.stride / _FLOOR_S)
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
        floor = _STD_FLOORS * s
    return floor if floor > 0.0 else math.nan


@compiled_part
def forget_floor(memory: Any) -> None:
    """Forget a floor that was learnt at another speed, or on the hunting itself."""
    memory['square'] = math.nan
    memory['learnt'] = memory['rows'] = 0.0


@compiled_part
def reconsider(memory: Any, a: float) -> None:
    """Forget a floor that the hunting, now seen at amplitude `a`, m, does not stand clear of."""
    if a * a < _LOUD * memory['square']:
        forget_floor(memory)


@compiled_part
def interrupt(memory: Any) -> None:
    """Begin the chain of marks anew: the motion was not quiet, or not known."""
    memory['marks'] = memory['rows'] = 0


@compiled_part
def learn_intensity(
    rules: Rules, form: FormNumbers, memory: Any, v: float, a: float, phase: float
) -> None:
    """Learn from a row of the quiet motion: speed, m/s, amplitude, m, and phase, rad."""
    if math.isnan(phase):
        interrupt(memory)
        return
    memory['rows'] += 1
    mark = max(rows_of(rules, _MARK_S), 1)
    if memory['marks'] > 0 and memory['rows'] < mark:
        return
    memory['rows'] = 0
    z = memory['z']
    for k in range(_LONG):
        z[k] = z[k + 1]
    z[_LONG] = complex(a * math.cos(phase), a * math.sin(phase))
    memory['marks'] = min(memory['marks'] + 1, _LONG + 1)
    if memory['marks'] <= _LONG:
        return
    memory['steps'] += 1.0
    weight = max(1.0 / memory['steps'], 0.5 * mark * rules.stride / _FLOOR_S)
    moved = np.empty(2)
    for which, first in enumerate((_LONG - 1, 0)):
        span = (_LONG - first) * mark * rules.period_s
        rate = growth_at(form, v, abs(z[first]))
        growth = math.exp(rate * span)
        time = span if abs(rate * span) < 1e-6 else (growth * growth - 1.0) / (2.0 * rate)
        power = abs(z[_LONG]) ** 2 + (growth * abs(z[first])) ** 2
        memory['power'][which] += weight * (power - memory['power'][which])
        turned = growth * z[_LONG] * z[first].conjugate()
        memory['turned'][which] += weight * (turned - memory['turned'][which])
        memory['time'][which] += weight * (time - memory['time'][which])
        # Turned by the angle that makes it smallest.
        moved[which] = memory['power'][which] - 2.0 * abs(memory['turned'][which])
    if memory['steps'] < _FEWEST:
        return
    plain = moved[1] / memory['time'][1]
    slope = (moved[1] - moved[0]) / (memory['time'][1] - memory['time'][0])
    memory['intensity'] = 0.25 * max(slope, _LEAST * plain)
    memory['spread'] = min(_SPREAD * math.sqrt(_LONG * weight), _LARGEST_SPREAD)
