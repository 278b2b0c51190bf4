"""The algebra of the filter: prediction, process noise, projection, correction."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at

_F = NDArray[np.float64]

SECOND_SHARE = 0.1  # of that, the second mode's, which is of the order of the first
REVERSION = 30.0  # s in which frequency and growth rate fall back to the nominal ones


@compiled_part
def line(f: at.Filter, k: int) -> int:
    """Return where the lines of sensor k begin in the state."""
    return at.ROUGH + 2 * k * int(f.lines.shape[0])


@compiled_part
def slip(f: at.Filter, number: int) -> int:
    """Return where a slip is in the state."""
    return at.ROUGH + 4 * int(f.lines.shape[0]) + number


@compiled_part
def known(x: _F, P: _F, first: int) -> float:
    """Share of the power at `first` that is not uncertainty, 0..1."""
    power = x[first] ** 2 + x[first + 1] ** 2
    doubt = P[first, first] + P[first + 1, first + 1]
    return float(power / (power + doubt)) if power > 2.0 * doubt else 0.0


@compiled_part
def predict(f: at.Filter, dt: float) -> None:
    """Move state and covariance dt seconds on, without process noise: x = f(x), P = F P F'."""
    growth, omega = f.x[at.GROWTH], f.x[at.OMEGA]
    scale = math.exp(min(max(growth * dt, -5.0), 5.0))
    c, s = scale * math.cos(omega * dt), scale * math.sin(omega * dt)
    scale2 = math.exp(-f.m[at.M_DECAY2] * dt)
    c2, s2 = (
        scale2 * math.cos(f.m[at.M_OMEGA2] * dt),
        scale2 * math.sin(f.m[at.M_OMEGA2] * dt),
    )
    keep_omega = keep_growth = math.exp(-dt / REVERSION)

    for k in range(2):
        i = at.Z + 2 * k
        a, b = f.x[i], f.x[i + 1]
        f.x[i], f.x[i + 1] = c * a - s * b, s * a + c * b
        j = at.W + 2 * k
        a, b = f.x[j], f.x[j + 1]
        f.x[j], f.x[j + 1] = c2 * a - s2 * b, s2 * a + c2 * b
    f.x[at.OMEGA] = f.m[at.M_OMEGA0] + keep_omega * (omega - f.m[at.M_OMEGA0])
    f.x[at.GROWTH] = keep_growth * growth

    # F P: the rows of everything that moves (all before at.BIAS).
    # A phasor that is not known yet tells nothing of its frequency and growth.
    lateral = dt * known(f.x, f.P, at.Z)
    yaw = dt * known(f.x, f.P, at.Z + 2)
    a0, b0, a1, b1 = (
        f.x[at.Z] * lateral,
        f.x[at.Z + 1] * lateral,
        f.x[at.Z + 2] * yaw,
        f.x[at.Z + 3] * yaw,
    )
    for j in range(f.x.size):
        p0, p1, p2, p3, po, pg = (
            f.P[0, j],
            f.P[1, j],
            f.P[2, j],
            f.P[3, j],
            f.P[4, j],
            f.P[5, j],
        )
        f.P[0, j] = c * p0 - s * p1 - b0 * po + a0 * pg
        f.P[1, j] = s * p0 + c * p1 + a0 * po + b0 * pg
        f.P[2, j] = c * p2 - s * p3 - b1 * po + a1 * pg
        f.P[3, j] = s * p2 + c * p3 + a1 * po + b1 * pg
        f.P[4, j] = keep_omega * po
        f.P[5, j] = keep_growth * pg
        p6, p7, p8, p9 = f.P[6, j], f.P[7, j], f.P[8, j], f.P[9, j]
        f.P[6, j] = c2 * p6 - s2 * p7
        f.P[7, j] = s2 * p6 + c2 * p7
        f.P[8, j] = c2 * p8 - s2 * p9
        f.P[9, j] = s2 * p8 + c2 * p9
    # (F P) F': the same on columns, where rows and columns both move.
    for i in range(at.BIAS):
        p0, p1, p2, p3, po, pg = (
            f.P[i, 0],
            f.P[i, 1],
            f.P[i, 2],
            f.P[i, 3],
            f.P[i, 4],
            f.P[i, 5],
        )
        f.P[i, 0] = c * p0 - s * p1 - b0 * po + a0 * pg
        f.P[i, 1] = s * p0 + c * p1 + a0 * po + b0 * pg
        f.P[i, 2] = c * p2 - s * p3 - b1 * po + a1 * pg
        f.P[i, 3] = s * p2 + c * p3 + a1 * po + b1 * pg
        f.P[i, 4] = keep_omega * po
        f.P[i, 5] = keep_growth * pg
        p6, p7, p8, p9 = f.P[i, 6], f.P[i, 7], f.P[i, 8], f.P[i, 9]
        f.P[i, 6] = c2 * p6 - s2 * p7
        f.P[i, 7] = s2 * p6 + c2 * p7
        f.P[i, 8] = c2 * p8 - s2 * p9
        f.P[i, 9] = s2 * p8 + c2 * p9
    for i in range(at.BIAS):
        for j in range(i + 1, f.x.size):
            f.P[j, i] = f.P[i, j]


