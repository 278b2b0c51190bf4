"""The algebra of the filter: prediction, process noise, projection, correction."""

from __future__ import annotations

import cmath
import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at

_F = NDArray[np.float64]

#: Eigenvalue of the second mode, 3.3 Hz and a decay of 9.4 1/s (the paper's wheelset; other rigs
#: that can hunt have about the same), and what it may be off by, relative.
SECOND, SECOND_STD = complex(-9.4, 2.0 * math.pi * 3.3), 0.5
SECOND_SHARE = 0.1  # of the variance of a kick, the second mode's
#: s in which frequency and growth rate fall back to the nominal ones; and where the phasor is not
#: known any more, which then tells nothing of either: it may have followed something else.
REVERSION, LOST = 30.0, 3.0
#: Scale of a further sensor of a coordinate against that of the first: prior relative deviation
#: of each part (size, and angle in rad), and s in which it may become another: calibrations and
#: the delays of filters are known to a few per cent, and last.
SCALE_STD, SCALE_TIME = 0.03, 600.0


@compiled_part
def line(f: at.Filter, k: int) -> int:
    """Return where the lines of sensor k begin in the state."""
    return at.BIAS + f.sensor_count + 2 * k * f.line_count


@compiled_part
def slip(f: at.Filter, number: int) -> int:
    """Return where a slip is in the state."""
    return f.states - f.slip_count + number


@compiled_part
def known(f: at.Filter, first: int) -> float:
    """Share of the power at `first` that is not uncertainty, 0..1."""
    x, P = f.x, f.P
    power = x[first] ** 2 + x[first + 1] ** 2
    doubt = P[first, first] + P[first + 1, first + 1]
    return float(power / (power + doubt)) if power > 2.0 * doubt else 0.0


@compiled_part
def turned(v: _F, i: int, turn: complex) -> complex:
    """Return the pair of numbers at i, as one complex, times another."""
    return turn * complex(v[i], v[i + 1])


@compiled_part
def reversion(f: at.Filter) -> float:
    """Return the time, s, in which frequency and growth rate fall back."""
    return REVERSION if known(f, at.Z) + known(f, at.Z + 2) > 0.0 else LOST


@compiled_part
def predict(f: at.Filter, dt: float) -> None:
    """Move state and covariance dt seconds on, without process noise: x = f(x), P = F P F'."""
    x, P = f.x, f.P
    growth, omega = x[at.GROWTH], x[at.OMEGA]
    first = cmath.exp(complex(min(max(growth * dt, -5.0), 5.0), omega * dt))
    second = cmath.exp(SECOND * dt)
    keep = math.exp(-dt / reversion(f))
    for k in range(2):
        z, w = at.Z + 2 * k, at.W + 2 * k
        moved, fast = turned(x, z, first), turned(x, w, second)
        x[z], x[z + 1], x[w], x[w + 1] = moved.real, moved.imag, fast.real, fast.imag
    x[at.OMEGA] = f.mode.omega + keep * (omega - f.mode.omega)
    x[at.GROWTH] = keep * growth
    # A phasor that is not known yet tells nothing of its frequency and growth.
    shares = (dt * known(f, at.Z), dt * known(f, at.Z + 2))
    # The rows of everything that moves (all before at.BIAS), F P; then the same on columns.
    for j in range(f.states):
        predict_column(x, P[:, j], first, second, keep, shares)
    for i in range(at.BIAS):
        predict_column(x, P[i, :], first, second, keep, shares)
    for i in range(at.BIAS):
        for j in range(i + 1, f.states):
            P[j, i] = P[i, j]


@compiled_part
def predict_column(
    x: _F, p: _F, first: complex, second: complex, keep: float, shares: tuple[float, float]
) -> None:
    """Multiply a column by the Jacobian F of the prediction."""
    bend = complex(p[at.GROWTH], p[at.OMEGA])
    for k in range(2):
        z, w = at.Z + 2 * k, at.W + 2 * k
        moved = turned(p, z, first) + shares[k] * turned(x, z, bend)
        fast = turned(p, w, second)
        p[z], p[z + 1], p[w], p[w + 1] = moved.real, moved.imag, fast.real, fast.imag
    p[at.OMEGA] *= keep
    p[at.GROWTH] *= keep


