"""
The hunting tracker's inner loop: one extended Kalman filter over both sensors.

This module is longer than the house allows because numba's cache on disk follows
the file of the function that is called and not those of the functions it calls:
what is compiled together stands together.

Model (states in the order of the layout below)
-----------------------------------------------
Lateral and yaw signal, k = 0, 1:  v_k = Re z_k + Re w_k + b_k + roughness_k + noise

- z_k hunting phasors, dz/dt = (s + i omega) z: one frequency omega and one growth
  rate s for both, which are states too. What moves one phasor moves the other
  through the complex ratio of the mode shape; the ratio is learnt, or given. So the
  process noise, and the opening of the covariance by a kick, are of rank one along
  (1, ratio), but for the uncertainty of the ratio.
- w_k the second mode, a phasor that decays at a known rate. A kick excites both.
- roughness_k = c1 cos th + s1 sin th + c2 cos 2 th + s2 sin 2 th, th the roller angle.
- b_k bias.

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
- Kicks: two surprising bins running, or a burst of in-band innovation, open the
  covariance of both modes by a multiple of what was seen, before the update. One
  surprising bin alone is a glitch and is left out.

References
----------
Anderson and Moore, Optimal Filtering, 1979, ch. 8 (extended filter), 9.3 (whiteness of
the innovations). Mehra, IEEE Trans. AC 17, 1972 (self-tuning from innovations).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled

# --- state vector -------------------------------------------------------------------
N = 20
Z = 0  # hunting phasors: lateral 0, 1; yaw 2, 3
OMEGA = 4
GROWTH = 5
W = 6  # second mode: lateral 6, 7; yaw 8, 9
BIAS = 10  # lateral 10, yaw 11
ROUGH = 12  # cos, sin, cos 2, sin 2: lateral 12..15, yaw 16..19

# --- configuration vector (see kalman.py) --------------------------------------------
(
    C_BIN,
    C_OMEGA_MIN,
    C_OMEGA_MAX,
    C_OMEGA_STD,
    C_OMEGA_DRIFT,
    C_GROWTH_STD,
    C_GROWTH_DRIFT,
    C_RATIO_STD,
    C_RATIO_FLOOR,
    C_GATE,
    C_NOISE_TIME,
    C_BANDWIDTH_TIME,
    C_STUCK,
    C_GAP,
    N_CONFIG,
) = range(15)

# --- memory common to both sensors ---------------------------------------------------
(
    M_TIME,  # of the filter, s since the origin
    M_LAMBDA,  # ln of the hunting bandwidth, 1/s
    M_RATIO_RE,  # learnt ratio, in units of the one that is given (or absolute)
    M_RATIO_IM,
    M_RATIO_VAR,  # of each part
    M_RHO_RE,  # ratio in force: learnt times given
    M_RHO_IM,
    M_RHO_VAR,
    M_RATIO_TIME,  # when it was last learnt
    M_KICK,  # time of the last kick
    M_CHAIN,  # when the chain of kicks it belongs to began
    M_SPEED,
    M_SPEED_SEEN,  # where the growth rate was last opened for a change of speed
    M_OMEGA0,  # from here, the modes in force
    M_GIVEN_RE,
    M_GIVEN_IM,
    M_OMEGA2,
    M_DECAY2,
    M_RHO2_RE,
    M_RHO2_IM,
    N_MEMORY,
) = range(21)

# --- memory of each sensor ------------------------------------------------------------
(
    S_ALIVE,
    S_NOISE,  # R, variance of one sample
    S_QUICK,  # the same from third differences
    S_STEP,  # mean spacing of samples, s
    S_LAST,  # time of the last bin, s
    S_LAMBDA_ROUGH,
    S_LAMBDA_BIAS,
    S_D1,  # last innovations
    S_D2,
    S_D3,
    S_DOUBT,  # since when bins have been left out
    S_PENDING,  # 1: the last bin was surprising and was left out
    S_NIS,  # recent mean of nu^2/S
    S_RESIDUAL,  # recent mean of the squared residual of a sample
    S_H1_RE,  # innovations demodulated at hunting: first stage, second stage, quick
    S_H1_IM,
    S_H_RE,
    S_H_IM,
    S_K_RE,
    S_K_IM,
    S_R_RE,  # at the roller's frequency
    S_R_IM,
    S_B,  # at zero
    S_CLEAN_SUM,
    S_CLEAN_COUNT,
    S_VALUE,  # last raw value, and since when it has not changed
    S_SINCE,
    S_BOOT,  # bins seen before the start
    S_BOOT_COUNT,  # samples in them
    S_BOOT_START,
    S_BOOT_SUM,
    S_BOOT_SQUARE,
    S_BOOT_DIFF,
    S_BOOT_REF,
    S_ROLLER,  # 1 where the roller angle is known
    N_SENSOR,
) = range(36)

# --- running sums of the bin that is open ----------------------------------------------
A_COUNT, A_VALUE, A_TIME, A_TIME2, A_C1, A_S1, A_C2, A_S2, A_ANGLES, N_ACCUMULATOR = range(10)

# --- counters ----------------------------------------------------------------------------
(
    I_ORIGIN,
    I_BIN,
    I_LAST,
    I_LAST_LATERAL,
    I_LAST_YAW,
    I_OUTPUT,
    I_STARTED,
    I_USED,
    I_NOT_FINITE,
    I_BACKWARDS,
    I_STUCK,
    I_GLITCHES,
    I_KICKS,
    I_RESETS,
    N_COUNTER,
) = range(15)

# --- output columns (see kalman.TRACK_DTYPE) -----------------------------------------------
(
    O_Y,
    O_Y_STD,
    O_Y_RATE,
    O_Y_RATE_STD,
    O_P,
    O_P_STD,
    O_P_RATE,
    O_P_RATE_STD,
    O_PHASE,
    O_PHASE_STD,
    O_FREQUENCY,
    O_FREQUENCY_STD,
    O_GROWTH,
    O_GROWTH_STD,
    O_Y_ROUGH,
    O_Y_ROUGH_STD,
    O_Y_ROUGH2,
    O_P_ROUGH,
    O_P_ROUGH_STD,
    O_P_ROUGH2,
    O_Y_BIAS,
    O_P_BIAS,
    O_Y_RESIDUAL,
    O_P_RESIDUAL,
    O_Y_NIS,
    O_P_NIS,
    O_Y_CLEAN,
    O_P_CLEAN,
    O_Y_NOISE,
    O_P_NOISE,
    O_RATIO,
    O_RATIO_STD,
    O_LAG,
    O_BANDWIDTH,
    O_SECOND,
    O_SINCE_KICK,
    N_OUTPUT,
) = range(37)

KICK_QUICK = 0.08  # s, time constant of the in-band burst detector
IN_BAND = 0.3  # s, of the whiteness measures
BURST = 20.0  # power over that of white noise taken for a kick
ABSURD = 60.0  # standard deviations beyond which a kick must last 20 ms to be believed
SECOND_SHARE = 0.1  # of that, the second mode's, which is of the order of the first
KICK_SCALE = 5.0  # the covariance opens to this multiple of the innovation
REVERSION = 30.0  # s in which frequency and growth rate fall back to the nominal ones
SLIGHT = 0.03  # of the amplitude: a change that needs no opening of the covariance
SETTLING = 0.3  # s after a kick in which nothing is tuned

_F = NDArray[np.float64]
_I = NDArray[np.int64]


class Filter(NamedTuple):
    """All the filter remembers between blocks, its settings, and room to work in."""

    x: _F  # state, shape (N,)
    P: _F  # its covariance, (N, N)
    m: _F  # memory common to both sensors, (N_MEMORY,)
    sensors: _F  # memory of each, (2, N_SENSOR)
    sums: _F  # the bin that is open, (2, N_ACCUMULATOR)
    counters: _I  # (N_COUNTER,)
    cfg: _F  # (N_CONFIG,)
    modes: _F  # TrackerConfig.mode_table(), (n, 8)
    g: _F  # P H' of the update at hand, (N,)


@compiled
def known(f: Filter, first: int) -> float:
    """Share of the power at `first` that is not uncertainty, 0..1."""
    power = f.x[first] ** 2 + f.x[first + 1] ** 2
    doubt = f.P[first, first] + f.P[first + 1, first + 1]
    return float(power / (power + doubt)) if power > 2.0 * doubt else 0.0


@compiled
def predict(f: Filter, dt: float) -> None:
    """Move state and covariance dt seconds on, without process noise: x = f(x), P = F P F'."""
    growth, omega = f.x[GROWTH], f.x[OMEGA]
    scale = math.exp(min(max(growth * dt, -5.0), 5.0))
    c, s = scale * math.cos(omega * dt), scale * math.sin(omega * dt)
    scale2 = math.exp(-f.m[M_DECAY2] * dt)
    c2, s2 = (
        scale2 * math.cos(f.m[M_OMEGA2] * dt),
        scale2 * math.sin(f.m[M_OMEGA2] * dt),
    )
    keep_omega = keep_growth = math.exp(-dt / REVERSION)

    for k in range(2):
        i = Z + 2 * k
        a, b = f.x[i], f.x[i + 1]
        f.x[i], f.x[i + 1] = c * a - s * b, s * a + c * b
        j = W + 2 * k
        a, b = f.x[j], f.x[j + 1]
        f.x[j], f.x[j + 1] = c2 * a - s2 * b, s2 * a + c2 * b
    f.x[OMEGA] = f.m[M_OMEGA0] + keep_omega * (omega - f.m[M_OMEGA0])
    f.x[GROWTH] = keep_growth * growth

    # F P: the rows of everything that moves (all before BIAS).
    # A phasor that is not known yet tells nothing of its frequency and growth.
    lateral = dt * known(f, Z)
    yaw = dt * known(f, Z + 2)
    a0, b0, a1, b1 = (
        f.x[Z] * lateral,
        f.x[Z + 1] * lateral,
        f.x[Z + 2] * yaw,
        f.x[Z + 3] * yaw,
    )
    for j in range(N):
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
    for i in range(BIAS):
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
    for i in range(BIAS):
        for j in range(i + 1, N):
            f.P[j, i] = f.P[i, j]


