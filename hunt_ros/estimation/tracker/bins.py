"""From samples to updates: the open bin, and what becomes of it when it closes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.algebra import (
    correct,
    diffuse,
    expected,
    line,
    open_modes,
    predict,
    project,
    roughness,
    slip,
    turn_lines,
)
from hunt_ros.estimation.tracker.kicks import handle_kick, kicked
from hunt_ros.estimation.tracker.ratio import (
    learn_ratio,
    put_in_force,
    ratio_in_force,
    tie_silent,
)
from hunt_ros.estimation.tracker.tuning import gather_start, stop_sensor, tune

_F = NDArray[np.float64]
_I = NDArray[np.int64]


@compiled_part
def advance(f: at.Filter, t: float) -> None:
    """Bring the filter to time t, s."""
    dt = t - f.m[at.M_TIME]
    if dt <= 0.0 or f.sensors[0, at.S_ALIVE] + f.sensors[1, at.S_ALIVE] == 0.0:
        return
    f.m[at.M_TIME] = t
    if dt > f.cfg[at.C_GAP]:
        lost = 4.0 * (f.x[0] * f.x[0] + f.x[1] * f.x[1] + f.P[0, 0] + f.P[1, 1])
        open_modes(f, lost)
        dt = f.cfg[at.C_GAP]
    predict(f, dt)
    diffuse(f, dt)
    f.x[at.OMEGA] = min(max(f.x[at.OMEGA], f.cfg[at.C_OMEGA_MIN]), f.cfg[at.C_OMEGA_MAX])


@compiled_part
def absorb(f: at.Filter, k: int, t: float, mean: float, count: float, row: _F) -> None:
    """Take one closed bin of sensor k, whose mean stamp is t, into the filter."""
    if f.sensors[k, at.S_ALIVE] == 0.0:
        gather_start(f, k, t, mean, count)
        ratio_in_force(f.m)
        f.sensors[k, at.S_LAST] = t
        return
    dt = t - f.sensors[k, at.S_LAST]
    advance(f, t)
    noise = f.sensors[k, at.S_NOISE] / count
    innovation = mean - expected(f, k, row)
    S = project(f, k, row) + noise
    if not noise <= S < math.inf:
        # Rounding has eaten the covariance: admit it and start it anew.
        f.counters[at.I_RESETS] += 1
        for i in range(f.x.size):
            scale = max(abs(f.P[i, i]), 1e-30)
            for j in range(f.x.size):
                f.P[i, j] = 0.0
            f.P[i, i] = scale if scale < 1e30 else noise
        S = project(f, k, row) + noise
    surprise = innovation * innovation / S
    verdict = kicked(f, k, innovation, S, dt)
    if verdict == 2:
        return
    if verdict == 3:
        stop_sensor(f, k)
        return
    if verdict == 1:
        handle_kick(f, k, innovation, min(dt, 0.05))
        S = project(f, k, row) + noise
    f.sensors[k, at.S_LAST] = t
    correct(f, innovation, S)
    f.x[at.OMEGA] = min(max(f.x[at.OMEGA], f.cfg[at.C_OMEGA_MIN]), f.cfg[at.C_OMEGA_MAX])
    f.x[at.GROWTH] = min(
        max(f.x[at.GROWTH], -5.0 * f.cfg[at.C_GROWTH_STD]), 5.0 * f.cfg[at.C_GROWTH_STD]
    )
    for number in range(f.slips.shape[0]):
        furthest = 3.0 * f.slips[number, at.P_STD]
        f.x[slip(f, number)] = min(max(f.x[slip(f, number)], -furthest), furthest)
    left = noise * (1.0 - noise / S)
    residual = innovation * noise / S
    tune(f, k, residual, innovation, S, left, row, dt, count, surprise)
    f.sensors[k, at.S_STEP] += 0.02 * (min(dt, 0.1) / count - f.sensors[k, at.S_STEP])
    clean = mean - f.x[at.BIAS + k] - roughness(f, k, row)
    f.sensors[k, at.S_CLEAN_SUM] += count * clean
    f.sensors[k, at.S_CLEAN_COUNT] += count
    learn_ratio(f)
    tie_silent(f, k)
    if f.modes.shape[1] > 1:
        put_in_force(f)  # the shape depends on the amplitude, which has moved


@compiled_part
def close_bin(f: at.Filter, row: _F) -> None:
    """Close the open bin of both sensors and take them in by the order of their stamps."""
    start = f.counters[at.I_BIN] * f.cfg[at.C_BIN]
    first = 0
    if f.sums[0, at.A_COUNT] > 0.0 and f.sums[1, at.A_COUNT] > 0.0:
        lateral, yaw = (
            f.sums[0, at.A_TIME] / f.sums[0, at.A_COUNT],
            f.sums[1, at.A_TIME] / f.sums[1, at.A_COUNT],
        )
        first = 1 if yaw < lateral else 0
    for turn in range(2):
        k = first if turn == 0 else 1 - first
        count = f.sums[k, at.A_COUNT]
        if count == 0.0:
            continue
        late = f.sums[k, at.A_TIME] / count
        spread = max(f.sums[k, at.A_TIME2] / count - late * late, 0.0)
        row[0] = 1.0 - 0.5 * f.x[at.OMEGA] * f.x[at.OMEGA] * spread
        angles = f.sums[k, at.A_ANGLES]
        known = angles == count
        f.sensors[k, at.S_ROLLER] = 1.0 if known else 0.0
        turn_lines(f, f.sums[k, at.A_ANGLE] / count if known else math.nan)
        for j in range(f.lines.shape[0]):
            i, c = line(f, k) + 2 * j, at.A_LINES + 2 * j
            if known and f.sensors[k, at.S_ALIVE] > 0.0 and f.P[i, i] == 0.0:
                f.P[i, i] = f.P[i + 1, i + 1] = 4.0 * f.sensors[k, at.S_BOOT_SQUARE]
            cosine = f.sums[k, c] / count if known else 0.0
            sine = f.sums[k, c + 1] / count if known else 0.0
            if f.lines[j, at.L_SLIP] >= 0.0:
                turned = f.slips[int(f.lines[j, at.L_SLIP]), at.P_TURNED]
                turned *= f.lines[j, at.L_ORDER]
                more, across = math.cos(turned), math.sin(turned)
                cosine, sine = more * cosine - across * sine, more * sine + across * cosine
            row[1 + 2 * j], row[2 + 2 * j] = cosine, sine
        mean = f.sums[k, at.A_VALUE] / count
        if f.sensors[k, at.S_STEP] == 0.0:
            f.sensors[k, at.S_STEP] = 1e-3
        absorb(f, k, start + late, mean, count, row)
        for i in range(f.sums.shape[1]):
            f.sums[k, i] = 0.0


@compiled_part
def measures(counters: _I, sensors: _F, m: _F, cfg: _F, k: int, stamp: int, value: float) -> bool:
    """Tell whether a sample of sensor k is to be used; count it by reason if not."""
    if not abs(value) < 1e100:
        counters[at.I_NOT_FINITE] += 1
        return False
    own = counters[at.I_LAST_LATERAL + k]
    if stamp < counters[at.I_LAST] or stamp <= own or stamp <= counters[at.I_OUTPUT]:
        counters[at.I_BACKWARDS] += 1
        return False
    if counters[at.I_STARTED] == 0:
        counters[at.I_STARTED] = 1
        # A grid that does not depend on where a record starts.
        counters[at.I_ORIGIN] = stamp - stamp % max(round(cfg[at.C_BIN] / cfg[at.C_SECOND]), 1)
        m[at.M_TIME] = (stamp - counters[at.I_ORIGIN]) * cfg[at.C_SECOND]
    t = (stamp - counters[at.I_ORIGIN]) * cfg[at.C_SECOND]
    counters[at.I_LAST] = stamp
    counters[at.I_LAST_LATERAL + k] = stamp
    if value != sensors[k, at.S_VALUE]:
        sensors[k, at.S_VALUE] = value
        sensors[k, at.S_SINCE] = t
    elif t - sensors[k, at.S_SINCE] > cfg[at.C_STUCK]:
        counters[at.I_STUCK] += 1
        return False
    counters[at.I_USED] += 1
    return True


@compiled_part
def accumulate(
    sums: _F,
    k: int,
    late: float,
    value: float,
    angle: float,
    turns: _F,
) -> None:
    """Add a sample, `late` seconds into the bin, to the open bin of sensor k."""
    sums[k, at.A_COUNT] += 1.0
    sums[k, at.A_VALUE] += value
    sums[k, at.A_TIME] += late
    sums[k, at.A_TIME2] += late * late
    if math.isfinite(angle):
        sums[k, at.A_ANGLES] += 1.0
        sums[k, at.A_ANGLE] += angle
        for i in range(turns.size):
            sums[k, at.A_LINES + i] += turns[i]
