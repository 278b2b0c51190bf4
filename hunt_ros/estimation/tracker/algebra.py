"""The algebra of the filter: prediction, process noise, projection, correction."""

from __future__ import annotations

import math

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at

SECOND_SHARE = 0.1  # of that, the second mode's, which is of the order of the first
REVERSION = 30.0  # s in which frequency and growth rate fall back to the nominal ones
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
def predict(f: at.Filter, dt: float) -> None:
    """Move state and covariance dt seconds on, without process noise: x = f(x), P = F P F'."""
    x, P = f.x, f.P
    growth, omega = x[at.GROWTH], x[at.OMEGA]
    scale = math.exp(min(max(growth * dt, -5.0), 5.0))
    c, s = scale * math.cos(omega * dt), scale * math.sin(omega * dt)
    scale2 = math.exp(-f.mode.decay2 * dt)
    c2, s2 = scale2 * math.cos(f.mode.omega2 * dt), scale2 * math.sin(f.mode.omega2 * dt)
    keep_omega = keep_growth = math.exp(-dt / REVERSION)

    for k in range(2):
        i, j = at.Z + 2 * k, at.W + 2 * k
        x[i], x[i + 1] = c * x[i] - s * x[i + 1], s * x[i] + c * x[i + 1]
        x[j], x[j + 1] = c2 * x[j] - s2 * x[j + 1], s2 * x[j] + c2 * x[j + 1]
    x[at.OMEGA] = f.mode.omega + keep_omega * (omega - f.mode.omega)
    x[at.GROWTH] = keep_growth * growth

    # F P: the rows of everything that moves (all before at.BIAS).
    # A phasor that is not known yet tells nothing of its frequency and growth.
    shares = (dt * known(f, at.Z), dt * known(f, at.Z + 2))
    for j in range(f.states):
        po, pg = P[at.OMEGA, j], P[at.GROWTH, j]
        for k in range(2):
            z, w = at.Z + 2 * k, at.W + 2 * k
            a, b = x[z] * shares[k], x[z + 1] * shares[k]
            p, q = P[z, j], P[z + 1, j]
            P[z, j] = c * p - s * q - b * po + a * pg
            P[z + 1, j] = s * p + c * q + a * po + b * pg
            p, q = P[w, j], P[w + 1, j]
            P[w, j], P[w + 1, j] = c2 * p - s2 * q, s2 * p + c2 * q
        P[at.OMEGA, j], P[at.GROWTH, j] = keep_omega * po, keep_growth * pg
    # (F P) F': the same on columns, where rows and columns both move.
    for i in range(at.BIAS):
        po, pg = P[i, at.OMEGA], P[i, at.GROWTH]
        for k in range(2):
            z, w = at.Z + 2 * k, at.W + 2 * k
            a, b = x[z] * shares[k], x[z + 1] * shares[k]
            p, q = P[i, z], P[i, z + 1]
            P[i, z] = c * p - s * q - b * po + a * pg
            P[i, z + 1] = s * p + c * q + a * po + b * pg
            p, q = P[i, w], P[i, w + 1]
            P[i, w], P[i, w + 1] = c2 * p - s2 * q, s2 * p + c2 * q
        P[i, at.OMEGA], P[i, at.GROWTH] = keep_omega * po, keep_growth * pg
    for i in range(at.BIAS):
        for j in range(i + 1, f.states):
            P[j, i] = P[i, j]


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
def add_pair(
    f: at.Filter, first: int, variance: float, re: float, im: float, spread: float
) -> None:
    """
    Add an isotropic complex jump u at `first` and (re + i im + e) u at `first` + 2.

    `variance` is that of each part of u, `spread` the variance of each part of e.
    """
    P = f.P
    other = variance * (re * re + im * im + 2.0 * spread)
    for i in range(2):
        P[first + i, first + i] += variance
        P[first + 2 + i, first + 2 + i] += other
        P[first + i, first + 2 + i] += variance * re
        P[first + 2 + i, first + i] += variance * re
    P[first, first + 3] += variance * im
    P[first + 3, first] += variance * im
    P[first + 1, first + 2] -= variance * im
    P[first + 2, first + 1] -= variance * im


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
def started(f: at.Filter, coordinate: int) -> bool:
    """Return True if a sensor of the coordinate has started."""
    for k in range(f.sensor_count):
        if f.sensors[k].coordinate == coordinate and f.sensors[k].alive:
            return True
    return False


@compiled_part
def measured(f: at.Filter, coordinate: int) -> bool:
    """Return True if a sensor of the coordinate speaks."""
    for k in range(f.sensor_count):
        if f.sensors[k].coordinate == coordinate and speaks(f, k):
            return True
    return False


@compiled_part
def told(f: at.Filter, coordinate: int) -> bool:
    """
    Return True if sensors tell the coordinate, or did so till all fell silent.

    What fell silent a hunting period before the other coordinate, or more, is of the past.
    """
    if not started(f, coordinate):
        return False
    behind = newest(f, 1 - coordinate) - newest(f, coordinate)
    return behind * f.mode.omega <= 2.0 * math.pi