@compiled
def add_pair(f: Filter, first: int, variance: float, re: float, im: float, spread: float) -> None:
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


@compiled
def density(f: Filter, k: int) -> float:
    """Noise density R dt of sensor k, units^2 s."""
    return float(f.sensors[k, S_NOISE] * f.sensors[k, S_STEP])


@compiled
def lateral_density(f: Filter) -> float:
    """Noise density of both sensors together, referred to the lateral phasor."""
    gain = f.m[M_RHO_RE] ** 2 + f.m[M_RHO_IM] ** 2 + 2.0 * f.m[M_RHO_VAR]
    information = 0.0
    if f.sensors[0, S_ALIVE] > 0.0:
        information += 1.0 / density(f, 0)
        if f.sensors[1, S_ALIVE] > 0.0 and gain > 4.0 * f.m[M_RHO_VAR]:
            information += gain / density(f, 1)
    elif f.sensors[1, S_ALIVE] > 0.0:
        information = gain / density(f, 1)
    return 1.0 / information


@compiled
def diffuse(f: Filter, dt: float) -> None:
    """Add the process noise of dt seconds."""
    q = math.exp(2.0 * f.m[M_LAMBDA]) * lateral_density(f) * dt
    add_pair(f, Z, q, f.m[M_RHO_RE], f.m[M_RHO_IM], f.m[M_RHO_VAR])
    if math.isnan(f.m[M_RHO2_RE]):
        size = f.m[M_RHO_RE] ** 2 + f.m[M_RHO_IM] ** 2 + 2.0 * f.m[M_RHO_VAR]
        add_pair(f, W, q, 0.0, 0.0, 0.5 * size)
    else:
        add_pair(f, W, q, f.m[M_RHO2_RE], f.m[M_RHO2_IM], 0.0)
    # One ratio holds for all amplitudes and speeds only to the floor: let it breathe.
    drift = f.cfg[C_RATIO_FLOOR] ** 2 * dt * 0.5 * (f.x[2] * f.x[2] + f.x[3] * f.x[3])
    f.P[2, 2] += drift
    f.P[3, 3] += drift
    f.P[OMEGA, OMEGA] += f.cfg[C_OMEGA_DRIFT] ** 2 * dt
    # The growth rate changes with the amplitude, and so the quicker the larger it is.
    f.P[GROWTH, GROWTH] += (f.cfg[C_GROWTH_DRIFT] ** 2 + 0.25 * f.x[GROWTH] ** 2) * dt
    for k in range(2):
        if f.sensors[k, S_ALIVE] > 0.0:
            d = density(f, k) * dt
            f.P[BIAS + k, BIAS + k] += math.exp(2.0 * f.sensors[k, S_LAMBDA_BIAS]) * d
            rough = math.exp(2.0 * f.sensors[k, S_LAMBDA_ROUGH]) * d * f.sensors[k, S_ROLLER]
            for i in range(ROUGH + 4 * k, ROUGH + 4 * k + 4):
                f.P[i, i] += rough


