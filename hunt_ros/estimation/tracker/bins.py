"""From samples to updates: the open bin, and what becomes of it when it closes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.algebra import (
    diffuse,
    line,
    open_modes,
    predict,
    started,
    turn_lines,
)
from hunt_ros.estimation.tracker.hypotheses import face, judge
from hunt_ros.estimation.tracker.ratio import (
    learn_ratio,
    look_up,
    put_in_force,
    ratio_in_force,
    take_modes,
    tie_silent,
)
from hunt_ros.estimation.tracker.tuning import gather_start

_F = NDArray[np.float64]


@compiled_part
def advance(f: at.Filter, t: float) -> None:
    """Bring the filter to time t, s."""
    x, P = f.x, f.P
    dt = t - f.time
    if dt <= 0.0 or not (started(f, 0) or started(f, 1)):
        return
    f.time = t
    if dt > at.GAP:
        lost = 4.0 * (x[0] * x[0] + x[1] * x[1] + P[0, 0] + P[1, 1])
        open_modes(f, lost)
        dt = at.GAP
    predict(f, dt)
    diffuse(f, dt)
    x[at.OMEGA] = min(max(x[at.OMEGA], f.cfg.omega_min), f.cfg.omega_max)


@compiled_part
def advance_all(t: at.Tracker, time: float) -> None:
    """Bring all hypotheses to a time, s."""
    for h in range(at.HYPOTHESES):
        if t.on_trial[h].alive:
            advance(t.filters[h], time)


@compiled_part
def take_speed(t: at.Tracker, modes: _F, speed: float) -> None:
    """Put the modes at this speed in force, in all hypotheses; NaN: as before."""
    for h in range(at.HYPOTHESES):
        f = t.filters[h]
        if not t.on_trial[h].alive:
            continue
        if f.modes_changed and not math.isnan(f.speed):
            take_modes(f, modes)
        if math.isfinite(speed):
            if speed != f.speed:
                look_up(f, modes, speed)
        elif math.isnan(f.speed):
            look_up(f, modes, modes[0, 0, 0])  # no speed yet: the first of the table
            f.speed_seen = math.nan


@compiled_part
def absorb(t: at.Tracker, modes: _F, k: int, time: float, mean: float) -> None:
    """Take the closed bin of sensor k, whose mean stamp is `time`, into all hypotheses."""
    count, has_started = t.inputs[k].bin.count, True
    for h in range(at.HYPOTHESES):
        if not t.on_trial[h].alive:
            continue
        f = t.filters[h]
        set_lines(t, f, k)
        sensor = f.sensors[k]
        if sensor.alive:
            advance(f, time)
            face(f, k, mean, sensor.noise / count)
            f.surprise = f.innovation * f.innovation / f.variance
        else:
            gather_start(f, k, time, mean, count)
            ratio_in_force(f)
            sensor.last = time
            has_started = False
    if not has_started:
        return
    judge(t, k, mean, count)
    for h in range(at.HYPOTHESES):
        f = t.filters[h]
        if t.on_trial[h].alive and f.sensors[k].last == time:
            learn_ratio(f)
            tie_silent(f, k)
            if modes.shape[1] > 1:
                put_in_force(f, modes)  # the shape depends on the amplitude, which has moved


@compiled_part
def earliest(t: at.Tracker) -> int:
    """Return the sensor whose open bin has the earliest mean stamp; -1: none is open."""
    found, soonest = -1, math.inf
    for k in range(t.filters[0].sensor_count):
        sums = t.inputs[k].bin
        if sums.count > 0.0 and sums.time / sums.count < soonest:
            found, soonest = k, sums.time / sums.count
    return found


@compiled_part
def close_bin(t: at.Tracker, modes: _F) -> None:
    """Close the open bin of every sensor and take them in by the order of their stamps."""
    start = t.bin_number * t.filters[0].cfg.bin
    while True:
        k = earliest(t)
        if k < 0:
            return
        sums = t.inputs[k].bin
        absorb(t, modes, k, start + sums.time / sums.count, sums.value / sums.count)
        empty_bin(t, k)


@compiled_part
def set_lines(t: at.Tracker, f: at.Filter, k: int) -> None:
    """Write into `row` what the means over the open bin of sensor k leave of motion and lines."""
    x, P = f.x, f.P
    sensor, sums = f.sensors[k], t.inputs[k].bin
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
        f.row.value[2 * j], f.row.value[2 * j + 1] = cosine, sine
    if sensor.spacing == 0.0:
        sensor.spacing = 1e-3


@compiled_part
def measures(t: at.Tracker, k: int, stamp: int, value: float) -> bool:
    """Return True if a sample of sensor k is to be used; count it by reason if not."""
    own, cfg = t.inputs[k], t.filters[0].cfg
    if not abs(value) < 1e100:
        t.not_finite += 1
        return False
    if stamp < t.last_stamp or stamp <= own.last_stamp or stamp <= t.last_output:
        t.backwards += 1
        return False
    if not t.started:
        t.started = True
        # A grid that does not depend on where a record starts.
        t.origin = stamp - stamp % max(round(cfg.bin / cfg.second), 1)
        t.filters[0].time = (stamp - t.origin) * cfg.second
    time = (stamp - t.origin) * cfg.second
    t.last_stamp = stamp
    own.last_stamp = stamp
    if value != own.value:
        own.value = value
        own.value_since = time
    elif time - own.value_since > cfg.stuck:
        t.stuck += 1
        return False
    t.used += 1
    return True


@compiled_part
def accumulate(t: at.Tracker, k: int, late: float, value: float, angle: float) -> None:
    """Add a sample, `late` seconds into the bin, to the open bin of sensor k."""
    f, sums = t.filters[0], t.inputs[k].bin
    sums.count += 1.0
    sums.value += value
    sums.time += late
    sums.time2 += late * late
    if not math.isfinite(angle):
        return
    if angle != t.turns_angle:
        t.turns_angle = angle
        for j in range(f.line_count):
            t.turns[2 * j] = math.cos(f.lines[j].order * angle)
            t.turns[2 * j + 1] = math.sin(f.lines[j].order * angle)
    sums.angles += 1.0
    sums.angle += angle
    for i in range(2 * f.line_count):
        sums.turns[i] += t.turns[i]


@compiled_part
def empty_bin(t: at.Tracker, k: int) -> None:
    """Begin another bin of sensor k."""
    sums = t.inputs[k].bin
    sums.count = sums.value = sums.time = sums.time2 = sums.angles = sums.angle = 0.0
    sums.turns[:] = 0.0
