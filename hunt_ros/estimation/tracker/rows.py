"""One row of output from the state as it stands."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.algebra import line, told

_F = NDArray[np.float64]


@compiled_part
def radial(f: at.Filter, first: int) -> float:
    """Variance of the modulus of the phasor at `first`."""
    x, P = f.x, f.P
    a, b = x[first], x[first + 1]
    power = a * a + b * b
    if power == 0.0:
        return float(0.5 * (P[first, first] + P[first + 1, first + 1]))
    inner = (
        a * a * P[first, first]
        + 2.0 * a * b * P[first, first + 1]
        + b * b * P[first + 1, first + 1]
    )
    return float(max(inner / power, 0.0))


@compiled_part
def spread(t: at.Tracker, first: int) -> float:
    """Variance of the modulus of the phasor at `first`, with the doubt what has happened."""
    x = t.filters[t.lead].x
    modulus = math.hypot(x[first], x[first + 1])
    total = weight = 0.0
    for h in range(at.HYPOTHESES):
        f = t.filters[h]
        if not t.on_trial[h].alive:
            continue
        share = math.exp(t.on_trial[h].likelihood - t.on_trial[t.lead].likelihood)
        off = math.hypot(f.x[first], f.x[first + 1]) - modulus
        total += share * (radial(f, first) + off * off)
        weight += share
    return total / weight


@compiled_part
def write_row(t: at.Tracker, row: _F) -> None:
    """Write one row of output from the state of the likeliest filter as it stands."""
    f = t.filters[t.lead]
    x, P = f.x, f.P
    growth = x[at.GROWTH]
    for c in range(2):
        if not told(f, c) and not f.coordinates[c].tied:
            continue
        z = at.Z + 2 * c
        amplitude = math.hypot(x[z], x[z + 1])
        variance = spread(t, z)
        across = 0.0
        if amplitude > 0.0:
            across = (x[z] * P[z, at.GROWTH] + x[z + 1] * P[z + 1, at.GROWTH]) / amplitude
        rate_variance = (
            amplitude * amplitude * P[at.GROWTH, at.GROWTH]
            + growth * growth * variance
            + 2.0 * amplitude * growth * across
        )
        o = at.N_COORDINATE * c
        row[o + at.O_AMPLITUDE] = amplitude
        row[o + at.O_STD] = math.sqrt(variance)
        row[o + at.O_RATE] = growth * amplitude
        row[o + at.O_RATE_STD] = math.sqrt(max(rate_variance, 0.0))
    for k in range(f.sensor_count):
        sensor = f.sensors[k]
        if not sensor.alive:
            continue
        o, r = at.O_SENSOR + at.N_SENSOR * k, line(f, k)
        if sensor.angle_known and f.line_count > 0:
            row[o + at.O_ROUGH] = math.hypot(x[r], x[r + 1])
            row[o + at.O_ROUGH_STD] = math.sqrt(radial(f, r))
            if f.line_count > 1:
                row[o + at.O_ROUGH2] = math.hypot(x[r + 2], x[r + 3])
        row[o + at.O_BIAS] = x[at.BIAS + k]
        row[o + at.O_RESIDUAL] = math.sqrt(max(sensor.residual, 0.0))
        row[o + at.O_NIS] = sensor.nis
        row[o + at.O_NOISE] = math.sqrt(sensor.noise)
        if sensor.clean_count > 0.0:
            row[o + at.O_CLEAN] = sensor.clean_sum / sensor.clean_count
        for h in range(at.HYPOTHESES):
            t.filters[h].sensors[k].clean_sum = 0.0
            t.filters[h].sensors[k].clean_count = 0.0
    lateral, yaw = told(f, 0), told(f, 1)
    if not lateral and not yaw:
        return
    tied = f.coordinates[0].tied
    row[at.O_TIED] = tied
    z = at.Z if lateral or tied > 0.0 else at.Z + 2
    power = x[z] ** 2 + x[z + 1] ** 2
    row[at.O_PHASE] = math.atan2(x[z + 1], x[z])
    if power > 0.0:
        around = (
            x[z + 1] ** 2 * P[z, z]
            - 2.0 * x[z] * x[z + 1] * P[z, z + 1]
            + x[z] ** 2 * P[z + 1, z + 1]
        ) / (power * power)
        row[at.O_PHASE_STD] = min(math.sqrt(max(around, 0.0)), math.pi / math.sqrt(3.0))
    row[at.O_FREQUENCY] = x[at.OMEGA] / (2.0 * math.pi)
    row[at.O_FREQUENCY_STD] = math.sqrt(max(P[at.OMEGA, at.OMEGA], 0.0)) / (2.0 * math.pi)
    row[at.O_GROWTH] = growth
    row[at.O_GROWTH_STD] = math.sqrt(max(P[at.GROWTH, at.GROWTH], 0.0))
    if (yaw or f.coordinates[1].tied) and (lateral or tied > 0.0):
        size = math.hypot(f.rho_re, f.rho_im)
        row[at.O_RATIO] = size
        row[at.O_RATIO_STD] = math.sqrt(f.rho_var)
        row[at.O_LAG] = math.atan2(f.rho_im, f.rho_re)
        if not math.isnan(f.mode.rho_re):
            doubt = f.ratio_var + f.mode.rho_std**2 + f.cfg.ratio_std**2
            row[at.O_FACTOR] = math.hypot(f.ratio_re, f.ratio_im)
            row[at.O_CONTRARY] = math.hypot(f.ratio_re - 1.0, f.ratio_im) / math.sqrt(doubt)
    row[at.O_BANDWIDTH] = math.exp(f.log_bandwidth)
    row[at.O_SECOND] = math.hypot(x[at.W], x[at.W + 1])
    row[at.O_SINCE_KICK] = f.time - f.kick