@compiled
def open_modes(f: Filter, variance: float) -> None:
    """Open the covariance of both modes after a kick; `variance` in lateral units squared."""
    add_pair(f, Z, variance, f.m[M_RHO_RE], f.m[M_RHO_IM], f.m[M_RHO_VAR])
    if math.isnan(f.m[M_RHO2_RE]):
        size = f.m[M_RHO_RE] ** 2 + f.m[M_RHO_IM] ** 2 + 2.0 * f.m[M_RHO_VAR]
        add_pair(f, W, SECOND_SHARE * variance, 0.0, 0.0, 0.5 * size)
    else:
        add_pair(f, W, SECOND_SHARE * variance, f.m[M_RHO2_RE], f.m[M_RHO2_IM], 0.0)
    # Another amplitude has another growth rate and frequency.
    f.P[GROWTH, GROWTH] = max(f.P[GROWTH, GROWTH], f.cfg[C_GROWTH_STD] ** 2)
    f.P[OMEGA, OMEGA] = max(f.P[OMEGA, OMEGA], (0.1 * f.cfg[C_OMEGA_STD]) ** 2)


@compiled
def project(f: Filter, k: int, row: _F) -> float:
    """Write P H' into g and return H P H', for sensor k with H in `row` (gain, c1, s1, c2, s2)."""
    z, w, b, r = Z + 2 * k, W + 2 * k, BIAS + k, ROUGH + 4 * k
    h, c1, s1, c2, s2 = row[0], row[1], row[2], row[3], row[4]
    for j in range(N):
        f.g[j] = (
            h * f.P[z, j]
            + f.P[w, j]
            + f.P[b, j]
            + c1 * f.P[r, j]
            + s1 * f.P[r + 1, j]
            + c2 * f.P[r + 2, j]
            + s2 * f.P[r + 3, j]
        )
    return float(
        h * f.g[z]
        + f.g[w]
        + f.g[b]
        + c1 * f.g[r]
        + s1 * f.g[r + 1]
        + c2 * f.g[r + 2]
        + s2 * f.g[r + 3]
    )


@compiled
def expected(f: Filter, k: int, row: _F) -> float:
    """Return H x for sensor k."""
    r = ROUGH + 4 * k
    return float(
        row[0] * f.x[Z + 2 * k]
        + f.x[W + 2 * k]
        + f.x[BIAS + k]
        + row[1] * f.x[r]
        + row[2] * f.x[r + 1]
        + row[3] * f.x[r + 2]
        + row[4] * f.x[r + 3]
    )


@compiled
def correct(f: Filter, innovation: float, S: float) -> None:
    """Kalman update with a scalar innovation: g = P H', S = H P H' + R. Scales g."""
    root = 1.0 / math.sqrt(S)
    for i in range(N):
        f.g[i] *= root
        f.x[i] += f.g[i] * root * innovation
    for i in range(N):
        for j in range(N):
            f.P[i, j] -= f.g[i] * f.g[j]  # this order keeps P symmetric to the last bit


@compiled
def start_sensor(f: Filter, k: int, t: float) -> None:
    """Start the states of sensor k from the mean and spread of its first bins."""
    count = f.sensors[k, S_BOOT]
    mean = f.sensors[k, S_BOOT_SUM] / count
    spread = f.sensors[k, S_BOOT_SQUARE] / count - mean * mean
    noise = f.sensors[k, S_BOOT_DIFF] / (20.0 * (count - 3.0))
    noise *= f.sensors[k, S_BOOT_COUNT] / count
    f.sensors[k, S_NOISE] = min(max(noise, 1e-8 * spread), spread)
    f.sensors[k, S_QUICK] = 0.0
    f.sensors[k, S_ALIVE] = 1.0
    f.sensors[k, S_NIS] = 1.0
    f.sensors[k, S_RESIDUAL] = f.sensors[k, S_NOISE]
    f.sensors[k, S_LAMBDA_ROUGH] = 0.0
    f.sensors[k, S_LAMBDA_BIAS] = math.log(0.1)
    roller = f.sensors[k, S_ROLLER]
    for first, width in (
        (Z + 2 * k, 2),
        (W + 2 * k, 2),
        (BIAS + k, 1),
        (ROUGH + 4 * k, 4),
    ):
        for i in range(first, first + width):
            f.x[i] = 0.0
            for j in range(N):
                f.P[i, j] = 0.0
                f.P[j, i] = 0.0
            f.P[i, i] = 4.0 * spread
            if first == ROUGH + 4 * k:
                f.P[i, i] *= roller
    f.x[BIAS + k] = f.sensors[k, S_BOOT_REF] + mean
    if f.sensors[1 - k, S_ALIVE] == 0.0:
        f.m[M_TIME] = t
        f.x[OMEGA] = f.m[M_OMEGA0]
        f.x[GROWTH] = 0.0
        f.P[OMEGA, OMEGA] = f.cfg[C_OMEGA_STD] ** 2
        f.P[GROWTH, GROWTH] = f.cfg[C_GROWTH_STD] ** 2
    elif math.isnan(f.m[M_GIVEN_RE]):
        # The ratio of the phasors is of the order of the ratio of the signals.
        other = 1 - k
        size = (
            f.P[Z + 2 * other, Z + 2 * other]
            + f.x[Z + 2 * other] ** 2
            + f.x[Z + 2 * other + 1] ** 2
        )
        size = max(size, f.sensors[other, S_RESIDUAL], f.sensors[other, S_BOOT_SQUARE])
        f.m[M_RATIO_VAR] = 4.0 * spread / size if k == 1 else size / (4.0 * spread)
        f.m[M_RATIO_RE] = 0.0
        f.m[M_RATIO_IM] = 0.0
    f.sensors[k, S_BOOT_SQUARE] = spread