@compiled_part
def turn_lines(f: at.Filter, angle: float) -> None:
    """
    Move the lines on to an angle of the roller, rad.

    Where a shaft may turn faster than the angle by the factor 1 + slip, the estimate of the
    slip is added to its angle, and what the slip may be off by turns the phasors of its lines.
    """
    x, P = f.x, f.P
    turned = angle - f.angle
    f.angle = angle
    if not math.isfinite(turned):
        return
    for number in range(f.slip_count):
        f.slips[number].turned += x[slip(f, number)] * turned
    for j in range(f.line_count):
        if f.lines[j].slip < 0:
            continue
        e = slip(f, f.lines[j].slip)
        for k in range(f.sensor_count):
            i = line(f, k) + 2 * j
            share = f.lines[j].order * turned * known(f, i)
            a, b = share * x[i + 1], -share * x[i]
            if a == 0.0 and b == 0.0:
                continue
            for n in range(f.states):
                P[i, n] += a * P[e, n]
                P[i + 1, n] += b * P[e, n]
            for n in range(f.states):
                P[n, i] += a * P[n, e]
                P[n, i + 1] += b * P[n, e]


@compiled_part
def add_pair(f: at.Filter, first: int, variance: float, ratio: complex, spread: float) -> None:
    """
    Add an isotropic complex jump u at `first` and (ratio + e) u at `first` + 2.

    `variance` is that of each part of u, `spread` the variance of each part of e.
    """
    P = f.P
    re, im = variance * ratio.real, variance * ratio.imag
    other = variance * (ratio.real**2 + ratio.imag**2 + 2.0 * spread)
    for i in range(2):
        P[first + i, first + i] += variance
        P[first + 2 + i, first + 2 + i] += other
        P[first + i, first + 2 + i] += re
        P[first + 2 + i, first + i] += re
    P[first, first + 3] += im
    P[first + 3, first] += im
    P[first + 1, first + 2] -= im
    P[first + 2, first + 1] -= im


@compiled_part
def add_modes(f: at.Filter, variance: float, share: float) -> None:
    """Add a jump of the lateral phasor to both modes; `share` of the variance to the second."""
    add_pair(f, at.Z, variance, f.rho, f.rho_var)
    add_pair(f, at.W, share * variance, 0j, 0.5 * ratio_power(f))


@compiled_part
def ratio_power(f: at.Filter) -> float:
    """Expected square of the ratio of yaw to lateral."""
    return f.rho.real**2 + f.rho.imag**2 + 2.0 * f.rho_var


@compiled_part
def density(f: at.Filter, k: int) -> float:
    """Noise density R dt of sensor k, units^2 s."""
    sensor = f.sensors[k]
    return sensor.noise * sensor.spacing


@compiled_part
def speaks(f: at.Filter, k: int) -> bool:
    """Return True if sensor k has started, and was not silent for a hunting period."""
    sensor = f.sensors[k]
    silence = f.time - sensor.last
    return sensor.alive and silence * f.mode.omega <= 2.0 * math.pi


@compiled_part
def newest(f: at.Filter, coordinate: int) -> float:
    """Return when a sensor of the coordinate has spoken last; minus infinity: none has started."""
    last = -math.inf
    for k in range(f.sensor_count):
        if f.sensors[k].coordinate == coordinate and f.sensors[k].alive:
            last = max(last, f.sensors[k].last)
    return last


@compiled_part
def measured(f: at.Filter, coordinate: int) -> bool:
    """Return True if a sensor of the coordinate was not silent for a hunting period."""
    return (f.time - newest(f, coordinate)) * f.mode.omega <= 2.0 * math.pi


@compiled_part
def told(f: at.Filter, coordinate: int) -> bool:
    """
    Return True if sensors tell the coordinate, or did so till all fell silent.

    What fell silent a hunting period before the other coordinate, or more, is of the past.
    """
    own, other = newest(f, coordinate), newest(f, 1 - coordinate)
    return own > -math.inf and (other - own) * f.mode.omega <= 2.0 * math.pi


@compiled_part
def magnified(f: at.Filter, k: int) -> float:
    """Power of the hunting in the signal of sensor k over that of its coordinate."""
    sensor = f.sensors[k]
    power = sensor.unit * sensor.unit
    for _ in range(2 * sensor.derivative):
        power *= f.x[at.OMEGA]
    return power


