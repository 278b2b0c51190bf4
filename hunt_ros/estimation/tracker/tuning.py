"""How a sensor starts, and how noise and bandwidths tune themselves."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.algebra import line, open_modes, speaks
from hunt_ros.estimation.tracker.ratio import SETTLING, loosen

_F = NDArray[np.float64]

IN_BAND = 0.3  # s, of the whiteness measures
OFFSET = 25.0  # power of the mean innovation over that of white noise taken for an offset


@compiled_part
def start_sensor(f: at.Filter, k: int, t: float) -> None:
    """Start the states of sensor k from the mean and spread of its first bins."""
    count = f.sensors[k, at.S_BOOT]
    mean = f.sensors[k, at.S_BOOT_SUM] / count
    spread = f.sensors[k, at.S_BOOT_SQUARE] / count - mean * mean
    noise = f.sensors[k, at.S_BOOT_DIFF] / (20.0 * (count - 3.0))
    noise *= f.sensors[k, at.S_BOOT_COUNT] / count
    f.sensors[k, at.S_NOISE] = min(max(noise, 1e-8 * spread), spread)
    f.sensors[k, at.S_QUICK] = 0.0
    f.sensors[k, at.S_ALIVE] = 1.0
    f.sensors[k, at.S_NIS] = 1.0
    f.sensors[k, at.S_RESIDUAL] = f.sensors[k, at.S_NOISE]
    for j in range(f.lines.shape[0]):
        f.rough[k, j, at.R_LAMBDA] = 0.0
    f.sensors[k, at.S_LAMBDA_BIAS] = math.log(0.1)
    roller = f.sensors[k, at.S_ROLLER]
    for first, width in (
        (at.Z + 2 * k, 2),
        (at.W + 2 * k, 2),
        (at.BIAS + k, 1),
        (line(f, k), 2 * f.lines.shape[0]),
    ):
        for i in range(first, first + width):
            f.x[i] = 0.0
            for j in range(f.x.size):
                f.P[i, j] = 0.0
                f.P[j, i] = 0.0
            f.P[i, i] = 4.0 * spread
            if first == line(f, k):
                f.P[i, i] *= roller
    f.x[at.BIAS + k] = f.sensors[k, at.S_BOOT_REF] + mean
    f.sensors[k, at.S_TIED] = 0.0
    if f.sensors[1 - k, at.S_ALIVE] == 0.0:
        f.m[at.M_TIME] = t
        f.x[at.OMEGA] = f.m[at.M_OMEGA0]
        f.x[at.GROWTH] = 0.0
        f.P[at.OMEGA, at.OMEGA] = f.cfg[at.C_OMEGA_STD] ** 2
        f.P[at.GROWTH, at.GROWTH] = f.cfg[at.C_GROWTH_STD] ** 2
    elif f.sensors[k, at.S_BEFORE] > 0.0:
        loosen(f, 4.0)
    elif math.isnan(f.m[at.M_GIVEN_RE]):
        # The ratio of the phasors is of the order of the ratio of the signals.
        other = 1 - k
        size = (
            f.P[at.Z + 2 * other, at.Z + 2 * other]
            + f.x[at.Z + 2 * other] ** 2
            + f.x[at.Z + 2 * other + 1] ** 2
        )
        size = max(size, f.sensors[other, at.S_RESIDUAL], f.sensors[other, at.S_BOOT_SQUARE])
        f.m[at.M_RATIO_VAR] = 4.0 * spread / size if k == 1 else size / (4.0 * spread)
        f.m[at.M_RATIO_RE] = 0.0
        f.m[at.M_RATIO_IM] = 0.0
    f.sensors[k, at.S_BOOT_SQUARE] = spread
    f.sensors[k, at.S_BEFORE] = 1.0


@compiled_part
def forget_start(f: at.Filter, k: int) -> None:
    """Forget the bins gathered for a start of sensor k."""
    for i in range(at.S_BOOT, at.S_BOOT_REF + 1):
        f.sensors[k, i] = 0.0


@compiled_part
def stop_sensor(f: at.Filter, k: int) -> None:
    """Forget the level and noise of sensor k, which now gives another signal: start it anew."""
    f.counters[at.I_RESTARTS] += 1
    forget_start(f, k)
    f.sensors[k, at.S_ALIVE] = 0.0
    f.sensors[k, at.S_PENDING] = 0.0
    for i in range(at.S_H1_RE, at.S_B + 1):
        f.sensors[k, i] = 0.0
    f.rough[k, :, at.R_RE :] = 0.0


@compiled_part
def gather_start(f: at.Filter, k: int, t: float, mean: float, count: float) -> None:
    """Take one bin of a sensor that has not started yet; start it when there are enough."""
    if t - f.sensors[k, at.S_LAST] > 0.1:
        forget_start(f, k)  # what came before a gap may be another signal
    if f.sensors[k, at.S_BOOT] == 0.0:
        f.sensors[k, at.S_BOOT_START] = t
        f.sensors[k, at.S_BOOT_REF] = mean
    value = mean - f.sensors[k, at.S_BOOT_REF]
    if f.sensors[k, at.S_BOOT] >= 3.0:
        third = (
            value - 3.0 * (f.sensors[k, at.S_D1] - f.sensors[k, at.S_D2]) - f.sensors[k, at.S_D3]
        )
        f.sensors[k, at.S_BOOT_DIFF] += third * third
    f.sensors[k, at.S_D3] = f.sensors[k, at.S_D2]
    f.sensors[k, at.S_D2] = f.sensors[k, at.S_D1]
    f.sensors[k, at.S_D1] = value
    f.sensors[k, at.S_BOOT] += 1.0
    f.sensors[k, at.S_BOOT_COUNT] += count
    f.sensors[k, at.S_BOOT_SUM] += value
    f.sensors[k, at.S_BOOT_SQUARE] += value * value
    enough = f.sensors[k, at.S_BOOT] >= 12.0 and t - f.sensors[k, at.S_BOOT_START] >= 0.15
    if enough and f.sensors[k, at.S_BOOT_DIFF] > 0.0:
        start_sensor(f, k, t)


@compiled_part
def tune(
    f: at.Filter,
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
    noise = f.sensors[k, at.S_NOISE]
    third = (
        innovation - 3.0 * (f.sensors[k, at.S_D1] - f.sensors[k, at.S_D2]) - f.sensors[k, at.S_D3]
    )
    f.sensors[k, at.S_D3] = f.sensors[k, at.S_D2]
    f.sensors[k, at.S_D2] = f.sensors[k, at.S_D1]
    f.sensors[k, at.S_D1] = innovation
    share = 1.0 - math.exp(-dt / 0.5)
    quick = count * third * third / 20.0
    f.sensors[k, at.S_QUICK] += share * (min(quick, 9.0 * noise) - f.sensors[k, at.S_QUICK])
    f.sensors[k, at.S_NIS] += share * (min(surprise, 25.0) - f.sensors[k, at.S_NIS])
    explained = count * (residual * residual + left)
    f.sensors[k, at.S_RESIDUAL] += share * (
        count * residual * residual - f.sensors[k, at.S_RESIDUAL]
    )
    settled = f.m[at.M_TIME] - f.m[at.M_KICK] > SETTLING
    span = min(
        f.cfg[at.C_NOISE_TIME],
        max(0.3 * (f.m[at.M_TIME] - f.sensors[k, at.S_BOOT_START]), 0.1),
    )
    if not 0.5 < f.sensors[k, at.S_NIS] < 2.0:
        span = max(0.25 * span, 0.1)  # far off: be quick
    noise += (1.0 - math.exp(-dt / span)) * (min(explained, 9.0 * noise) - noise)
    f.sensors[k, at.S_NOISE] = max(
        noise, 0.5 * f.sensors[k, at.S_QUICK], 1e-12 * f.sensors[k, at.S_BOOT_SQUARE]
    )

    # Innovations demodulated: u, with E |u|^2 = 1 where they are white.
    unit = innovation / math.sqrt(S)
    decay = math.exp(-dt / IN_BAND)
    turn_c, turn_s = math.cos(f.x[at.OMEGA] * dt), math.sin(f.x[at.OMEGA] * dt)
    step = math.sqrt(1.0 - decay * decay)
    # Two stages, so that harmonics of the limit cycle do not leak into the band.
    re, im = f.sensors[k, at.S_H1_RE], f.sensors[k, at.S_H1_IM]
    re, im = (
        decay * (turn_c * re - turn_s * im) + unit,
        decay * (turn_s * re + turn_c * im),
    )
    f.sensors[k, at.S_H1_RE], f.sensors[k, at.S_H1_IM] = re, im
    old_re, old_im = f.sensors[k, at.S_H_RE], f.sensors[k, at.S_H_IM]
    gain = math.sqrt((1.0 - decay * decay) ** 3 / (1.0 + decay * decay))
    f.sensors[k, at.S_H_RE] = decay * (turn_c * old_re - turn_s * old_im) + gain * re
    f.sensors[k, at.S_H_IM] = decay * (turn_s * old_re + turn_c * old_im) + gain * im
    f.sensors[k, at.S_B] = decay * f.sensors[k, at.S_B] + step * unit
    if f.sensors[k, at.S_B] ** 2 > OFFSET * max(f.sensors[k, at.S_NIS], 1.0):
        # The level has stepped, more than the filter of the bias can follow; what looked like
        # a kick a moment ago was that.
        stepped = 10.0 * f.sensors[k, at.S_B] ** 2 * S * dt / (2.0 * IN_BAND)
        recent = f.m[at.M_TIME] - f.m[at.M_KICK] < 2.0
        if recent and f.m[at.M_TIME] - f.m[at.M_STEP] > 5.0:
            f.m[at.M_STEP] = f.m[at.M_TIME]
            size = 1.0
            if k == 1:
                size = f.m[at.M_RHO_RE] ** 2 + f.m[at.M_RHO_IM] ** 2 + 2.0 * f.m[at.M_RHO_VAR]
            stepped = max(stepped, f.m[at.M_KICK_SIZE] * size)
            open_modes(f, f.m[at.M_KICK_SIZE])
        f.P[at.BIAS + k, at.BIAS + k] += stepped
        f.sensors[k, at.S_B] = 0.0
    for j in range(f.lines.shape[0]):
        cosine, sine = row[1 + 2 * j], row[2 + 2 * j]
        if cosine != 0.0 or sine != 0.0:
            size = step * unit / math.sqrt(cosine * cosine + sine * sine)
            f.rough[k, j, at.R_RE] = decay * f.rough[k, j, at.R_RE] + size * cosine
            f.rough[k, j, at.R_IM] = decay * f.rough[k, j, at.R_IM] + size * sine
    if not settled:
        return
    rate = 0.5 * dt / f.cfg[at.C_BANDWIDTH_TIME]
    alive = 2.0 if speaks(f.sensors, f.m, 0) and speaks(f.sensors, f.m, 1) else 1.0
    power = f.sensors[k, at.S_H_RE] ** 2 + f.sensors[k, at.S_H_IM] ** 2
    f.m[at.M_LAMBDA] = tuned(f.m[at.M_LAMBDA], power, rate / alive, 0.2, 100.0)
    power = f.sensors[k, at.S_B] ** 2
    f.sensors[k, at.S_LAMBDA_BIAS] = tuned(f.sensors[k, at.S_LAMBDA_BIAS], power, rate, 0.02, 3.0)
    for j in range(f.lines.shape[0]):
        power = f.rough[k, j, at.R_RE] ** 2 + f.rough[k, j, at.R_IM] ** 2
        f.rough[k, j, at.R_LAMBDA] = tuned(f.rough[k, j, at.R_LAMBDA], power, rate, 0.05, 5.0)


@compiled_part
def tuned(log_bandwidth: float, power: float, rate: float, low: float, high: float) -> float:
    """Return the log of a bandwidth moved towards white innovations (mean power 1)."""
    moved = log_bandwidth + rate * (min(power, 8.0) - 1.0)
    return min(max(moved, math.log(low)), math.log(high))