@compiled
def gather_start(f: Filter, k: int, t: float, mean: float, count: float) -> None:
    """Take one bin of a sensor that has not started yet; start it when there are enough."""
    if f.sensors[k, S_BOOT] == 0.0:
        f.sensors[k, S_BOOT_START] = t
        f.sensors[k, S_BOOT_REF] = mean
    value = mean - f.sensors[k, S_BOOT_REF]
    if f.sensors[k, S_BOOT] >= 3.0:
        third = value - 3.0 * (f.sensors[k, S_D1] - f.sensors[k, S_D2]) - f.sensors[k, S_D3]
        f.sensors[k, S_BOOT_DIFF] += third * third
    f.sensors[k, S_D3] = f.sensors[k, S_D2]
    f.sensors[k, S_D2] = f.sensors[k, S_D1]
    f.sensors[k, S_D1] = value
    f.sensors[k, S_BOOT] += 1.0
    f.sensors[k, S_BOOT_COUNT] += count
    f.sensors[k, S_BOOT_SUM] += value
    f.sensors[k, S_BOOT_SQUARE] += value * value
    enough = f.sensors[k, S_BOOT] >= 12.0 and t - f.sensors[k, S_BOOT_START] >= 0.15
    if enough and f.sensors[k, S_BOOT_DIFF] > 0.0:
        start_sensor(f, k, t)


@compiled
def ratio_in_force(f: Filter) -> None:
    """Combine the ratio that is given for this speed with what was learnt of it."""
    re, im = f.m[M_RATIO_RE], f.m[M_RATIO_IM]
    if math.isnan(f.m[M_GIVEN_RE]):
        f.m[M_RHO_RE], f.m[M_RHO_IM], f.m[M_RHO_VAR] = re, im, f.m[M_RATIO_VAR]
        return
    a, b = f.m[M_GIVEN_RE], f.m[M_GIVEN_IM]
    f.m[M_RHO_RE] = re * a - im * b
    f.m[M_RHO_IM] = re * b + im * a
    f.m[M_RHO_VAR] = f.m[M_RATIO_VAR] * (a * a + b * b)


@compiled
def learn_ratio(f: Filter) -> None:
    """
    Refine the yaw ratio from the two phasors, as a scalar complex Kalman filter.

    The phasors at successive calls share most of their error, so that each counts
    for the fraction of a second that has gone by.
    """
    elapsed = f.m[M_TIME] - f.m[M_RATIO_TIME]
    if elapsed < 0.1 or f.m[M_TIME] - f.m[M_KICK] < SETTLING:
        return
    if f.m[M_TIME] - max(f.sensors[0, S_BOOT_START], f.sensors[1, S_BOOT_START]) < 1.0:
        return  # the start is as rough as a kick
    f.m[M_RATIO_TIME] = f.m[M_TIME]
    a, b, p, q = f.x[0], f.x[1], f.x[2], f.x[3]
    power = a * a + b * b
    if power < 12.5 * (f.P[0, 0] + f.P[1, 1]) or power == 0.0:
        return
    re, im = f.m[M_RHO_RE], f.m[M_RHO_IM]
    size = re * re + im * im
    cross = re * (f.P[0, 2] + f.P[1, 3]) + im * (f.P[0, 3] - f.P[1, 2])
    variance = 0.5 * (f.P[2, 2] + f.P[3, 3] + size * (f.P[0, 0] + f.P[1, 1])) - cross
    seen_re, seen_im = (p * a + q * b) / power, (q * a - p * b) / power
    # No single second is believed to better than a tenth.
    variance = max(variance / power, 0.005 * (seen_re * seen_re + seen_im * seen_im))
    variance /= min(elapsed, 1.0)
    floor = f.cfg[C_RATIO_FLOOR] ** 2 * 0.5 * (seen_re * seen_re + seen_im * seen_im)
    drifted = f.m[M_RHO_VAR] + floor * min(elapsed, 1.0)
    gain = drifted / (drifted + variance + floor)
    re += gain * (seen_re - re)
    im += gain * (seen_im - im)
    left = max((1.0 - gain) * drifted, floor)
    if math.isnan(f.m[M_GIVEN_RE]):
        f.m[M_RATIO_RE], f.m[M_RATIO_IM], f.m[M_RATIO_VAR] = re, im, left
    else:
        g, h = f.m[M_GIVEN_RE], f.m[M_GIVEN_IM]
        norm = g * g + h * h
        f.m[M_RATIO_RE], f.m[M_RATIO_IM] = (
            (re * g + im * h) / norm,
            (im * g - re * h) / norm,
        )
        f.m[M_RATIO_VAR] = left / norm
    ratio_in_force(f)