@compiled_part
def seen_of_lateral(f: at.Filter, k: int) -> float:
    """Power of the hunting in the signal of sensor k over that of the lateral motion."""
    power = magnified(f, k)
    if f.sensors[k].coordinate == 1:
        power *= ratio_power(f)
    return power


@compiled_part
def lateral_density(f: at.Filter) -> float:
    """Noise density of all sensors together, referred to the lateral phasor."""
    gain = ratio_power(f)
    lateral, yaw = measured(f, 0), measured(f, 1)
    silent = not lateral and not yaw  # all are: as they were
    if silent:
        lateral = newest(f, 0) > -math.inf
    information = 0.0
    for k in range(f.sensor_count):
        sensor = f.sensors[k]
        if not (sensor.alive if silent else speaks(f, k)):
            continue
        # A ratio that is not known to a factor tells nothing of the lateral phasor.
        if sensor.coordinate == 0 or not lateral or gain > 4.0 * f.rho_var:
            information += seen_of_lateral(f, k) / density(f, k)
    return 1.0 / information


@compiled_part
def doubt_second(f: at.Filter, dt: float) -> None:
    """
    Add what dt seconds make unknown of the second mode, whose eigenvalue is only guessed.

    A wrong eigenvalue, by d = SECOND_STD |SECOND|, leaves an error that grows by d w a second.
    Spread over the life of the power |w|^2, 1/(2 decay), that is white noise of the density
    |d w|^2/(2 decay). The power counted dies from the last kick on, as the slowest likely
    decay has it, so that what noise makes of the mode does not keep it alive.
    """
    x, P = f.x, f.P
    if f.coordinates[0].second_left + f.coordinates[1].second_left == 0.0:
        return
    grown = 0.5 * (SECOND_STD * abs(SECOND)) ** 2 / (-2.0 * SECOND.real) * dt
    kept = math.exp(2.0 * (1.0 - SECOND_STD) * SECOND.real * dt)
    for c in range(2):
        i = at.W + 2 * c
        power = x[i] ** 2 + x[i + 1] ** 2 + P[i, i] + P[i + 1, i + 1]
        power = min(f.coordinates[c].second_left * kept, power)
        f.coordinates[c].second_left = power
        P[i, i] += grown * power
        P[i + 1, i + 1] += grown * power


@compiled_part
def diffuse(f: at.Filter, dt: float) -> None:
    """Add the process noise of dt seconds."""
    x, P = f.x, f.P
    q = math.exp(2.0 * f.log_bandwidth) * lateral_density(f) * dt
    add_modes(f, q, 1.0)
    doubt_second(f, dt)
    # Process noise on the ratio: it varies with amplitude and speed.
    drift = at.RATIO_FLOOR**2 * dt * 0.5 * (x[2] * x[2] + x[3] * x[3])
    P[2, 2] += drift
    P[3, 3] += drift
    renewed = REVERSION / reversion(f) * dt  # the deviation in the long run is the same
    P[at.OMEGA, at.OMEGA] += at.OMEGA_DRIFT**2 * renewed
    # The growth rate changes with the amplitude, and so the quicker the larger it is.
    P[at.GROWTH, at.GROWTH] += at.GROWTH_DRIFT**2 * renewed + 0.25 * x[at.GROWTH] ** 2 * dt
    for k in range(f.sensor_count):
        sensor = f.sensors[k]
        if sensor.alive:
            d = density(f, k) * dt
            P[at.BIAS + k, at.BIAS + k] += math.exp(2.0 * sensor.log_bias_bandwidth) * d
            for j in range(f.line_count):
                walk = math.exp(2.0 * sensor.lines[j].log_bandwidth) * d * sensor.angle_known
                i = line(f, k) + 2 * j
                P[i, i] += walk
                P[i + 1, i + 1] += walk
            if sensor.scale >= 0:
                for i in range(sensor.scale, sensor.scale + 2):
                    if P[i, i] < SCALE_STD**2:
                        P[i, i] += 2.0 * SCALE_STD**2 * dt / SCALE_TIME
    for j in range(f.slip_count):
        i, variance = slip(f, j), f.slips[j].deviation ** 2
        if P[i, i] < variance:
            P[i, i] += 2.0 * variance * dt / REVERSION


