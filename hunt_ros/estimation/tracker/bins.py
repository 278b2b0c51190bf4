"""From samples to updates: the open bin, and what becomes of it when it closes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.algebra import (
    aim,
    correct,
    diffuse,
    expected,
    line,
    open_modes,
    predict,
    project,
    roughness,
    slip,
    started,
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


@compiled_part
def advance(f: at.Filter, t: float) -> None:
    """Bring the filter to time t, s."""
    x, P = f.x, f.P
    dt = t - f.time
    if dt <= 0.0 or not (started(f, 0) or started(f, 1)):
        return
    f.time = t
    if dt > f.cfg.gap:
        lost = 4.0 * (x[0] * x[0] + x[1] * x[1] + P[0, 0] + P[1, 1])
        open_modes(f, lost)
        dt = f.cfg.gap
    predict(f, dt)
    diffuse(f, dt)
    x[at.OMEGA] = min(max(x[at.OMEGA], f.cfg.omega_min), f.cfg.omega_max)


@compiled_part
def absorb(f: at.Filter, modes: _F, k: int, t: float, mean: float, count: float) -> None:
    """Take one closed bin of sensor k, whose mean stamp is t, into the filter."""
    sensor = f.sensors[k]
    x, P = f.x, f.P
    if not sensor.alive:
        gather_start(f, k, t, mean, count)
        ratio_in_force(f)
        sensor.last = t
        return
    dt = t - sensor.last
    advance(f, t)
    noise = sensor.noise / count
    aim(f, k)
    innovation = mean - expected(f, k)
    S = project(f, k) + noise
    if not noise <= S < math.inf:
        # Rounding has eaten the covariance: admit it and start it anew.
        f.resets += 1
        for i in range(f.states):
            scale = max(abs(P[i, i]), 1e-30)
            for j in range(f.states):
                P[i, j] = 0.0
            P[i, i] = scale if scale < 1e30 else noise
        S = project(f, k) + noise
    surprise = innovation * innovation / S
    verdict = kicked(f, k, innovation, S, dt)
    if verdict == 2:
        return
    if verdict == 3:
        stop_sensor(f, k)
        return
    if verdict == 1:
        handle_kick(f, k, innovation, min(dt, 0.05))
        S = project(f, k) + noise
    sensor.last = t
    correct(f, innovation, S)
    x[at.OMEGA] = min(max(x[at.OMEGA], f.cfg.omega_min), f.cfg.omega_max)
    x[at.GROWTH] = min(max(x[at.GROWTH], -5.0 * f.cfg.growth_std), 5.0 * f.cfg.growth_std)
    for number in range(f.slip_count):
        furthest = 3.0 * f.slips[number].deviation
        x[slip(f, number)] = min(max(x[slip(f, number)], -furthest), furthest)
    left = noise * (1.0 - noise / S)
    residual = innovation * noise / S
    tune(f, k, residual, innovation, S, left, dt, count, surprise)
    sensor.spacing += 0.02 * (min(dt, 0.1) / count - sensor.spacing)
    clean = mean - x[at.BIAS + k] - roughness(f, k)
    sensor.clean_sum += count * clean
    sensor.clean_count += count
    learn_ratio(f)
    tie_silent(f, k)
    if modes.shape[1] > 1:
        put_in_force(f, modes)  # the shape depends on the amplitude, which has moved


@compiled_part
def earliest(f: at.Filter) -> int:
    """Return the sensor whose open bin has the earliest mean stamp; -1: none is open."""
    found, soonest = -1, math.inf
    for k in range(f.sensor_count):
        sums = f.sensors[k].bin
        if sums.count > 0.0 and sums.time / sums.count < soonest:
            found, soonest = k, sums.time / sums.count
    return found


@compiled_part
def close_bin(f: at.Filter, modes: _F) -> None:
    """Close the open bin of every sensor and take them in by the order of their stamps."""
    x, P = f.x, f.P
    start = f.bin_number * f.cfg.bin
    while True:
        k = earliest(f)
        if k < 0:
            return
        sensor = f.sensors[k]
        sums = sensor.bin
        count = sums.count
        late = sums.time / count
        spread = max(sums.time2 / count - late * late, 0.0)
        f.row.averaged = 1.0 - 0.5 * x[at.OMEGA] * x[at.OMEGA] * spread
        known = sums.angles == count
        sensor.angle_known = known
        turn_lines(f, sums.angle / count if known else math.nan)
        for j in range(f.line_count):
            i = line(f, k) + 2 * j
            if known and sensor.alive and P[i, i] == 0.0:
                P[i, i] = 4.0 * sensor.boot.square
                P[i + 1, i + 1] = P[i, i]
            cosine = sums.turns[2 * j] / count if known else 0.0
            sine = sums.turns[2 * j + 1] / count if known else 0.0
            if f.lines[j].slip >= 0:
                turned = f.lines[j].order * f.slips[f.lines[j].slip].turned
                more, across = math.cos(turned), math.sin(turned)
                cosine, sine = more * cosine - across * sine, more * sine + across * cosine
            f.row.lines[2 * j], f.row.lines[2 * j + 1] = cosine, sine
        mean = sums.value / count
        if sensor.spacing == 0.0:
            sensor.spacing = 1e-3
        absorb(f, modes, k, start + late, mean, count)
        empty_bin(f, k)


@compiled_part
def measures(f: at.Filter, k: int, stamp: int, value: float) -> bool:
    """Return True if a sample of sensor k is to be used; count it by reason if not."""
    sensor = f.sensors[k]
    if not abs(value) < 1e100:
        f.not_finite += 1
        return False
    own = sensor.last_stamp
    if stamp < f.last_stamp or stamp <= own or stamp <= f.last_output:
        f.backwards += 1
        return False
    if not f.started:
        f.started = True
        # A grid that does not depend on where a record starts.
        f.origin = stamp - stamp % max(round(f.cfg.bin / f.cfg.second), 1)
        f.time = (stamp - f.origin) * f.cfg.second
    t = (stamp - f.origin) * f.cfg.second
    f.last_stamp = stamp
    sensor.last_stamp = stamp
    if value != sensor.value:
        sensor.value = value
        sensor.value_since = t
    elif t - sensor.value_since > f.cfg.stuck:
        f.stuck += 1
        return False
    f.used += 1
    return True


@compiled_part
def accumulate(f: at.Filter, k: int, late: float, value: float, angle: float) -> None:
    """Add a sample, `late` seconds into the bin, to the open bin of sensor k."""
    sums = f.sensors[k].bin
    sums.count += 1.0
    sums.value += value
    sums.time += late
    sums.time2 += late * late
    if not math.isfinite(angle):
        return
    if angle != f.turns_angle:
        f.turns_angle = angle
        for j in range(f.line_count):
            f.turns[2 * j] = math.cos(f.lines[j].order * angle)
            f.turns[2 * j + 1] = math.sin(f.lines[j].order * angle)
    sums.angles += 1.0
    sums.angle += angle
    for i in range(2 * f.line_count):
        sums.turns[i] += f.turns[i]


@compiled_part
def empty_bin(f: at.Filter, k: int) -> None:
    """Begin another bin of sensor k."""
    sums = f.sensors[k].bin
    sums.count = sums.value = sums.time = sums.time2 = sums.angles = sums.angle = 0.0
    sums.turns[:] = 0.0