@compiled
def tune(
    f: Filter,
    k: int,
    residual: float,
    innovation: float,
    S: float,
    left: float,
    row: _F,
    dt: float,
    count: float,
    surprise: float,
) -> None:
    """
    Self-tuning after one bin of sensor k; see the module's docstring.

    `residual` and `left` are v - H x and H P H' after the update, `dt` the time since
    the sensor's last bin, `count` the samples in this one, `surprise`
    its nu^2/S before the covariance was opened.
    """
    dt = min(dt, 0.05)
    noise = f.sensors[k, S_NOISE]
    third = innovation - 3.0 * (f.sensors[k, S_D1] - f.sensors[k, S_D2]) - f.sensors[k, S_D3]
    f.sensors[k, S_D3] = f.sensors[k, S_D2]
    f.sensors[k, S_D2] = f.sensors[k, S_D1]
    f.sensors[k, S_D1] = innovation
    share = 1.0 - math.exp(-dt / 0.5)
    quick = count * third * third / 20.0
    f.sensors[k, S_QUICK] += share * (min(quick, 9.0 * noise) - f.sensors[k, S_QUICK])
    f.sensors[k, S_NIS] += share * (min(surprise, 25.0) - f.sensors[k, S_NIS])
    explained = count * (residual * residual + left)
    f.sensors[k, S_RESIDUAL] += share * (count * residual * residual - f.sensors[k, S_RESIDUAL])
    settled = f.m[M_TIME] - f.m[M_KICK] > SETTLING
    span = min(f.cfg[C_NOISE_TIME], max(0.3 * (f.m[M_TIME] - f.sensors[k, S_BOOT_START]), 0.1))
    if not 0.5 < f.sensors[k, S_NIS] < 2.0:
        span = max(0.25 * span, 0.1)  # far off: be quick
    noise += (1.0 - math.exp(-dt / span)) * (min(explained, 9.0 * noise) - noise)
    f.sensors[k, S_NOISE] = max(
        noise, 0.5 * f.sensors[k, S_QUICK], 1e-12 * f.sensors[k, S_BOOT_SQUARE]
    )

    # Innovations demodulated: u, with E |u|^2 = 1 where they are white.
    unit = innovation / math.sqrt(S)
    decay = math.exp(-dt / IN_BAND)
    turn_c, turn_s = math.cos(f.x[OMEGA] * dt), math.sin(f.x[OMEGA] * dt)
    step = math.sqrt(1.0 - decay * decay)
    # Two stages, so that harmonics of the limit cycle do not leak into the band.
    re, im = f.sensors[k, S_H1_RE], f.sensors[k, S_H1_IM]
    re, im = (
        decay * (turn_c * re - turn_s * im) + unit,
        decay * (turn_s * re + turn_c * im),
    )
    f.sensors[k, S_H1_RE], f.sensors[k, S_H1_IM] = re, im
    old_re, old_im = f.sensors[k, S_H_RE], f.sensors[k, S_H_IM]
    gain = math.sqrt((1.0 - decay * decay) ** 3 / (1.0 + decay * decay))
    f.sensors[k, S_H_RE] = decay * (turn_c * old_re - turn_s * old_im) + gain * re
    f.sensors[k, S_H_IM] = decay * (turn_s * old_re + turn_c * old_im) + gain * im
    f.sensors[k, S_B] = decay * f.sensors[k, S_B] + step * unit
    if row[1] != 0.0 or row[2] != 0.0:
        size = 1.0 / math.sqrt(row[1] * row[1] + row[2] * row[2])
        f.sensors[k, S_R_RE] = decay * f.sensors[k, S_R_RE] + step * unit * row[1] * size
        f.sensors[k, S_R_IM] = decay * f.sensors[k, S_R_IM] + step * unit * row[2] * size
    if not settled:
        return
    rate = 0.5 * dt / f.cfg[C_BANDWIDTH_TIME]
    alive = f.sensors[0, S_ALIVE] + f.sensors[1, S_ALIVE]
    power = f.sensors[k, S_H_RE] ** 2 + f.sensors[k, S_H_IM] ** 2
    f.m[M_LAMBDA] = tuned(f.m[M_LAMBDA], power, rate / alive, 0.2, 100.0)
    power = f.sensors[k, S_B] ** 2
    f.sensors[k, S_LAMBDA_BIAS] = tuned(f.sensors[k, S_LAMBDA_BIAS], power, rate, 0.02, 3.0)
    power = f.sensors[k, S_R_RE] ** 2 + f.sensors[k, S_R_IM] ** 2
    f.sensors[k, S_LAMBDA_ROUGH] = tuned(f.sensors[k, S_LAMBDA_ROUGH], power, rate, 0.05, 5.0)


@compiled
def tuned(log_bandwidth: float, power: float, rate: float, low: float, high: float) -> float:
    """Return the log of a bandwidth moved towards white innovations (mean power 1)."""
    moved = log_bandwidth + rate * (min(power, 8.0) - 1.0)
    return min(max(moved, math.log(low)), math.log(high))