@compiled_part
def turn_lines(f: at.Filter, angle: float) -> None:
    """
    Move the lines on to an angle of the roller, rad.

    Where a shaft may turn faster than the angle by the factor 1 + slip, the estimate of the
    slip is added to its angle, and what the slip may be off by turns the phasors of its lines.
    """
    turned = angle - f.m[at.M_ANGLE]
    f.m[at.M_ANGLE] = angle
    if not math.isfinite(turned):
        return
    for number in range(f.slips.shape[0]):
        f.slips[number, at.P_TURNED] += f.x[slip(f, number)] * turned
    for j in range(f.lines.shape[0]):
        if f.lines[j, at.L_SLIP] < 0.0:
            continue
        e = slip(f, int(f.lines[j, at.L_SLIP]))
        for k in range(2):
            i = line(f, k) + 2 * j
            share = f.lines[j, at.L_ORDER] * turned * known(f.x, f.P, i)
            a, b = share * f.x[i + 1], -share * f.x[i]
            if a == 0.0 and b == 0.0:
                continue
            for n in range(f.x.size):
                f.P[i, n] += a * f.P[e, n]
                f.P[i + 1, n] += b * f.P[e, n]
            for n in range(f.x.size):
                f.P[n, i] += a * f.P[n, e]
                f.P[n, i + 1] += b * f.P[n, e]


@compiled_part
def add_pair(
    f: at.Filter, first: int, variance: float, re: float, im: float, spread: float
) -> None:
    """
    Add an isotropic complex jump u at `first` and (re + i im + e) u at `first` + 2.

    `variance` is that of each part of u, `spread` the variance of each part of e.
    """
    other = variance * (re * re + im * im + 2.0 * spread)
    for i in range(2):
        f.P[first + i, first + i] += variance
        f.P[first + 2 + i, first + 2 + i] += other
        f.P[first + i, first + 2 + i] += variance * re
        f.P[first + 2 + i, first + i] += variance * re
    f.P[first, first + 3] += variance * im
    f.P[first + 3, first] += variance * im
    f.P[first + 1, first + 2] -= variance * im
    f.P[first + 2, first + 1] -= variance * im


@compiled_part
def density(sensors: _F, k: int) -> float:
    """Noise density R dt of sensor k, units^2 s."""
    return float(sensors[k, at.S_NOISE] * sensors[k, at.S_STEP])


@compiled_part
def speaks(sensors: _F, m: _F, k: int) -> bool:
    """Tell whether sensor k has started, and has not been silent for a hunting period."""
    silence = m[at.M_TIME] - sensors[k, at.S_LAST]
    return bool(sensors[k, at.S_ALIVE] > 0.0 and silence * m[at.M_OMEGA0] <= 2.0 * math.pi)


