"""The complex ratio that ties the yaw phasor to the lateral one: given by speed, and learnt."""

from __future__ import annotations

import math

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at

SETTLING = 0.3  # s after a kick in which nothing is tuned


@compiled_part
def ratio_in_force(f: at.Filter) -> None:
    """Combine the ratio that is given for this speed with what was learnt of it."""
    re, im = f.m[at.M_RATIO_RE], f.m[at.M_RATIO_IM]
    if math.isnan(f.m[at.M_GIVEN_RE]):
        f.m[at.M_RHO_RE], f.m[at.M_RHO_IM], f.m[at.M_RHO_VAR] = (
            re,
            im,
            f.m[at.M_RATIO_VAR],
        )
        return
    a, b = f.m[at.M_GIVEN_RE], f.m[at.M_GIVEN_IM]
    f.m[at.M_RHO_RE] = re * a - im * b
    f.m[at.M_RHO_IM] = re * b + im * a
    f.m[at.M_RHO_VAR] = f.m[at.M_RATIO_VAR] * (a * a + b * b)


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
    if f.m[at.M_TIME] - max(f.sensors[0, at.S_BOOT_START], f.sensors[1, at.S_BOOT_START]) < 1.0:
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
    # No single second is believed to better than a tenth.
    variance = max(variance / power, 0.005 * (seen_re * seen_re + seen_im * seen_im))
    variance /= min(elapsed, 1.0)
    floor = f.cfg[at.C_RATIO_FLOOR] ** 2 * 0.5 * (seen_re * seen_re + seen_im * seen_im)
    drifted = f.m[at.M_RHO_VAR] + floor * min(elapsed, 1.0)
    gain = drifted / (drifted + variance + floor)
    re += gain * (seen_re - re)
    im += gain * (seen_im - im)
    left = max((1.0 - gain) * drifted, floor)
    if math.isnan(f.m[at.M_GIVEN_RE]):
        f.m[at.M_RATIO_RE], f.m[at.M_RATIO_IM], f.m[at.M_RATIO_VAR] = re, im, left
    else:
        g, h = f.m[at.M_GIVEN_RE], f.m[at.M_GIVEN_IM]
        norm = g * g + h * h
        f.m[at.M_RATIO_RE], f.m[at.M_RATIO_IM] = (
            (re * g + im * h) / norm,
            (im * g - re * h) / norm,
        )
        f.m[at.M_RATIO_VAR] = left / norm
    ratio_in_force(f)


@compiled_part
def loosen(f: at.Filter, factor: float) -> None:
    """Doubt the ratio that ties the sensors: its variance grows by a factor, up to its square."""
    size = f.m[at.M_RATIO_RE] ** 2 + f.m[at.M_RATIO_IM] ** 2
    if f.m[at.M_RATIO_VAR] < size:
        f.m[at.M_RATIO_VAR] *= factor
        ratio_in_force(f)


@compiled_part
def look_up(f: at.Filter, speed: float) -> None:
    """Put the modes at this speed in force, interpolated, held at the ends of the table."""
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
        f.m[at.M_OMEGA0 + c] = f.modes[i, 1 + c] + share * (f.modes[j, 1 + c] - f.modes[i, 1 + c])
    ratio_in_force(f)