@compiled
def kicked(f: Filter, k: int, innovation: float, S: float, dt: float) -> int:
    """Judge one innovation: 0 ordinary, 1 a kick, 2 leave this bin out for now."""
    decay = math.exp(-min(dt, 0.05) / KICK_QUICK)
    step = math.sqrt(1.0 - decay * decay)
    turn_c, turn_s = math.cos(f.x[OMEGA] * dt), math.sin(f.x[OMEGA] * dt)
    unit = innovation / math.sqrt(S)
    re, im = f.sensors[k, S_K_RE], f.sensors[k, S_K_IM]
    moved_re = decay * (turn_c * re - turn_s * im) + step * unit
    moved_im = decay * (turn_s * re + turn_c * im)
    # What surprises all the time is no surprise: harmonics, a mode that is not modelled.
    usual = max(f.sensors[k, S_NIS], 1.0)
    surprising = unit * unit > f.cfg[C_GATE] ** 2 * usual
    # The further off, the longer it must last: an encoder that wraps is not a kick.
    patience = 0.0 if abs(unit) < ABSURD else 0.02
    recent = f.m[M_TIME] - f.m[M_KICK] < 0.1
    if surprising and not (recent and patience == 0.0):
        if f.sensors[k, S_PENDING] == 0.0:
            f.sensors[k, S_PENDING] = 1.0
            f.sensors[k, S_DOUBT] = f.m[M_TIME]
            return 2
        if f.m[M_TIME] - f.sensors[k, S_DOUBT] < patience:
            return 2
    if not surprising and f.sensors[k, S_PENDING] == 1.0:
        f.counters[I_GLITCHES] += 1
    f.sensors[k, S_PENDING] = 0.0
    f.sensors[k, S_K_RE], f.sensors[k, S_K_IM] = moved_re, moved_im
    burst = moved_re * moved_re + moved_im * moved_im
    # A small part of a large motion may come and go without a kick: lines from its nonlinearity.
    z = Z + 2 * k
    slight = SLIGHT * SLIGHT * (f.x[z] ** 2 + f.x[z + 1] ** 2)
    # Nor may a wrong frequency keep opening the covariance: give it a second to be learnt.
    if burst > BURST * usual and f.m[M_TIME] - f.m[M_KICK] > 1.0:
        return 1 if 2.0 * burst * S * min(dt, 0.05) / KICK_QUICK > slight else 0
    return 1 if surprising else 0


@compiled
def loosen(f: Filter, factor: float) -> None:
    """Doubt the ratio that ties the sensors: its variance grows by a factor, up to its square."""
    size = f.m[M_RATIO_RE] ** 2 + f.m[M_RATIO_IM] ** 2
    if f.m[M_RATIO_VAR] < size:
        f.m[M_RATIO_VAR] *= factor
        ratio_in_force(f)


@compiled
def handle_kick(f: Filter, k: int, innovation: float, dt: float) -> None:
    """Open the covariance after a kick seen by sensor k."""
    size = 1.0
    if k == 1:
        size = f.m[M_RHO_RE] ** 2 + f.m[M_RHO_IM] ** 2 + 2.0 * f.m[M_RHO_VAR]
    burst = f.sensors[k, S_K_RE] ** 2 + f.sensors[k, S_K_IM] ** 2
    scale = innovation * innovation + burst * f.sensors[k, S_NOISE]
    limit = 1e8 * f.sensors[k, S_NOISE]  # what double precision can still resolve
    open_modes(f, min(KICK_SCALE * KICK_SCALE * scale, limit) / size)
    since = f.m[M_TIME] - f.m[M_KICK]
    if since > SETTLING:
        f.counters[I_KICKS] += 1
        f.m[M_CHAIN] = f.m[M_TIME]
    # A kick is over in a quarter of a period. What goes on, or comes again at once, is noise
    # or motion outside the model.
    if f.m[M_TIME] - f.m[M_CHAIN] > 0.2:
        f.sensors[k, S_NOISE] *= math.exp(5.0 * dt)
        loosen(f, 1.1)  # or the two sensors are tied by a wrong ratio
    elif SETTLING < since < 2.0:
        f.sensors[k, S_NOISE] *= 1.25
        f.m[M_LAMBDA] = min(f.m[M_LAMBDA] + 0.2, math.log(100.0))
        loosen(f, 4.0)
        # Or the frequency is wrong, and each beat looks like a kick.
        f.P[OMEGA, OMEGA] = max(f.P[OMEGA, OMEGA], f.cfg[C_OMEGA_STD] ** 2)
    power = f.x[0] * f.x[0] + f.x[1] * f.x[1]
    if scale > 9.0 * power * size:
        # A motion much larger than before: what was learnt from noise is worth little.
        off = f.x[OMEGA] - f.m[M_OMEGA0]
        f.P[OMEGA, OMEGA] = max(f.P[OMEGA, OMEGA], off * off)
        f.x[GROWTH] = min(max(f.x[GROWTH], -f.cfg[C_GROWTH_STD]), f.cfg[C_GROWTH_STD])
    f.m[M_KICK] = f.m[M_TIME]
    for i in range(2):
        f.sensors[i, S_K_RE] = 0.0
        f.sensors[i, S_K_IM] = 0.0


@compiled
def advance(f: Filter, t: float) -> None:
    """Bring the filter to time t, s."""
    dt = t - f.m[M_TIME]
    if dt <= 0.0 or f.sensors[0, S_ALIVE] + f.sensors[1, S_ALIVE] == 0.0:
        return
    f.m[M_TIME] = t
    if dt > f.cfg[C_GAP]:
        lost = 4.0 * (f.x[0] * f.x[0] + f.x[1] * f.x[1] + f.P[0, 0] + f.P[1, 1])
        open_modes(f, lost)
        dt = f.cfg[C_GAP]
    predict(f, dt)
    diffuse(f, dt)
    f.x[OMEGA] = min(max(f.x[OMEGA], f.cfg[C_OMEGA_MIN]), f.cfg[C_OMEGA_MAX])


