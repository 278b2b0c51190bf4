"""The complex ratio that ties the yaw phasor to the lateral one: given by speed, and learnt."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.algebra import lateral_density, speaks

_F = NDArray[np.float64]

SETTLING = 0.3  # s after a kick in which nothing is tuned
#: A ratio that nobody gave is carried to another speed and amplitude with this doubt, relative:
#: per change of ln(speed), and per change of ln(amplitude) up to the factor e^3. A wheelset's
#: moves by 0.1 of the one and a few hundredths in all over the other (linear theory, full model).
CARRY_SPEED, CARRY_AMPLITUDE = 0.5, 0.02
BIASED = 1.5  # times the relative variance of the lateral phasor
FORCED = 0.3  # relative error of the ratio where all of the motion is made anew in a second
AGAINST = 3.0  # standard deviations at which a ratio that is given is doubted


@compiled_part
def ratio_in_force(m: _F) -> None:
    """Combine the ratio that is given for this speed with what was learnt of it."""
    re, im = m[at.M_RATIO_RE], m[at.M_RATIO_IM]
    if math.isnan(m[at.M_GIVEN_RE]):
        m[at.M_RHO_RE], m[at.M_RHO_IM], m[at.M_RHO_VAR] = (
            re,
            im,
            m[at.M_RATIO_VAR],
        )
        return
    a, b = m[at.M_GIVEN_RE], m[at.M_GIVEN_IM]
    m[at.M_RHO_RE] = re * a - im * b
    m[at.M_RHO_IM] = re * b + im * a
    m[at.M_RHO_VAR] = m[at.M_RATIO_VAR] * (a * a + b * b)


@compiled_part
def learn_ratio(f: at.Filter) -> None:
    """
    Refine the yaw ratio from the two phasors, as a scalar complex Kalman filter.

    The phasors at successive calls share most of their error, so that each counts
    for the fraction of a second that has gone by.
    """
    elapsed = f.m[at.M_TIME] - f.m[at.M_RATIO_TIME]
    if elapsed < 0.1 or f.m[at.M_TIME] - f.m[at.M_KICK] < SETTLING:
        return
    if not (speaks(f.sensors, f.m, 0) and speaks(f.sensors, f.m, 1)):
        return  # one that is silent tells nothing but what the other says
    age = f.m[at.M_TIME] - max(f.sensors[0, at.S_BOOT_START], f.sensors[1, at.S_BOOT_START])
    if age < 1.0:
        return  # the start is as rough as a kick
    f.m[at.M_RATIO_TIME] = f.m[at.M_TIME]
    a, b, p, q = f.x[0], f.x[1], f.x[2], f.x[3]
    power = a * a + b * b
    if power < 12.5 * (f.P[0, 0] + f.P[1, 1]) or power == 0.0:
        return
    re, im = f.m[at.M_RHO_RE], f.m[at.M_RHO_IM]
    size = re * re + im * im
    cross = re * (f.P[0, 2] + f.P[1, 3]) + im * (f.P[0, 3] - f.P[1, 2])
    variance = 0.5 * (f.P[2, 2] + f.P[3, 3] + size * (f.P[0, 0] + f.P[1, 1])) - cross
    seen_re, seen_im = (p * a + q * b) / power, (q * a - p * b) / power
    unit = 0.5 * (seen_re * seen_re + seen_im * seen_im)  # of a relative variance, each part
    # Share of the motion that is made anew each second. What makes it does not push along the
    # mode alone, and what it leaves of the second mode and of other motion is in the phasors.
    renewed = math.exp(2.0 * f.m[at.M_LAMBDA]) * lateral_density(f.sensors, f.m) / power
    renewed = min(max(renewed, math.exp(-0.5 * age)), 1.0)  # nor is it known at first
    # No single second is believed to better than a tenth.
    variance = max(variance / power, (0.01 + FORCED * renewed) * unit) / min(elapsed, 1.0)
    given = not math.isnan(f.m[at.M_GIVEN_RE])
    breath = f.cfg[at.C_RATIO_FLOOR] ** 2 * unit
    # A phasor that stands little above its noise gives a ratio that is biased, by as much as
    # its relative variance: no number of such seconds makes it better.
    biased = (BIASED * (f.P[0, 0] + f.P[1, 1]) / power + FORCED * renewed) ** 2 * unit
    floor = breath + biased
    if given:
        floor += f.m[at.M_GIVEN_STD] ** 2 * unit
        off = (seen_re - re) ** 2 + (seen_im - im) ** 2
        if off > 2.0 * AGAINST**2 * (f.m[at.M_RHO_VAR] + floor + variance):
            loosen(f, 1.5)  # the sensors are not those it was measured with
    if f.m[at.M_RHO_VAR] <= floor and (given or biased > breath):
        return  # it is known better than this
    drifted = f.m[at.M_RHO_VAR] + breath * min(elapsed, 1.0)
    gain = drifted / (drifted + variance + floor)
    if f.m[at.M_RATIO_KNOWN] == 0.0:  # what it was before is no more than its order
        gain, drifted = 1.0, variance + floor
    re += gain * (seen_re - re)
    im += gain * (seen_im - im)
    note_place(f, gain, 0.5 * math.log(power))
    left = drifted if gain == 1.0 else (1.0 - gain) * drifted
    keep_learnt(f, re, im, max(left, floor))
    ratio_in_force(f.m)


@compiled_part
def keep_learnt(f: at.Filter, re: float, im: float, variance: float) -> None:
    """Remember a ratio and the variance of its parts, relative to the one that is given."""
    if math.isnan(f.m[at.M_GIVEN_RE]):
        f.m[at.M_RATIO_RE], f.m[at.M_RATIO_IM], f.m[at.M_RATIO_VAR] = re, im, variance
        return
    g, h = f.m[at.M_GIVEN_RE], f.m[at.M_GIVEN_IM]
    norm = g * g + h * h
    f.m[at.M_RATIO_RE] = (re * g + im * h) / norm
    f.m[at.M_RATIO_IM] = (im * g - re * h) / norm
    f.m[at.M_RATIO_VAR] = variance / norm


@compiled_part
def note_place(f: at.Filter, gain: float, logarithm: float) -> None:
    """Remember at what speed and amplitude the ratio was learnt."""
    if f.m[at.M_RATIO_KNOWN] == 0.0:
        gain = 1.0
        f.m[at.M_RATIO_KNOWN] = 1.0
        f.m[at.M_RATIO_SPEED] = f.m[at.M_SPEED]
        f.m[at.M_RATIO_LOG] = logarithm
    f.m[at.M_RATIO_SPEED] += gain * (f.m[at.M_SPEED] - f.m[at.M_RATIO_SPEED])
    f.m[at.M_RATIO_LOG] += gain * (logarithm - f.m[at.M_RATIO_LOG])


@compiled_part
def carried(f: at.Filter, amplitude: float) -> float:
    """Variance of the ratio in force, relative, of each part, where it is used by itself."""
    size = f.m[at.M_RHO_RE] ** 2 + f.m[at.M_RHO_IM] ** 2
    if size == 0.0:
        return math.inf
    doubt = float(f.m[at.M_RHO_VAR] / size)
    if not math.isnan(f.m[at.M_GIVEN_RE]):
        return float(doubt + f.m[at.M_GIVEN_STD] ** 2)
    speed, learnt = f.m[at.M_SPEED], f.m[at.M_RATIO_SPEED]
    if speed > 0.0 and learnt > 0.0:
        doubt += (CARRY_SPEED * math.log(speed / learnt)) ** 2
    if amplitude > 0.0:
        change = min(abs(math.log(amplitude) - f.m[at.M_RATIO_LOG]), 3.0)
        doubt += (CARRY_AMPLITUDE * change) ** 2
    return doubt


@compiled_part
def tie_silent(f: at.Filter, k: int) -> None:
    """
    Where the other sensor is silent, give it the phasor of sensor k through the ratio.

    Its own last phasor, moved along by what the filter thinks of the coupling, would keep the
    error of the moment it fell silent, and not know of it.
    """
    other = 1 - k
    f.sensors[k, at.S_TIED] = 0.0
    f.sensors[other, at.S_TIED] = 0.0
    if speaks(f.sensors, f.m, other) or f.m[at.M_RATIO_KNOWN] == 0.0:
        return
    re, im = f.m[at.M_RHO_RE], f.m[at.M_RHO_IM]
    size = re * re + im * im
    if not 2.0 * f.m[at.M_RHO_VAR] < size:
        return  # not known to a factor
    if other == 0:
        re, im = re / size, -im / size
    z, o = at.Z + 2 * k, at.Z + 2 * other
    f.x[o], f.x[o + 1] = re * f.x[z] - im * f.x[z + 1], im * f.x[z] + re * f.x[z + 1]
    for j in range(f.x.size):
        a, b = f.P[z, j], f.P[z + 1, j]
        f.P[o, j], f.P[o + 1, j] = re * a - im * b, im * a + re * b
    for j in range(f.x.size):
        a, b = f.P[j, z], f.P[j, z + 1]
        f.P[j, o], f.P[j, o + 1] = re * a - im * b, im * a + re * b
    power = f.x[o] * f.x[o] + f.x[o + 1] * f.x[o + 1]
    lateral = math.sqrt(power if other == 0 else f.x[z] * f.x[z] + f.x[z + 1] * f.x[z + 1])
    doubt = power * carried(f, lateral)
    f.P[o, o] += doubt
    f.P[o + 1, o + 1] += doubt
    f.sensors[other, at.S_TIED] = 1.0


@compiled_part
def loosen(f: at.Filter, factor: float) -> None:
    """Doubt the ratio that ties the sensors: its variance grows by a factor, up to its square."""
    if not (speaks(f.sensors, f.m, 0) and speaks(f.sensors, f.m, 1)):
        return  # what one sensor says by itself is no evidence against it
    size = f.m[at.M_RATIO_RE] ** 2 + f.m[at.M_RATIO_IM] ** 2
    if f.m[at.M_RATIO_VAR] < size:
        f.m[at.M_RATIO_VAR] *= factor
        ratio_in_force(f.m)


@compiled_part
def look_up(f: at.Filter, speed: float) -> None:
    """Put the modes at this speed in force, and doubt the growth rate where it has changed."""
    f.m[at.M_SPEED] = speed
    if math.isnan(f.m[at.M_SPEED_SEEN]):
        f.m[at.M_SPEED_SEEN] = speed
    change = abs(speed - f.m[at.M_SPEED_SEEN])
    if change > 0.02 * abs(f.m[at.M_SPEED_SEEN]):
        # Of the order of d(growth rate)/d(ln speed) on a rig that can lose stability.
        step = 3.0 * f.cfg[at.C_GROWTH_STD] * min(change / max(abs(speed), 1e-9), 1.0)
        f.P[at.GROWTH, at.GROWTH] = min(
            f.P[at.GROWTH, at.GROWTH] + step * step, 4.0 * f.cfg[at.C_GROWTH_STD] ** 2
        )
        f.m[at.M_SPEED_SEEN] = speed
    put_in_force(f)


@compiled_part
def put_in_force(f: at.Filter) -> None:
    """Interpolate the table of modes in speed and amplitude; it is held at its ends."""
    speed = f.m[at.M_SPEED]
    last = f.modes.shape[0] - 1
    i = 0
    while i < last - 1 and f.modes[i + 1, 0, 0] <= speed:
        i += 1
    share = 0.0
    j = min(i + 1, last)
    if j > i:
        share = (speed - f.modes[i, 0, 0]) / (f.modes[j, 0, 0] - f.modes[i, 0, 0])
        share = min(max(share, 0.0), 1.0)
    last = f.modes.shape[1] - 1
    amplitude = lateral_amplitude(f) if last > 0 else 0.0
    p = 0
    while p < last - 1 and f.modes[0, p + 1, 8] <= amplitude:
        p += 1
    part = 0.0
    q = min(p + 1, last)
    if q > p:
        part = (amplitude - f.modes[0, p, 8]) / (f.modes[0, q, 8] - f.modes[0, p, 8])
        part = min(max(part, 0.0), 1.0)
    for c in range(9):
        e = 1 + c if c < 7 else 2 + c
        low = f.modes[i, p, e] + share * (f.modes[j, p, e] - f.modes[i, p, e])
        high = f.modes[i, q, e] + share * (f.modes[j, q, e] - f.modes[i, q, e])
        f.m[at.M_OMEGA0 + c] = low + part * (high - low)
    ratio_in_force(f.m)


@compiled_part
def take_modes(f: at.Filter) -> None:
    """
    Go on with another table of modes.

    The ratio learnt so far and the one that is given now are two measurements of one quantity,
    and are weighed as such. With none in the new table the one in force counts as learnt.
    """
    f.m[at.M_CHANGED] = 0.0
    re, im, variance = f.m[at.M_RHO_RE], f.m[at.M_RHO_IM], f.m[at.M_RHO_VAR]
    known = f.m[at.M_RATIO_KNOWN] > 0.0
    before = not math.isnan(f.m[at.M_GIVEN_RE])
    if before:
        variance += f.m[at.M_GIVEN_STD] ** 2 * (re * re + im * im)
    put_in_force(f)
    if math.isnan(f.m[at.M_GIVEN_RE]):
        if before:
            f.m[at.M_RATIO_KNOWN] = 0.0
            amplitude = lateral_amplitude(f)
            if known and amplitude > 0.0:
                note_place(f, 1.0, math.log(amplitude))
                f.m[at.M_RATIO_RE], f.m[at.M_RATIO_IM] = re, im
            else:
                f.m[at.M_RATIO_RE], f.m[at.M_RATIO_IM], variance = 0.0, 0.0, 1.0
            f.m[at.M_RATIO_VAR] = variance
    else:
        given = f.cfg[at.C_RATIO_STD] ** 2
        f.m[at.M_RATIO_RE], f.m[at.M_RATIO_IM], f.m[at.M_RATIO_VAR] = 1.0, 0.0, given
        if known and not before:
            a, b = f.m[at.M_GIVEN_RE], f.m[at.M_GIVEN_IM]
            size = a * a + b * b
            spread = variance / size + f.m[at.M_GIVEN_STD] ** 2
            share = given / (given + spread)
            f.m[at.M_RATIO_RE] += share * ((re * a + im * b) / size - 1.0)
            f.m[at.M_RATIO_IM] += share * (im * a - re * b) / size
            f.m[at.M_RATIO_VAR] = share * spread
        f.m[at.M_RATIO_KNOWN] = 1.0
    ratio_in_force(f.m)


@compiled_part
def lateral_amplitude(f: at.Filter) -> float:
    """Present amplitude of the lateral phasor, from yaw where lateral has given none."""
    if f.sensors[0, at.S_ALIVE] > 0.0 or f.sensors[0, at.S_TIED] > 0.0:
        return math.hypot(f.x[0], f.x[1])
    size = math.hypot(f.m[at.M_RHO_RE], f.m[at.M_RHO_IM])
    return math.hypot(f.x[2], f.x[3]) / size if size > 0.0 else 0.0