@compiled_part
def open_modes(f: at.Filter, variance: float) -> None:
    """Open the covariance of both modes after a kick; `variance` in lateral units squared."""
    P = f.P
    add_modes(f, variance, SECOND_SHARE)
    f.coordinates[0].second_left = math.inf
    f.coordinates[1].second_left = math.inf
    # Another amplitude has another growth rate and frequency.
    P[at.GROWTH, at.GROWTH] = max(P[at.GROWTH, at.GROWTH], at.GROWTH_STD**2)
    P[at.OMEGA, at.OMEGA] = max(P[at.OMEGA, at.OMEGA], (0.1 * at.OMEGA_STD) ** 2)


@compiled_part
def reads(f: at.Filter, place: int, value: float) -> None:
    """Append an element that is not 0 to the row of H."""
    f.row.place[f.row.count] = place
    f.row.value[f.row.count] = value
    f.row.count += 1


@compiled_part
def aim(f: at.Filter, k: int) -> None:
    """
    Write into `row`, behind the lines, what sensor k reads of the state as it stands.

    Of a phasor z with the eigenvalue v = s + i omega it reads Re(c v^d z), d the derivative that
    it measures and c = 1 + e its scale; e is a state. What is not known yet of z tells nothing of
    its frequency, its growth and the scale.
    """
    sensor, x = f.sensors[k], f.x
    for i in range(2 * f.line_count):
        f.row.place[i] = line(f, k) + i
    f.row.count = 2 * f.line_count
    reads(f, at.BIAS + k, 1.0)
    z, w = at.Z + 2 * sensor.coordinate, at.W + 2 * sensor.coordinate
    pole = complex(x[at.GROWTH], x[at.OMEGA])
    # v^d, its derivative with respect to v, and the same power of the second mode's.
    power, slope, second = complex(sensor.unit), 0j, complex(sensor.unit)
    for _ in range(sensor.derivative):
        slope = pole * slope + power
        power, second = pole * power, SECOND * second
    scale = 1.0 + 0j
    if sensor.scale >= 0:
        scale += complex(x[sensor.scale], x[sensor.scale + 1])
    plain = sensor.derivative == 0 and sensor.scale < 0
    reads_phasor(f, z, f.row.averaged * scale * power, plain)
    reads_phasor(f, w, second, plain)
    f.row.direct = f.row.count
    sure = f.row.averaged * known(f, z)
    if not plain:
        bent = sure * turned(x, z, scale * slope)
        reads(f, at.GROWTH, bent.real)
        reads(f, at.OMEGA, -bent.imag)
    if sensor.scale >= 0:
        reads_phasor(f, sensor.scale, sure * turned(x, z, power), False)


@compiled_part
def reads_phasor(f: at.Filter, first: int, factor: complex, plain: bool) -> None:
    """Append the real part of a phasor times a factor, which is real where it is `plain`."""
    reads(f, first, factor.real)
    if not plain:
        reads(f, first + 1, -factor.imag)


@compiled_part
def project(f: at.Filter) -> float:
    """Write P H' into g and return H P H', with H in `row`."""
    f.g[: f.states] = 0.0
    for i in range(f.row.count):
        place, value = f.row.place[i], f.row.value[i]
        for j in range(f.states):
            f.g[j] += value * f.P[place, j]
    variance = 0.0
    for i in range(f.row.count):
        variance += f.row.value[i] * f.g[f.row.place[i]]
    return variance


@compiled_part
def expected(f: at.Filter, count: int) -> float:
    """Return what the first elements of `row` read of the state."""
    total = 0.0
    for i in range(count):
        total += f.row.value[i] * f.x[f.row.place[i]]
    return total


@compiled_part
def correct(f: at.Filter, innovation: float, S: float) -> None:
    """Kalman update with a scalar innovation: g = P H', S = H P H' + R. Scales g."""
    root = 1.0 / math.sqrt(S)
    for i in range(f.states):
        f.g[i] *= root
        f.x[i] += f.g[i] * root * innovation
    for i in range(f.states):
        for j in range(f.states):
            f.P[i, j] -= f.g[i] * f.g[j]  # this order keeps P symmetric to the last bit