@compiled
def absorb(f: Filter, k: int, t: float, mean: float, count: float, row: _F) -> None:
    """Take one closed bin of sensor k, whose mean stamp is t, into the filter."""
    if f.sensors[k, S_ALIVE] == 0.0:
        gather_start(f, k, t, mean, count)
        ratio_in_force(f)
        f.sensors[k, S_LAST] = t
        return
    dt = t - f.sensors[k, S_LAST]
    advance(f, t)
    noise = f.sensors[k, S_NOISE] / count
    innovation = mean - expected(f, k, row)
    S = project(f, k, row) + noise
    if not noise <= S < math.inf:
        # Rounding has eaten the covariance: admit it and start it anew.
        f.counters[I_RESETS] += 1
        for i in range(N):
            scale = max(abs(f.P[i, i]), 1e-30)
            for j in range(N):
                f.P[i, j] = 0.0
            f.P[i, i] = scale if scale < 1e30 else noise
        S = project(f, k, row) + noise
    surprise = innovation * innovation / S
    verdict = kicked(f, k, innovation, S, dt)
    if verdict == 2:
        return
    if verdict == 1:
        handle_kick(f, k, innovation, min(dt, 0.05))
        S = project(f, k, row) + noise
    f.sensors[k, S_LAST] = t
    correct(f, innovation, S)
    f.x[OMEGA] = min(max(f.x[OMEGA], f.cfg[C_OMEGA_MIN]), f.cfg[C_OMEGA_MAX])
    f.x[GROWTH] = min(max(f.x[GROWTH], -5.0 * f.cfg[C_GROWTH_STD]), 5.0 * f.cfg[C_GROWTH_STD])
    left = noise * (1.0 - noise / S)
    residual = innovation * noise / S
    tune(f, k, residual, innovation, S, left, row, dt, count, surprise)
    f.sensors[k, S_STEP] += 0.02 * (min(dt, 0.1) / count - f.sensors[k, S_STEP])
    r = ROUGH + 4 * k
    rough = row[1] * f.x[r] + row[2] * f.x[r + 1] + row[3] * f.x[r + 2] + row[4] * f.x[r + 3]
    f.sensors[k, S_CLEAN_SUM] += count * (mean - f.x[BIAS + k] - rough)
    f.sensors[k, S_CLEAN_COUNT] += count
    learn_ratio(f)


@compiled
def close_bin(f: Filter, row: _F) -> None:
    """Close the open bin of both sensors and take them in by the order of their stamps."""
    start = f.counters[I_BIN] * f.cfg[C_BIN]
    first = 0
    if f.sums[0, A_COUNT] > 0.0 and f.sums[1, A_COUNT] > 0.0:
        lateral, yaw = (
            f.sums[0, A_TIME] / f.sums[0, A_COUNT],
            f.sums[1, A_TIME] / f.sums[1, A_COUNT],
        )
        first = 1 if yaw < lateral else 0
    for turn in range(2):
        k = first if turn == 0 else 1 - first
        count = f.sums[k, A_COUNT]
        if count == 0.0:
            continue
        late = f.sums[k, A_TIME] / count
        spread = max(f.sums[k, A_TIME2] / count - late * late, 0.0)
        row[0] = 1.0 - 0.5 * f.x[OMEGA] * f.x[OMEGA] * spread
        angles = f.sums[k, A_ANGLES]
        known = angles == count
        f.sensors[k, S_ROLLER] = 1.0 if known else 0.0
        if known and f.sensors[k, S_ALIVE] > 0.0 and f.P[ROUGH + 4 * k, ROUGH + 4 * k] == 0.0:
            for i in range(ROUGH + 4 * k, ROUGH + 4 * k + 4):
                f.P[i, i] = 4.0 * f.sensors[k, S_BOOT_SQUARE]
        for i in range(4):
            row[1 + i] = f.sums[k, A_C1 + i] / count if known else 0.0
        mean = f.sums[k, A_VALUE] / count
        if f.sensors[k, S_STEP] == 0.0:
            f.sensors[k, S_STEP] = 1e-3
        absorb(f, k, start + late, mean, count, row)
        for i in range(N_ACCUMULATOR):
            f.sums[k, i] = 0.0


@compiled
def look_up(f: Filter, speed: float) -> None:
    """Put the modes at this speed in force, interpolated, held at the ends of the table."""
    f.m[M_SPEED] = speed
    if math.isnan(f.m[M_SPEED_SEEN]):
        f.m[M_SPEED_SEEN] = speed
    change = abs(speed - f.m[M_SPEED_SEEN])
    if change > 0.02 * abs(f.m[M_SPEED_SEEN]):
        # Of the order of d(growth rate)/d(ln speed) on a rig that can lose stability.
        step = 3.0 * f.cfg[C_GROWTH_STD] * min(change / max(abs(speed), 1e-9), 1.0)
        f.P[GROWTH, GROWTH] = min(
            f.P[GROWTH, GROWTH] + step * step, 4.0 * f.cfg[C_GROWTH_STD] ** 2
        )
        f.m[M_SPEED_SEEN] = speed
    last = f.modes.shape[0] - 1
    i = 0
    while i < last - 1 and f.modes[i + 1, 0] <= speed:
        i += 1
    share = 0.0
    j = min(i + 1, last)
    if j > i:
        share = (speed - f.modes[i, 0]) / (f.modes[j, 0] - f.modes[i, 0])
        share = min(max(share, 0.0), 1.0)
    for c in range(7):
        f.m[M_OMEGA0 + c] = f.modes[i, 1 + c] + share * (f.modes[j, 1 + c] - f.modes[i, 1 + c])
    ratio_in_force(f)


@compiled
def radial(f: Filter, first: int) -> float:
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