@compiled_part
def newest(f: at.Filter, coordinate: int) -> float:
    """Return when a sensor of the coordinate has spoken last; minus infinity: never."""
    last = -math.inf
    for k in range(f.sensor_count):
        if f.sensors[k].coordinate == coordinate and f.sensors[k].alive:
            last = max(last, f.sensors[k].last)
    return last


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
        power *= f.rho_re**2 + f.rho_im**2 + 2.0 * f.rho_var
    return power


@compiled_part
def lateral_density(f: at.Filter) -> float:
    """Noise density of all sensors together, referred to the lateral phasor."""
    gain = f.rho_re**2 + f.rho_im**2 + 2.0 * f.rho_var
    lateral, yaw = measured(f, 0), measured(f, 1)
    silent = not lateral and not yaw  # all are: as they were
    if silent:
        lateral = started(f, 0)
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
    Add what dt seconds make unknown of a second mode whose eigenvalue is only guessed.

    A wrong eigenvalue, by d = M_STD2 |eigenvalue|, leaves an error that grows by d w a second.
    Spread over the life of the power |w|^2, 1/(2 decay), that is white noise of the density
    |d w|^2/(2 decay). The power counted dies from the last kick on, as the slowest likely
    decay has it, so that what noise makes of the mode does not keep it alive.
    """
    x, P = f.x, f.P
    std, decay = f.mode.std2, f.mode.decay2
    if std == 0.0 or f.coordinates[0].second_left + f.coordinates[1].second_left == 0.0:
        return
    omega = f.mode.omega2
    grown = 0.5 * std * std * (decay * decay + omega * omega) / (2.0 * decay) * dt
    kept = math.exp(-2.0 * (1.0 - std) * decay * dt)
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
    add_pair(f, at.Z, q, f.rho_re, f.rho_im, f.rho_var)
    if math.isnan(f.mode.rho2_re):
        size = f.rho_re**2 + f.rho_im**2 + 2.0 * f.rho_var
        add_pair(f, at.W, q, 0.0, 0.0, 0.5 * size)
    else:
        add_pair(f, at.W, q, f.mode.rho2_re, f.mode.rho2_im, 0.0)
    doubt_second(f, dt)
    # One ratio holds for all amplitudes and speeds only to the floor: let it breathe.
    drift = at.RATIO_FLOOR**2 * dt * 0.5 * (x[2] * x[2] + x[3] * x[3])
    P[2, 2] += drift
    P[3, 3] += drift
    P[at.OMEGA, at.OMEGA] += at.OMEGA_DRIFT**2 * dt
    # The growth rate changes with the amplitude, and so the quicker the larger it is.
    P[at.GROWTH, at.GROWTH] += (at.GROWTH_DRIFT**2 + 0.25 * x[at.GROWTH] ** 2) * dt
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
    add_pair(f, at.Z, variance, f.rho_re, f.rho_im, f.rho_var)
    if math.isnan(f.mode.rho2_re):
        size = f.rho_re**2 + f.rho_im**2 + 2.0 * f.rho_var
        add_pair(f, at.W, SECOND_SHARE * variance, 0.0, 0.0, 0.5 * size)
    else:
        add_pair(f, at.W, SECOND_SHARE * variance, f.mode.rho2_re, f.mode.rho2_im, 0.0)
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
    a, b, c, d, u, v = sensor.unit, 0.0, 0.0, 0.0, sensor.unit, 0.0
    growth, omega = x[at.GROWTH], x[at.OMEGA]
    for _ in range(sensor.derivative):
        # (v^n)' = v (v^(n-1))' + v^(n-1)
        c, d = growth * c - omega * d + a, omega * c + growth * d + b
        a, b = growth * a - omega * b, omega * a + growth * b
        u, v = (
            -f.mode.decay2 * u - f.mode.omega2 * v,
            f.mode.omega2 * u - f.mode.decay2 * v,
        )
    re, im = a * x[z] - b * x[z + 1], b * x[z] + a * x[z + 1]
    if sensor.scale >= 0:
        size, turn = 1.0 + x[sensor.scale], x[sensor.scale + 1]
        a, b = size * a - turn * b, turn * a + size * b
        c, d = size * c - turn * d, turn * c + size * d
    plain = sensor.derivative == 0 and sensor.scale < 0
    reads(f, z, f.row.averaged * a)
    reads(f, w, u)
    if not plain:
        reads(f, z + 1, -f.row.averaged * b)
        reads(f, w + 1, -v)
    f.row.direct = f.row.count
    sure = f.row.averaged * known(f, z)
    if not plain:
        reads(f, at.GROWTH, sure * (c * x[z] - d * x[z + 1]))
        reads(f, at.OMEGA, -sure * (d * x[z] + c * x[z + 1]))
    if sensor.scale >= 0:
        reads(f, sensor.scale, sure * re)
        reads(f, sensor.scale + 1, -sure * im)


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
