"""
The hunting tracker's inner loop: an extended Kalman filter over all sensors of the motion.

Its parts: `layout` (what is kept where), `algebra` (prediction and correction), `ratio` (the tie
between the sensors), `hypotheses` (what has happened) and `tuning`; here: from samples to
updates, and the output. They are compiled as one, with `track_block`.

Model (states in the order of the layout below)
-----------------------------------------------
Lateral and yaw signal, k = 0, 1:  v_k = Re z_k + Re w_k + b_k + roughness_k + noise
Acceleration, or another derivative n of such a signal, with s + i omega = v:
                                   Re (1 + e) v^n z_k + Re v_w^n w_k + b + roughness + noise

- z_k hunting phasors of the coordinates, dz/dt = (s + i omega) z: one frequency omega and one
  growth rate s for both, which are states too. What moves one phasor moves the other
  through the complex ratio of the mode shape; the ratio is learnt, or given. So the
  process noise, and the opening of the covariance by a kick, are of rank one along
  (1, ratio), but for the uncertainty of the ratio.
- w_k the second mode, a phasor that decays. A kick excites both. Its frequency and decay are
  guessed, and what they may be off by is process noise (`doubt_second`).
- roughness_k = sum over the known lines of c cos(n th) + s sin(n th), th the roller angle and n
  the order of the line, which need not be a whole number. Where th is not the angle of the
  shaft the line comes from but only near it (a speed that was integrated, a wheel that
  creeps), th turns slower by a factor 1 + slip: the slip is a state of that shaft, a random
  walk within what it may be. Its estimate is added to th; c and s need not turn. Where th is
  not known at all, what the lines add is noise of their power.
- b_k bias, of each sensor; as roughness_k is.
- e error of the scale, of a sensor that is not the first one of its coordinate: by that one the
  amplitude is told, and a calibration that is off by a few per cent must not be taken for another
  frequency.

Averaging before filtering
--------------------------
Samples of one sensor within a bin of a few milliseconds enter as their mean. The
mean of n samples of the model is linear in the same state, with the mean cosines of
the roller angle (exact) and the hunting phasor at the mean stamp times
1 - omega^2 var(t)/2 (to third order in omega t); its noise variance is R/n. So
nothing is lost but motion faster than the bin.

What tunes itself
-----------------
- R, the sensor noise, from the residuals after the update (an EM step), with the
  third difference of the innovations as a floor that follows within half a second.
- The process noise of hunting, roughness and bias, each written as a filter bandwidth
  lambda: q = lambda^2 R dt. If the bandwidth is right the innovations are white
  inside the band, so the innovations demodulated at the hunting frequency, at the
  roller's frequency and at zero have the power of white noise; more says too slow,
  less says too fast.
- What has happened where the innovations surprise (wrong samples, a kick, a step of a
  level): a filter for each says how likely it is, until one is (`hypotheses`).

References
----------
Anderson and Moore, Optimal Filtering, 1979, ch. 8 (extended filter), 9.3 (whiteness of
the innovations). Mehra, IEEE Trans. AC 17, 1972 (self-tuning from innovations).
Willsky and Jones, IEEE Trans. AC 21, 1976 (jumps by a likelihood ratio).
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import F3, I1, R1, compiled, compiled_part
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.algebra import (
    diffuse,
    line,
    newest,
    open_modes,
    predict,
    told,
    turn_lines,
)
from hunt_ros.estimation.tracker.hypotheses import face, judge
from hunt_ros.estimation.tracker.ratio import (
    follow_speed,
    learn_ratio,
    look_up,
    put_in_force,
    ratio_in_force,
    take_modes,
    tie_silent,
)
from hunt_ros.estimation.tracker.tuning import gather_start, stop_sensor
from hunt_ros.records import dtype_of

_F = NDArray[np.float64]

#: One row of output.
ESTIMATE: np.dtype[np.void] = np.dtype((np.record, dtype_of(at.Estimate)))


@compiled_part
def advance(f: at.Filter, t: float) -> None:
    """Bring the filter to time t, s."""
    x, P = f.x, f.P
    dt = t - f.time
    if dt <= 0.0 or max(newest(f, 0), newest(f, 1)) == -math.inf:
        return
    f.time = t
    follow_speed(f, dt)
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
        if t.filters[h].alive:
            advance(t.filters[h], time)


@compiled_part
def take_speed(t: at.Tracker, modes: _F, speed: float) -> None:
    """Put the modes at this speed in force, in all hypotheses; NaN: as before."""
    for h in range(at.HYPOTHESES):
        f = t.filters[h]
        if not t.filters[h].alive:
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
        if not t.filters[h].alive:
            continue
        f = t.filters[h]
        set_lines(t, f, k)
        sensor = f.sensors[k]
        if sensor.alive:
            advance(f, time)
            face(f, k, mean, sensor.noise / count + unknown_lines(f, k))
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
        if t.filters[h].alive and f.sensors[k].last == time:
            learn_ratio(f)
            tie_silent(f, k)
            if modes.shape[1] > 1:
                put_in_force(f, modes)  # the shape depends on the amplitude, which has moved


@compiled_part
def unknown_lines(f: at.Filter, k: int) -> float:
    """Variance of what the lines add to a bin of sensor k where their angle is not known."""
    total, first = 0.0, line(f, k)
    if not f.sensors[k].angle_known:
        for i in range(first, first + 2 * f.line_count):
            total += 0.5 * f.x[i] * f.x[i]
    return total


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
    sensor, sums = f.sensors[k], t.inputs[k].bin
    count = sums.count
    late = sums.time / count
    spread = max(sums.time2 / count - late * late, 0.0)
    f.row.averaged = 1.0 - 0.5 * f.x[at.OMEGA] ** 2 * spread
    known = sums.angles == count
    sensor.angle_known = known
    turn_lines(f, sums.angle / count if known else math.nan)
    first = line(f, k)
    if known and sensor.alive and f.line_count > 0 and f.P[first, first] == 0.0:
        stop_sensor(f, k)  # what was followed so far may have been a line
    for j in range(f.line_count):
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
    """Return True if a sample of sensor k is to be used."""
    own, cfg = t.inputs[k], t.filters[0].cfg
    if not abs(value) < 1e100:
        return False
    if stamp < t.last_stamp or stamp <= own.last_stamp or stamp <= t.last_output:
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
    return bool(time - own.value_since <= cfg.stuck)


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


@compiled_part
def along(P: _F, i: int, a: float, b: float) -> float:
    """Variance of a number of the pair at i, a times the first and b times the second."""
    variance = a * a * P[i, i] + 2.0 * a * b * P[i, i + 1] + b * b * P[i + 1, i + 1]
    return max(float(variance), 0.0)


@compiled_part
def radial(f: at.Filter, first: int) -> float:
    """Variance of the modulus of the phasor at `first`."""
    x, P = f.x, f.P
    power: float = x[first] ** 2 + x[first + 1] ** 2
    if power == 0.0:
        return float(0.5 * (P[first, first] + P[first + 1, first + 1]))
    return along(P, first, x[first], x[first + 1]) / power


@compiled_part
def spread(t: at.Tracker, first: int) -> float:
    """Variance of the modulus of the phasor at `first`, with the doubt what has happened."""
    x = t.filters[t.lead].x
    modulus = math.hypot(x[first], x[first + 1])
    total = weight = 0.0
    for h in range(at.HYPOTHESES):
        f = t.filters[h]
        if not t.filters[h].alive:
            continue
        share = math.exp(t.filters[h].likelihood - t.filters[t.lead].likelihood)
        off = math.hypot(f.x[first], f.x[first + 1]) - modulus
        total += share * (radial(f, first) + off * off)
        weight += share
    return total / weight


@compiled_part
def write_row(t: at.Tracker, row: at.Estimate) -> None:
    """Write one row of output from the state of the likeliest filter as it stands."""
    f = t.filters[t.lead]
    x, P, per_s = f.x, f.P, f.cfg.scale
    growth = x[at.GROWTH]
    for c in range(2):
        if not told(f, c) and not f.coordinates[c].tied:
            continue
        z = at.Z + 2 * c
        amplitude = math.hypot(x[z], x[z + 1])
        motion = row.coordinates[c]
        motion.amplitude = amplitude
        motion.amplitude_std = math.sqrt(spread(t, z))
        motion.amplitude_rate = per_s * growth * amplitude
    for k in range(f.sensor_count):
        if f.sensors[k].alive:
            write_reading(f, k, row.sensors[f.sensors[k].column])
            for h in range(at.HYPOTHESES):
                t.filters[h].sensors[k].clean_sum = 0.0
                t.filters[h].sensors[k].clean_count = 0.0
    lateral, yaw, tied = told(f, 0), told(f, 1), f.coordinates[0].tied
    if not lateral and not yaw:
        return
    row.lateral_tied = tied
    z = at.Z if lateral or tied else at.Z + 2
    power = x[z] ** 2 + x[z + 1] ** 2
    row.phase = math.atan2(x[z + 1], x[z])
    if power > 0.0:
        around = math.sqrt(along(P, z, x[z + 1], -x[z])) / power
        row.phase_std = min(around, math.pi / math.sqrt(3.0))
    row.frequency_hz = per_s * x[at.OMEGA] / (2.0 * math.pi)
    row.frequency_hz_std = per_s * math.sqrt(max(P[at.OMEGA, at.OMEGA], 0.0)) / (2.0 * math.pi)
    row.growth_rate = per_s * growth
    row.growth_rate_std = per_s * math.sqrt(max(P[at.GROWTH, at.GROWTH], 0.0))
    if (yaw or f.coordinates[1].tied) and (lateral or tied):
        row.yaw_ratio = abs(f.rho)
        row.yaw_ratio_std = math.sqrt(f.rho_var)
        row.yaw_lag = math.atan2(f.rho.imag, f.rho.real)
        if not math.isnan(f.mode.rho.real):
            doubt = f.ratio_var + f.mode.rho_std**2 + f.cfg.ratio_std**2
            row.yaw_factor = abs(f.ratio)
            row.yaw_contrary = abs(f.ratio - 1.0) / math.sqrt(doubt)


@compiled_part
def write_reading(f: at.Filter, k: int, reading: at.Reading) -> None:
    """Write what is told of sensor k."""
    x, sensor, r = f.x, f.sensors[k], line(f, k)
    if sensor.angle_known and f.line_count > 0:
        reading.roughness = math.hypot(x[r], x[r + 1])
        reading.roughness_std = math.sqrt(radial(f, r))
        if f.line_count > 1:
            reading.roughness_second = math.hypot(x[r + 2], x[r + 3])
    reading.bias = x[at.BIAS + k]
    if sensor.clean_count > 0.0:
        reading.clean = sensor.clean_sum / sensor.clean_count


@compiled
def track_block(
    t: at.Tracker,
    modes: F3,
    stamps: I1,
    sensor: Annotated[NDArray[np.int8], 1],
    values: R1,
    angles: R1,
    speeds: R1,
    outputs: I1,
    table: Annotated[NDArray[np.void], 1, ESTIMATE],
) -> None:
    """
    Run the tracker over a block: samples sorted by stamp, output stamps sorted.

    All that is remembered is in `t`, so that a block split in two gives the same
    numbers as the whole.
    """
    written = 0
    cfg = t.filters[0].cfg
    bin_ns = max(round(cfg.bin / cfg.second), 1)
    for i in range(stamps.size + 1):
        done = i == stamps.size
        while written < outputs.size and (done or outputs[written] < stamps[i]):
            close_bin(t, modes)
            if t.started:
                advance_all(t, (outputs[written] - t.origin) * cfg.second)
                write_row(t, table[written])
            t.last_output = outputs[written]
            written += 1
        if done:
            break
        k, value = int(sensor[i]), values[i]
        if not measures(t, k, stamps[i], value):
            continue
        elapsed = stamps[i] - t.origin
        place = (elapsed - 1) // bin_ns  # a bin holds its end and not its start
        if place != t.bin_number or cfg.bin == 0.0:
            close_bin(t, modes)
            t.bin_number = place
        take_speed(t, modes, speeds[i])
        accumulate(t, k, elapsed * cfg.second - place * cfg.bin, value, angles[i])