@compiled_part
def lateral_density(sensors: _F, m: _F) -> float:
    """Noise density of both sensors together, referred to the lateral phasor."""
    gain = m[at.M_RHO_RE] ** 2 + m[at.M_RHO_IM] ** 2 + 2.0 * m[at.M_RHO_VAR]
    information = 0.0
    lateral, yaw = speaks(sensors, m, 0), speaks(sensors, m, 1)
    if not lateral and not yaw:  # both are silent: as they were
        lateral, yaw = sensors[0, at.S_ALIVE] > 0.0, sensors[1, at.S_ALIVE] > 0.0
    if lateral:
        information += 1.0 / density(sensors, 0)
        if yaw and gain > 4.0 * m[at.M_RHO_VAR]:
            information += gain / density(sensors, 1)
    elif yaw:
        information = gain / density(sensors, 1)
    return 1.0 / information


@compiled_part
def doubt_second(f: at.Filter, dt: float) -> None:
    """
    Add what dt seconds make unknown of a second mode whose eigenvalue is only guessed.

    A wrong eigenvalue, by d = M_STD2 |eigenvalue|, leaves an error that grows by d w a second.
    Spread over the life of the power |w|^2, 1/(2 decay), that is white noise of the density
    |d w|^2/(2 decay). The power counted dies from the last kick on, as the slowest likely
    decay has it, so that what noise makes of the mode does not keep it alive.
    """
    std, decay = f.m[at.M_STD2], f.m[at.M_DECAY2]
    if std == 0.0 or f.m[at.M_LEFT2] + f.m[at.M_LEFT2_YAW] == 0.0:
        return
    omega = f.m[at.M_OMEGA2]
    grown = 0.5 * std * std * (decay * decay + omega * omega) / (2.0 * decay) * dt
    kept = math.exp(-2.0 * (1.0 - std) * decay * dt)
    for k in range(2):
        i = at.W + 2 * k
        power = f.x[i] ** 2 + f.x[i + 1] ** 2 + f.P[i, i] + f.P[i + 1, i + 1]
        power = min(f.m[at.M_LEFT2 + k] * kept, power)
        f.m[at.M_LEFT2 + k] = power
        f.P[i, i] += grown * power
        f.P[i + 1, i + 1] += grown * power


@compiled_part
def diffuse(f: at.Filter, dt: float) -> None:
    """Add the process noise of dt seconds."""
    q = math.exp(2.0 * f.m[at.M_LAMBDA]) * lateral_density(f.sensors, f.m) * dt
    add_pair(f, at.Z, q, f.m[at.M_RHO_RE], f.m[at.M_RHO_IM], f.m[at.M_RHO_VAR])
    if math.isnan(f.m[at.M_RHO2_RE]):
        size = f.m[at.M_RHO_RE] ** 2 + f.m[at.M_RHO_IM] ** 2 + 2.0 * f.m[at.M_RHO_VAR]
        add_pair(f, at.W, q, 0.0, 0.0, 0.5 * size)
    else:
        add_pair(f, at.W, q, f.m[at.M_RHO2_RE], f.m[at.M_RHO2_IM], 0.0)
    doubt_second(f, dt)
    # One ratio holds for all amplitudes and speeds only to the floor: let it breathe.
    drift = f.cfg[at.C_RATIO_FLOOR] ** 2 * dt * 0.5 * (f.x[2] * f.x[2] + f.x[3] * f.x[3])
    f.P[2, 2] += drift
    f.P[3, 3] += drift
    f.P[at.OMEGA, at.OMEGA] += f.cfg[at.C_OMEGA_DRIFT] ** 2 * dt
    # The growth rate changes with the amplitude, and so the quicker the larger it is.
    f.P[at.GROWTH, at.GROWTH] += (f.cfg[at.C_GROWTH_DRIFT] ** 2 + 0.25 * f.x[at.GROWTH] ** 2) * dt
    for k in range(2):
        if f.sensors[k, at.S_ALIVE] > 0.0:
            d = density(f.sensors, k) * dt
            f.P[at.BIAS + k, at.BIAS + k] += math.exp(2.0 * f.sensors[k, at.S_LAMBDA_BIAS]) * d
            for j in range(f.lines.shape[0]):
                walk = math.exp(2.0 * f.rough[k, j, at.R_LAMBDA]) * d * f.sensors[k, at.S_ROLLER]
                i = line(f, k) + 2 * j
                f.P[i, i] += walk
                f.P[i + 1, i + 1] += walk
    for j in range(f.slips.shape[0]):
        i, variance = slip(f, j), f.slips[j, at.P_STD] ** 2
        if f.P[i, i] < variance:
            f.P[i, i] += 2.0 * variance * dt / REVERSION