@compiled
def write_row(f: Filter, row: _F) -> None:
    """Write one row of output from the state as it stands."""
    growth = f.x[GROWTH]
    for k in range(2):
        if f.sensors[k, S_ALIVE] == 0.0:
            continue
        z, r = Z + 2 * k, ROUGH + 4 * k
        amplitude = math.hypot(f.x[z], f.x[z + 1])
        variance = radial(f, z)
        across = 0.0
        if amplitude > 0.0:
            across = (f.x[z] * f.P[z, GROWTH] + f.x[z + 1] * f.P[z + 1, GROWTH]) / amplitude
        rate_variance = (
            amplitude * amplitude * f.P[GROWTH, GROWTH]
            + growth * growth * variance
            + 2.0 * amplitude * growth * across
        )
        o = O_Y if k == 0 else O_P
        row[o] = amplitude
        row[o + 1] = math.sqrt(variance)
        row[o + 2] = growth * amplitude
        row[o + 3] = math.sqrt(max(rate_variance, 0.0))
        if f.sensors[k, S_ROLLER] > 0.0:
            o = O_Y_ROUGH if k == 0 else O_P_ROUGH
            row[o] = math.hypot(f.x[r], f.x[r + 1])
            row[o + 1] = math.sqrt(radial(f, r))
            row[o + 2] = math.hypot(f.x[r + 2], f.x[r + 3])
        row[O_Y_BIAS + k] = f.x[BIAS + k]
        row[O_Y_RESIDUAL + k] = math.sqrt(max(f.sensors[k, S_RESIDUAL], 0.0))
        row[O_Y_NIS + k] = f.sensors[k, S_NIS]
        row[O_Y_NOISE + k] = math.sqrt(f.sensors[k, S_NOISE])
        if f.sensors[k, S_CLEAN_COUNT] > 0.0:
            row[O_Y_CLEAN + k] = f.sensors[k, S_CLEAN_SUM] / f.sensors[k, S_CLEAN_COUNT]
        f.sensors[k, S_CLEAN_SUM] = 0.0
        f.sensors[k, S_CLEAN_COUNT] = 0.0
    lateral, yaw = f.sensors[0, S_ALIVE] > 0.0, f.sensors[1, S_ALIVE] > 0.0
    if not lateral and not yaw:
        return
    z = Z if lateral else Z + 2
    power = f.x[z] ** 2 + f.x[z + 1] ** 2
    row[O_PHASE] = math.atan2(f.x[z + 1], f.x[z])
    if power > 0.0:
        around = (
            f.x[z + 1] ** 2 * f.P[z, z]
            - 2.0 * f.x[z] * f.x[z + 1] * f.P[z, z + 1]
            + f.x[z] ** 2 * f.P[z + 1, z + 1]
        ) / (power * power)
        row[O_PHASE_STD] = min(math.sqrt(max(around, 0.0)), math.pi / math.sqrt(3.0))
    row[O_FREQUENCY] = f.x[OMEGA] / (2.0 * math.pi)
    row[O_FREQUENCY_STD] = math.sqrt(max(f.P[OMEGA, OMEGA], 0.0)) / (2.0 * math.pi)
    row[O_GROWTH] = growth
    row[O_GROWTH_STD] = math.sqrt(max(f.P[GROWTH, GROWTH], 0.0))
    if lateral and yaw:
        size = math.hypot(f.m[M_RHO_RE], f.m[M_RHO_IM])
        row[O_RATIO] = size
        row[O_RATIO_STD] = math.sqrt(f.m[M_RHO_VAR])
        row[O_LAG] = math.atan2(f.m[M_RHO_IM], f.m[M_RHO_RE])
    row[O_BANDWIDTH] = math.exp(f.m[M_LAMBDA])
    row[O_SECOND] = math.hypot(f.x[W], f.x[W + 1])
    row[O_SINCE_KICK] = f.m[M_TIME] - f.m[M_KICK]


@compiled
def track_block(
    f: Filter,
    stamps: _I,
    sensor: NDArray[np.int8],
    values: _F,
    angles: _F,
    speeds: _F,
    outputs: _I,
    rows: _F,
) -> None:
    """
    Run the tracker over a block: samples sorted by stamp, output stamps sorted.

    Everything it remembers is in x, P, m, sensors, sums and counters, so that a block
    split in two gives the same numbers as the whole.
    """
    h = np.zeros(5)
    written = 0
    angle, cosine, sine = math.nan, 0.0, 0.0
    bin_ns = max(round(f.cfg[C_BIN] * 1e9), 1)
    for i in range(stamps.size + 1):
        done = i == stamps.size
        while written < outputs.size and (done or outputs[written] < stamps[i]):
            close_bin(f, h)
            t = (outputs[written] - f.counters[I_ORIGIN]) * 1e-9
            if f.counters[I_STARTED] == 1:
                advance(f, t)
                write_row(f, rows[written])
            f.counters[I_OUTPUT] = outputs[written]
            written += 1
        if done:
            break
        stamp, k, value = stamps[i], int(sensor[i]), values[i]
        if not math.isfinite(value):
            f.counters[I_NOT_FINITE] += 1
            continue
        own = f.counters[I_LAST_LATERAL + k]
        if stamp < f.counters[I_LAST] or stamp <= own or stamp <= f.counters[I_OUTPUT]:
            f.counters[I_BACKWARDS] += 1
            continue
        if f.counters[I_STARTED] == 0:
            f.counters[I_STARTED] = 1
            f.counters[I_ORIGIN] = stamp - stamp % bin_ns
            f.m[M_TIME] = (stamp - f.counters[I_ORIGIN]) * 1e-9
            f.counters[I_BIN] = 0
            look_up(f, speeds[i] if math.isfinite(speeds[i]) else f.modes[0, 0])
        elapsed = stamp - f.counters[I_ORIGIN]
        t = elapsed * 1e-9
        f.counters[I_LAST] = stamp
        f.counters[I_LAST_LATERAL + k] = stamp
        if value != f.sensors[k, S_VALUE]:
            f.sensors[k, S_VALUE] = value
            f.sensors[k, S_SINCE] = t
        elif t - f.sensors[k, S_SINCE] > f.cfg[C_STUCK]:
            f.counters[I_STUCK] += 1
            continue
        place = (elapsed - 1) // bin_ns  # a bin holds its end and not its start
        if place != f.counters[I_BIN] or f.cfg[C_BIN] == 0.0:
            close_bin(f, h)
            f.counters[I_BIN] = place
        if math.isfinite(speeds[i]) and speeds[i] != f.m[M_SPEED]:
            look_up(f, speeds[i])
        f.counters[I_USED] += 1
        late = t - place * f.cfg[C_BIN] if f.cfg[C_BIN] > 0.0 else t
        f.sums[k, A_COUNT] += 1.0
        f.sums[k, A_VALUE] += value
        f.sums[k, A_TIME] += late
        f.sums[k, A_TIME2] += late * late
        if math.isfinite(angles[i]):
            if angles[i] != angle:
                angle = angles[i]
                cosine, sine = math.cos(angle), math.sin(angle)
            f.sums[k, A_ANGLES] += 1.0
            f.sums[k, A_C1] += cosine
            f.sums[k, A_S1] += sine
            f.sums[k, A_C2] += cosine * cosine - sine * sine
            f.sums[k, A_S2] += 2.0 * cosine * sine
