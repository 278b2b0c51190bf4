"""
The noise intensity: how hard the quiet motion is driven, read off the steps of its phasor.

Averaged over a cycle the phasor of hunting diffuses, d<|z|^2> = (2 s |z|^2 + 4 D) dt, with
s the growth rate of the form, Eq. (24). From one mark to another T later it moves by

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
from hunt_ros.detection.decision.outlook import FormNumbers
from hunt_ros.detection.decision.prediction import growth_at
from hunt_ros.detection.decision.rules import Rules

#: Marks in a long step; a short one has one.
_LONG = 3

#: What is remembered: D (m^2/s, NaN before it is known) and the standard deviation of its
#: logarithm; the phasors at the last marks (m), how many there are on end, and the rows since
#: the last one; means over the steps of either length, and how many they were taken from.
NOISE_INTENSITY: np.dtype[np.void] = np.dtype(
    [
        ('intensity', np.float64),
        ('spread', np.float64),
        ('marks', np.int64),
        ('rows', np.int64),
        ('re', np.float64, (_LONG + 1,)),
        ('im', np.float64, (_LONG + 1,)),
        ('steps', np.float64),
        ('power', np.float64, (2,)),
        ('turned_re', np.float64, (2,)),
        ('turned_im', np.float64, (2,)),
        ('time', np.float64, (2,)),
    ],
    align=True,
)

#: Steps before anything is said.
_FEWEST = 4
#: Standard deviation of ln D times the root of the long steps that fit into the time of
#: learning (of a Gaussian phasor, simulated), and its bound while they are few.
_SPREAD, _LARGEST_SPREAD = 1.3, 0.8
#: What the difference of the steps says is at least this part of what the long one says.
_LEAST = 0.3


@compiled_part
def interrupt(memory: Any) -> None:
    """Begin the chain of marks anew: the motion was not quiet, or not known."""
    memory['marks'] = 0
    memory['rows'] = 0


@compiled_part
def learn(rules: Rules, form: FormNumbers, memory: Any, v: float, a: float, phase: float) -> None:
    """Learn from a row of the quiet motion: speed, m/s, amplitude, m, and phase, rad."""
    if math.isnan(phase):
        interrupt(memory)
        return
    memory['rows'] += 1
    if memory['marks'] > 0 and memory['rows'] < rules.mark:
        return
    memory['rows'] = 0
    re, im = memory['re'], memory['im']
    for k in range(_LONG):
        re[k], im[k] = re[k + 1], im[k + 1]
    re[_LONG], im[_LONG] = a * math.cos(phase), a * math.sin(phase)
    memory['marks'] = min(memory['marks'] + 1, _LONG + 1)
    if memory['marks'] <= _LONG:
        return
    span = rules.mark * rules.period_s
    memory['steps'] += 1.0
    weight = max(1.0 / memory['steps'], 0.5 * rules.mark / rules.floor_rows)
    _average(form, memory, 0, _LONG - 1, v, span, weight)
    _average(form, memory, 1, 0, v, _LONG * span, weight)
    if memory['steps'] < _FEWEST:
        return
    short, long = _moved(memory, 0), _moved(memory, 1)
    plain = long / memory['time'][1]
    slope = (long - short) / (memory['time'][1] - memory['time'][0])
    memory['intensity'] = 0.25 * max(slope, _LEAST * plain)
    memory['spread'] = min(_SPREAD * math.sqrt(_LONG * weight), _LARGEST_SPREAD)


@compiled_part
def _average(
    form: FormNumbers, memory: Any, which: int, first: int, v: float, span: float, weight: float
) -> None:
    """Take in the step of `span` s from mark `first` to the last one."""
    re0, im0 = memory['re'][first], memory['im'][first]
    re1, im1 = memory['re'][_LONG], memory['im'][_LONG]
    rate = growth_at(form, v, math.hypot(re0, im0))
    growth = math.exp(rate * span)
    time = span if abs(rate * span) < 1e-6 else (growth * growth - 1.0) / (2.0 * rate)
    power = re1 * re1 + im1 * im1 + growth * growth * (re0 * re0 + im0 * im0)
    memory['power'][which] += weight * (power - memory['power'][which])
    turned = growth * (re1 * re0 + im1 * im0)
    memory['turned_re'][which] += weight * (turned - memory['turned_re'][which])
    turned = growth * (im1 * re0 - re1 * im0)
    memory['turned_im'][which] += weight * (turned - memory['turned_im'][which])
    memory['time'][which] += weight * (time - memory['time'][which])


@compiled_part
def _moved(memory: Any, which: int) -> float:
    """Mean square of the steps, m^2, turned by the angle that makes it smallest."""
    turned = math.hypot(memory['turned_re'][which], memory['turned_im'][which])
    return float(memory['power'][which] - 2.0 * turned)
