"""The complex ratio that ties the yaw phasor to the lateral one: given by speed, and learnt."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.algebra import (
    lateral_density,
    line,
    measured,
    ratio_power,
    told,
    turned,
)

_F = NDArray[np.float64]

#: A ratio that nobody gave is carried to another speed with this doubt, relative, per change of
#: ln(speed). A wheelset's moves by 0.1 of that (linear theory, full model).
CARRY_SPEED = 0.5
BIASED = 1.5  # times the relative variance of the lateral phasor
FORCED = 0.3  # relative error of the ratio where all of the motion is made anew in a second
#: Relative variance of the response to a line per ln(speed): hunting damped by a twentieth of its
#: frequency has the quality 10, and a line that passes it changes as much.
RESONANCE = 10.0
#: The speed has changed where it is off by this part for so long, s: a tachometer that is read
#: often may scatter by a per cent.
CHANGED, LASTING_S = 0.02, 0.05
STEEPEST = 0.1  # relative change of the speed in a bin: what is more is a wrong reading
#: Deviations of the frequency by which it lies inside the range that is followed, or the motion
#: may be another one, that is slower or faster.
DISTINCT = 3.0
AGAINST = 3.0  # standard deviations at which a ratio that is given is doubted


@compiled_part
def squared(z: complex) -> float:
    """Return |z|^2."""
    return z.real * z.real + z.imag * z.imag


@compiled_part
def ratio_in_force(f: at.Filter) -> None:
    """Combine the ratio that is given for this speed with what was learnt of it."""
    f.rho, f.rho_var = f.ratio, f.ratio_var
    if not math.isnan(f.mode.rho.real):
        f.rho *= f.mode.rho
        f.rho_var *= squared(f.mode.rho)


@compiled_part
def learn_ratio(f: at.Filter) -> None:
    """
    Refine the yaw ratio from the two phasors, as a scalar complex Kalman filter.

    The phasors at successive calls share most of their error, so that each counts
    for the fraction of a second that has gone by.
    """
    x, P = f.x, f.P
    elapsed = f.time - f.ratio_time
    if elapsed < 0.1 or f.time - f.kick < at.SETTLING:
        return
    if not (measured(f, 0) and measured(f, 1)):
        return  # one that is silent tells nothing but what the other says
    age = math.inf
    for k in range(f.sensor_count):
        if f.sensors[k].alive:
            age = min(age, f.time - f.sensors[k].boot.start)
    if age < 1.0:
        return  # the start is as rough as a kick
    f.ratio_time = f.time
    lateral, yaw, rho = complex(x[0], x[1]), complex(x[2], x[3]), f.rho
    power = squared(lateral)
    if power < 12.5 * (P[0, 0] + P[1, 1]) or power == 0.0:
        return
    inside = min(x[at.OMEGA] - f.cfg.omega_min, f.cfg.omega_max - x[at.OMEGA])
    if inside < DISTINCT * math.sqrt(max(P[at.OMEGA, at.OMEGA], 0.0)):
        return  # an offset that wanders is followed as the slowest motion that may be
    cross = rho.real * (P[0, 2] + P[1, 3]) + rho.imag * (P[0, 3] - P[1, 2])
    variance = 0.5 * (P[2, 2] + P[3, 3] + squared(rho) * (P[0, 0] + P[1, 1])) - cross
    seen = yaw * lateral.conjugate() / power
    given = not math.isnan(f.mode.rho.real)
    unit = 0.5 * squared(seen)  # of a relative variance, each part
    if not given:  # what is seen may be small by chance: it is no better known than before
        unit = max(unit, 0.5 * ratio_power(f))
    # Share of the motion that is made anew each second. What makes it does not push along the
    # mode alone, and what it leaves of the second mode and of other motion is in the phasors.
    renewed = math.exp(2.0 * f.log_bandwidth) * lateral_density(f) / power
    renewed = min(max(renewed, math.exp(-0.5 * age)), 1.0)  # nor is it known at first
    # No single second is believed to better than a tenth.
    variance = max(variance / power, (0.01 + FORCED * renewed) * unit) / min(elapsed, 1.0)
    breath = at.RATIO_FLOOR**2 * unit
    # A phasor that stands little above its noise gives a ratio that is biased, by as much as
    # its relative variance: no number of such seconds makes it better.
    biased = (BIASED * (P[0, 0] + P[1, 1]) / power + FORCED * renewed) ** 2 * unit
    floor = breath + biased
    if given:
        floor += f.mode.rho_std**2 * unit
        if squared(seen - rho) > 2.0 * AGAINST**2 * (f.rho_var + floor + variance):
            loosen(f, 1.5)  # the sensors are not those it was measured with
    if f.rho_var <= floor and (given or biased > breath):
        return  # it is known better than this
    drifted = f.rho_var + breath * min(elapsed, 1.0)
    gain = drifted / (drifted + variance + floor)
    if not f.ratio_known:  # what it was before is no more than its order
        gain, drifted = 1.0, variance + floor
    f.ratio_known, f.ratio_speed = True, f.speed
    left = drifted if gain == 1.0 else (1.0 - gain) * drifted
    f.ratio, f.ratio_var = rho + gain * (seen - rho), max(left, floor)
    if given:
        f.ratio /= f.mode.rho
        f.ratio_var /= squared(f.mode.rho)
    ratio_in_force(f)


@compiled_part
def tie_silent(f: at.Filter, k: int) -> None:
    """
    Where the other coordinate is not measured, give it the phasor of sensor k through the ratio.

    Its own last phasor, moved along by what the filter thinks of the coupling, would keep the
    error of the moment it fell silent, and not know of it.
    """
    x, P = f.x, f.P
    c = f.sensors[k].coordinate
    other = 1 - c
    f.coordinates[c].tied = False
    f.coordinates[other].tied = False
    if measured(f, other) or not f.ratio_known:
        return
    if not 2.0 * f.rho_var < squared(f.rho):
        return  # not known to a factor
    ratio = 1.0 / f.rho if other == 0 else f.rho
    z, o = at.Z + 2 * c, at.Z + 2 * other
    carry(x, z, o, ratio)
    for j in range(f.states):
        carry(P[:, j], z, o, ratio)
    for j in range(f.states):
        carry(P[j, :], z, o, ratio)
    own = f.mode.rho_std
    if math.isnan(f.mode.rho.real):
        own = at.RATIO_FLOOR
        if f.speed > 0.0 and f.ratio_speed > 0.0:
            own += CARRY_SPEED * abs(math.log(f.speed / f.ratio_speed))
    power = x[o] * x[o] + x[o + 1] * x[o + 1]
    doubt = power * (f.rho_var / squared(f.rho) + own * own)
    P[o, o] += doubt
    P[o + 1, o + 1] += doubt
    f.coordinates[other].tied = True


@compiled_part
def carry(v: _F, first: int, other: int, ratio: complex) -> None:
    """Put the pair at `first` times the ratio at `other`."""
    moved = turned(v, first, ratio)
    v[other], v[other + 1] = moved.real, moved.imag


@compiled_part
def loosen(f: at.Filter, factor: float) -> None:
    """Doubt the ratio that ties the sensors: its variance grows by a factor, up to its square."""
    if not (measured(f, 0) and measured(f, 1)):
        return  # what one sensor says by itself is no evidence against it
    if f.ratio_var < squared(f.ratio):
        f.ratio_var *= factor
        ratio_in_force(f)


@compiled_part
def look_up(f: at.Filter, modes: _F, speed: float) -> None:
    """Put the modes at this speed in force."""
    f.speed = speed
    if math.isnan(f.speed_seen):
        f.speed_seen = speed
    put_in_force(f, modes)


@compiled_part
def follow_speed(f: at.Filter, dt: float) -> None:
    """Doubt growth rate and lines where the speed has changed, and not one reading alone."""
    change = abs(f.speed - f.speed_seen)
    f.speed_off = f.speed_off + dt if change > CHANGED * abs(f.speed_seen) else 0.0
    if f.speed_off > LASTING_S:
        change /= max(abs(f.speed), 1e-9)
        # Of the order of d(growth rate)/d(ln speed) on a rig that can lose stability.
        opened = f.P[at.GROWTH, at.GROWTH] + (3.0 * at.GROWTH_STD * min(change, 1.0)) ** 2
        f.P[at.GROWTH, at.GROWTH] = min(opened, 4.0 * at.GROWTH_STD**2)
        doubt_lines(f, min(change, STEEPEST))
        f.speed_seen, f.speed_off = f.speed, 0.0


@compiled_part
def doubt_lines(f: at.Filter, change: float) -> None:
    """
    Add what a relative change of the speed makes unknown of the lines.

    What the roller does to the wheelset stays the same, the response to it does not: about the
    hunting frequency it is a resonance.
    """
    x, P = f.x, f.P
    for k in range(f.sensor_count):
        for j in range(f.line_count):
            i = line(f, k) + 2 * j
            power = x[i] ** 2 + x[i + 1] ** 2
            P[i, i] += 0.5 * RESONANCE * change * power
            P[i + 1, i + 1] += 0.5 * RESONANCE * change * power


@compiled_part
def between(grid: _F, value: float) -> tuple[int, int, float]:
    """Return the places of a grid around a value, and the share of the second."""
    last = grid.size - 1
    i = 0
    while i < last - 1 and grid[i + 1] <= value:
        i += 1
    j = min(i + 1, last)
    share = (value - grid[i]) / (grid[j] - grid[i]) if j > i else 0.0
    return i, j, min(max(share, 0.0), 1.0)


@compiled_part
def put_in_force(f: at.Filter, modes: _F) -> None:
    """Interpolate the table of modes in speed and amplitude; it is held at its ends."""
    i, j, share = between(modes[:, 0, 0], f.speed)
    p, q, part = between(modes[0, :, 4], lateral_amplitude(f) if modes.shape[1] > 1 else 0.0)
    row = np.empty(modes.shape[2])
    for c in range(row.size):
        low = modes[i, p, c] + share * (modes[j, p, c] - modes[i, p, c])
        high = modes[i, q, c] + share * (modes[j, q, c] - modes[i, q, c])
        row[c] = low + part * (high - low)
    f.mode.omega, f.mode.rho = row[1], complex(row[2], row[3])
    f.mode.rho_std = row[5]
    ratio_in_force(f)


@compiled_part
def take_modes(f: at.Filter, modes: _F) -> None:
    """Go on with another table of modes; where it gives no ratio the one in force is kept."""
    f.modes_changed = False
    rho, variance = f.rho, f.rho_var
    if not math.isnan(f.mode.rho.real):
        variance += f.mode.rho_std**2 * squared(rho)
        f.ratio_speed = f.speed
    put_in_force(f, modes)
    f.ratio, f.ratio_var = rho, variance
    if not math.isnan(f.mode.rho.real):
        f.ratio, f.ratio_var, f.ratio_known = 1.0 + 0j, f.cfg.ratio_std**2, True
    ratio_in_force(f)


@compiled_part
def lateral_amplitude(f: at.Filter) -> float:
    """Present amplitude of the lateral phasor, from yaw where lateral has given none."""
    x = f.x
    if told(f, 0) or f.coordinates[0].tied:
        return math.hypot(x[0], x[1])
    size = abs(f.rho)
    return math.hypot(x[2], x[3]) / size if size > 0.0 else 0.0