@compiled_part
def open_modes(f: at.Filter, variance: float) -> None:
    """Open the covariance of both modes after a kick; `variance` in lateral units squared."""
    add_pair(f, at.Z, variance, f.m[at.M_RHO_RE], f.m[at.M_RHO_IM], f.m[at.M_RHO_VAR])
    if math.isnan(f.m[at.M_RHO2_RE]):
        size = f.m[at.M_RHO_RE] ** 2 + f.m[at.M_RHO_IM] ** 2 + 2.0 * f.m[at.M_RHO_VAR]
        add_pair(f, at.W, SECOND_SHARE * variance, 0.0, 0.0, 0.5 * size)
    else:
        add_pair(f, at.W, SECOND_SHARE * variance, f.m[at.M_RHO2_RE], f.m[at.M_RHO2_IM], 0.0)
    f.m[at.M_LEFT2] = f.m[at.M_LEFT2_YAW] = math.inf
    # Another amplitude has another growth rate and frequency.
    f.P[at.GROWTH, at.GROWTH] = max(f.P[at.GROWTH, at.GROWTH], f.cfg[at.C_GROWTH_STD] ** 2)
    f.P[at.OMEGA, at.OMEGA] = max(f.P[at.OMEGA, at.OMEGA], (0.1 * f.cfg[at.C_OMEGA_STD]) ** 2)


@compiled_part
def project(f: at.Filter, k: int, row: _F) -> float:
    """Write P H' into g and return H P H', for sensor k with H in `row` (gain, c1, s1, ...)."""
    z, w, b, r = at.Z + 2 * k, at.W + 2 * k, at.BIAS + k, line(f, k)
    for j in range(f.x.size):
        f.g[j] = row[0] * f.P[z, j] + f.P[w, j] + f.P[b, j]
    for i in range(row.size - 1):
        for j in range(f.x.size):
            f.g[j] += row[1 + i] * f.P[r + i, j]
    variance = row[0] * f.g[z] + f.g[w] + f.g[b]
    for i in range(row.size - 1):
        variance += row[1 + i] * f.g[r + i]
    return float(variance)


@compiled_part
def roughness(f: at.Filter, k: int, row: _F) -> float:
    """Return what the lines are expected to be in the signal of sensor k."""
    total, r = 0.0, line(f, k)
    for i in range(row.size - 1):
        total += row[1 + i] * f.x[r + i]
    return total


@compiled_part
def expected(f: at.Filter, k: int, row: _F) -> float:
    """Return H x for sensor k."""
    modes = row[0] * f.x[at.Z + 2 * k] + f.x[at.W + 2 * k]
    return float(modes + f.x[at.BIAS + k] + roughness(f, k, row))


@compiled_part
def correct(f: at.Filter, innovation: float, S: float) -> None:
    """Kalman update with a scalar innovation: g = P H', S = H P H' + R. Scales g."""
    root = 1.0 / math.sqrt(S)
    for i in range(f.x.size):
        f.g[i] *= root
        f.x[i] += f.g[i] * root * innovation
    for i in range(f.x.size):
        for j in range(f.x.size):
            f.P[i, j] -= f.g[i] * f.g[j]  # this order keeps P symmetric to the last bit
