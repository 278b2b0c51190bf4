"""
The noise intensity: how hard the quiet motion is driven, read off its size and damping.

Averaged over a cycle the amplitude is a diffusion with d<A^2>/dt = 2 <A^2 s> + 4 D, so in
the steady state D = -<A^2 s(v, A)> / 2 with s the growth rate of the form, Eq. (24).
Called by the kernel of the decisions, row by row.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection.basin import FormNumbers
from hunt_ros.detection.prediction import growth_at
from hunt_ros.detection.rules import Rules

#: What is remembered: D (m^2/s, NaN before it is known), and the rows it was learnt from.
NOISE_INTENSITY: np.dtype[np.void] = np.dtype(
    [('intensity', np.float64), ('rows', np.float64)], align=True
)

#: The damping must be at least this, 1/s, for the noise intensity to be read off it.
_LEAST_DAMPING = 0.1


@compiled_part
def learn(rules: Rules, form: FormNumbers, memory: Any, v: float, a: float) -> None:
    """Learn from a row of the quiet motion: speed, m/s, and amplitude, m."""
    rate = growth_at(form, v, a)
    if rate < -_LEAST_DAMPING:
        memory['rows'] += 1.0
        weight = max(1.0 / memory['rows'], 0.5 / rules.floor_rows)
        value = -0.5 * rate * a * a
        if math.isnan(memory['intensity']):
            memory['intensity'] = value
        else:
            memory['intensity'] += weight * (value - memory['intensity'])
