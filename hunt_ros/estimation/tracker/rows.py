"""One row of output from the state as it stands."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.algebra import line

_F = NDArray[np.float64]


@compiled_part
def radial(f: at.Filter, first: int) -> float:
    """Variance of the modulus of the phasor at `first`."""
    a, b = f.x[first], f.x[first + 1]
    power = a * a + b * b
    if power == 0.0:
        return float(0.5 * (f.P[first, first] + f.P[first + 1, first + 1]))
    inner = (
        a * a * f.P[first, first]
        + 2.0 * a * b * f.P[first, first + 1]
        + b * b * f.P[first + 1, first + 1]
    )
    return float(max(inner / power, 0.0))


@compiled_part
def write_row(f: at.Filter, row: _F) -> None:
    """Write one row of output from the state as it stands."""
    growth = f.x[at.GROWTH]
    for k in range(2):
        if f.sensors[k, at.S_ALIVE] == 0.0 and f.sensors[k, at.S_TIED] == 0.0:
            continue
        z, r = at.Z + 2 * k, line(f, k)
        amplitude = math.hypot(f.x[z], f.x[z + 1])
        variance = radial(f, z)
        across = 0.0
        if amplitude > 0.0:
            across = (f.x[z] * f.P[z, at.GROWTH] + f.x[z + 1] * f.P[z + 1, at.GROWTH]) / amplitude
        rate_variance = (
            amplitude * amplitude * f.P[at.GROWTH, at.GROWTH]
            + growth * growth * variance
            + 2.0 * amplitude * growth * across
        )
        o = at.O_Y if k == 0 else at.O_P
        row[o] = amplitude
        row[o + 1] = math.sqrt(variance)
        row[o + 2] = growth * amplitude
        row[o + 3] = math.sqrt(max(rate_variance, 0.0))
        if f.sensors[k, at.S_ALIVE] == 0.0:
            continue  # it has never spoken: its phasor is all that is known of it
        if f.sensors[k, at.S_ROLLER] > 0.0 and f.lines.shape[0] > 0:
            o = at.O_Y_ROUGH if k == 0 else at.O_P_ROUGH
            row[o] = math.hypot(f.x[r], f.x[r + 1])
            row[o + 1] = math.sqrt(radial(f, r))
            if f.lines.shape[0] > 1:
                row[o + 2] = math.hypot(f.x[r + 2], f.x[r + 3])
        row[at.O_Y_BIAS + k] = f.x[at.BIAS + k]
        row[at.O_Y_RESIDUAL + k] = math.sqrt(max(f.sensors[k, at.S_RESIDUAL], 0.0))
        row[at.O_Y_NIS + k] = f.sensors[k, at.S_NIS]
        row[at.O_Y_NOISE + k] = math.sqrt(f.sensors[k, at.S_NOISE])
        if f.sensors[k, at.S_CLEAN_COUNT] > 0.0:
            row[at.O_Y_CLEAN + k] = f.sensors[k, at.S_CLEAN_SUM] / f.sensors[k, at.S_CLEAN_COUNT]
        f.sensors[k, at.S_CLEAN_SUM] = 0.0
        f.sensors[k, at.S_CLEAN_COUNT] = 0.0
    lateral, yaw = f.sensors[0, at.S_ALIVE] > 0.0, f.sensors[1, at.S_ALIVE] > 0.0
    if not lateral and not yaw:
        return
    tied = f.sensors[0, at.S_TIED]
    row[at.O_Y_TIED] = tied
    z = at.Z if lateral or tied > 0.0 else at.Z + 2
    power = f.x[z] ** 2 + f.x[z + 1] ** 2
    row[at.O_PHASE] = math.atan2(f.x[z + 1], f.x[z])
    if power > 0.0:
        around = (
            f.x[z + 1] ** 2 * f.P[z, z]
            - 2.0 * f.x[z] * f.x[z + 1] * f.P[z, z + 1]
            + f.x[z] ** 2 * f.P[z + 1, z + 1]
        ) / (power * power)
        row[at.O_PHASE_STD] = min(math.sqrt(max(around, 0.0)), math.pi / math.sqrt(3.0))
    row[at.O_FREQUENCY] = f.x[at.OMEGA] / (2.0 * math.pi)
    row[at.O_FREQUENCY_STD] = math.sqrt(max(f.P[at.OMEGA, at.OMEGA], 0.0)) / (2.0 * math.pi)
    row[at.O_GROWTH] = growth
    row[at.O_GROWTH_STD] = math.sqrt(max(f.P[at.GROWTH, at.GROWTH], 0.0))
    if yaw and (lateral or tied > 0.0):
        size = math.hypot(f.m[at.M_RHO_RE], f.m[at.M_RHO_IM])
        row[at.O_RATIO] = size
        row[at.O_RATIO_STD] = math.sqrt(f.m[at.M_RHO_VAR])
        row[at.O_LAG] = math.atan2(f.m[at.M_RHO_IM], f.m[at.M_RHO_RE])
    row[at.O_BANDWIDTH] = math.exp(f.m[at.M_LAMBDA])
    row[at.O_SECOND] = math.hypot(f.x[at.W], f.x[at.W + 1])
    row[at.O_SINCE_KICK] = f.m[at.M_TIME] - f.m[at.M_KICK]
