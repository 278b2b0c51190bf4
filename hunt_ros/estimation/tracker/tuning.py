"""How a sensor starts, and how noise and bandwidths tune themselves."""

from __future__ import annotations

import cmath
import math

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.algebra import (
    SCALE_STD,
    line,
    magnified,
    measured,
    newest,
    open_modes,
    seen_of_lateral,
    speaks,
    turned,
)
from hunt_ros.estimation.tracker.ratio import loosen, squared

IN_BAND = 0.3  # s, of the whiteness measures
OFFSET = 25.0  # power of the mean innovation over that of white noise taken for an offset
#: A line is not in the readings where the mean of the whole motion in its frame, over so long, s,
#: has less than the first part of its power. Of a line that is there that holds now and then, by
#: the hunting that beats with it, so that the mean of the hunting must have more than the second
#: part of its power: that of hunting 5 % of the frequency away has less.
NOT_SHOWN, STANDS, LONG = 0.5, 0.1, 4.0


@compiled_part
def start_sensor(f: at.Filter, k: int, t: float) -> None:
    """Start the states of sensor k from the mean and spread of its first bins."""
    sensor = f.sensors[k]
    x, P = f.x, f.P
    count = sensor.boot.bins
    mean = sensor.boot.total / count
    spread = sensor.boot.square / count - mean * mean
    noise = sensor.boot.third / (20.0 * (count - 3.0))
    noise *= sensor.boot.samples / count
    sensor.noise = min(max(noise, 1e-8 * spread), spread)
    sensor.quick_noise = 0.0
    c = sensor.coordinate
    # No other sensor has started; none tells the motion that this one measures.
    alone, fresh = max(newest(f, 0), newest(f, 1)) == -math.inf, not measured(f, c)
    sensor.alive = True
    sensor.nis = 1.0
    sensor.residual = sensor.noise
    for j in range(f.line_count):
        sensor.lines[j].log_bandwidth = 0.0
        sensor.lines[j].since = t
    sensor.log_bias_bandwidth = math.log(0.1)
    if alone:
        x[at.OMEGA] = f.mode.omega
    motion = spread / magnified(f, k)  # the same, of the coordinate
    forget(f, at.BIAS + k, 1, 4.0 * spread)
    forget(f, line(f, k), 2 * f.line_count, 4.0 * spread * sensor.angle_known)
    if sensor.scale >= 0:
        forget(f, sensor.scale, 2, SCALE_STD**2)
    if fresh:
        forget(f, at.Z + 2 * c, 2, 4.0 * motion)
        forget(f, at.W + 2 * c, 2, 4.0 * motion)
    x[at.BIAS + k] = sensor.boot.reference + mean
    f.coordinates[c].tied = False
    if alone:
        f.time = t
        x[at.GROWTH] = 0.0
        P[at.OMEGA, at.OMEGA] = at.OMEGA_STD**2
        P[at.GROWTH, at.GROWTH] = at.GROWTH_STD**2
    elif fresh and sensor.started_before:
        loosen(f, 4.0)
    elif fresh and not f.ratio_known:
        # The ratio of the phasors is of the order of the ratio of the signals.
        z = at.Z + 2 * (1 - c)
        size = P[z, z] + x[z] ** 2 + x[z + 1] ** 2
        for i in range(f.sensor_count):
            other = f.sensors[i]
            if other.coordinate != c and other.alive:
                size = max(size, max(other.residual, other.boot.square) / magnified(f, i))
        f.ratio_var = 4.0 * motion / size if c == 1 else size / (4.0 * motion)
        f.ratio = 0j
    sensor.boot.square = spread
    sensor.started_before = True


@compiled_part
def forget(f: at.Filter, first: int, count: int, variance: float) -> None:
    """Set states to zero, each of a variance of its own."""
    for i in range(first, first + count):
        f.x[i] = 0.0
        for j in range(f.states):
            f.P[i, j] = 0.0
            f.P[j, i] = 0.0
        f.P[i, i] = variance


@compiled_part
def forget_start(f: at.Filter, k: int) -> None:
    """Forget the bins gathered for a start of sensor k."""
    boot = f.sensors[k].boot
    boot.bins = boot.samples = boot.start = boot.reference = 0.0
    boot.total = boot.square = boot.third = 0.0


@compiled_part
def stop_sensor(f: at.Filter, k: int) -> None:
    """Forget the level and noise of sensor k, which now gives another signal: start it anew."""
    sensor = f.sensors[k]
    forget_start(f, k)
    sensor.alive = False
    sensor.wrong = 0.0
    sensor.strange_since = math.inf
    sensor.stage = sensor.band = sensor.burst = 0j
    sensor.offset = 0.0
    for j in range(f.line_count):
        sensor.lines[j].band = 0j


@compiled_part
def third_difference(f: at.Filter, k: int, value: float) -> float:
    """Return that of the last values of sensor k and this one."""
    sensor = f.sensors[k]
    third = value - 3.0 * (sensor.before1 - sensor.before2) - sensor.before3
    sensor.before3, sensor.before2, sensor.before1 = sensor.before2, sensor.before1, value
    return float(third)


@compiled_part
def gather_start(f: at.Filter, k: int, t: float, mean: float, count: float) -> None:
    """Take one bin of a sensor that has not started yet; start it when there are enough."""
    sensor = f.sensors[k]
    if t - sensor.last > 0.1:
        forget_start(f, k)  # what came before a gap may be another signal
    if sensor.boot.bins == 0.0:
        sensor.boot.start = t
        sensor.boot.reference = mean
    value = mean - sensor.boot.reference
    third = third_difference(f, k, value)
    if sensor.boot.bins >= 3.0:
        sensor.boot.third += third * third
    sensor.boot.bins += 1.0
    sensor.boot.samples += count
    sensor.boot.total += value
    sensor.boot.square += value * value
    enough = sensor.boot.bins >= 12.0 and t - sensor.boot.start >= 0.15
    if enough and sensor.boot.third > 0.0:
        start_sensor(f, k, t)


@compiled_part
def tune(f: at.Filter, k: int, dt: float, count: float) -> None:
    """
    Self-tuning after one bin of sensor k; see the docstring of `block`.

    `dt` is the time since the sensor's last bin, `count` the samples in this one.
    """
    sensor = f.sensors[k]
    x, innovation, S = f.x, f.innovation, f.variance
    # Of the mean, after the update: v - H x, and H P H'.
    residual = innovation * f.noise / S
    left = f.noise * (1.0 - f.noise / S)
    dt = min(dt, 0.05)
    noise = sensor.noise
    third = third_difference(f, k, innovation)
    share = 1.0 - math.exp(-dt / 0.5)
    quick = count * third * third / 20.0
    sensor.quick_noise += share * (min(quick, 9.0 * noise) - sensor.quick_noise)
    sensor.nis += share * (min(f.surprise, 25.0) - sensor.nis)
    explained = count * (residual * residual + left)
    sensor.residual += share * (count * residual * residual - sensor.residual)
    settled = f.time - f.kick > at.SETTLING
    span = min(
        at.NOISE_TIME,
        max(0.3 * (f.time - sensor.boot.start), 0.1),
    )
    if not 0.5 < sensor.nis < 2.0:
        span = max(0.25 * span, 0.1)  # far off: be quick
    noise += (1.0 - math.exp(-dt / span)) * (min(explained, 9.0 * noise) - noise)
    sensor.noise = max(noise, 0.5 * sensor.quick_noise, 1e-12 * sensor.boot.square)

    # Innovations demodulated: u, with E |u|^2 = 1 where they are white.
    unit = innovation / math.sqrt(S)
    decay = math.exp(-dt / IN_BAND)
    turn = decay * cmath.exp(complex(0.0, x[at.OMEGA] * dt))
    step = math.sqrt(1.0 - decay * decay)
    # Two stages, so that harmonics of the limit cycle do not leak into the band.
    gain = math.sqrt((1.0 - decay * decay) ** 3 / (1.0 + decay * decay))
    sensor.stage = turn * sensor.stage + unit
    sensor.band = turn * sensor.band + gain * sensor.stage
    sensor.offset = decay * sensor.offset + step * unit
    if sensor.offset**2 > OFFSET * max(sensor.nis, 1.0):
        # The level drifts, more than the filter of the bias can follow.
        f.P[at.BIAS + k, at.BIAS + k] += 10.0 * sensor.offset**2 * S * dt / (2.0 * IN_BAND)
        sensor.offset = 0.0
    for j in range(f.line_count):
        cosine, sine = f.row.value[2 * j], f.row.value[2 * j + 1]
        if cosine != 0.0 or sine != 0.0:
            size = step * unit / math.sqrt(cosine * cosine + sine * sine)
            sensor.lines[j].band = decay * sensor.lines[j].band + size * complex(cosine, sine)
            share_with_line(f, k, j, dt)
        else:
            sensor.lines[j].since = f.time  # its means begin when it is seen
    if not settled:
        return
    rate = 0.5 * dt / at.BANDWIDTH_TIME
    speaking = 0.0
    for i in range(f.sensor_count):
        speaking += speaks(f, i)
    power = squared(sensor.band)
    f.log_bandwidth = tuned(f.log_bandwidth, power, rate / max(speaking, 1.0), 0.2, 100.0)
    power = sensor.offset**2
    sensor.log_bias_bandwidth = tuned(sensor.log_bias_bandwidth, power, rate, 0.02, 3.0)
    for j in range(f.line_count):
        own = sensor.lines[j]
        own.log_bandwidth = tuned(own.log_bandwidth, squared(own.band), rate, 0.05, 5.0)


@compiled_part
def reading_of(f: at.Filter, k: int) -> complex:
    """Return what sensor k reads of its coordinate, per unit of the phasor."""
    factor = complex(f.sensors[k].unit)
    for _ in range(f.sensors[k].derivative):
        factor *= complex(f.x[at.GROWTH], f.x[at.OMEGA])
    return factor


@compiled_part
def share_with_line(f: at.Filter, k: int, j: int, dt: float) -> None:
    """
    Share the motion out anew between hunting and line j where sensor k does not show the line.

    In the frame of the line the mean of the whole motion is the line, and that of the hunting is
    0, but where they turn alike. A filter that has come to believe in hunting and a line that
    cancel, or in hunting that beats against a line that is not there, goes on to: its process
    noise follows the beat. That the wheelset moves so is far less likely than that it has one
    motion.
    """
    x, P, sensor = f.x, f.P, f.sensors[k]
    own, factor = sensor.lines[j], reading_of(f, k)
    back = complex(f.row.value[2 * j], -f.row.value[2 * j + 1])
    z, i = at.Z + 2 * sensor.coordinate, line(f, k) + 2 * j
    age = f.time - own.since
    gain = dt / min(max(age, dt), LONG)
    own.lasting += gain * (turned(x, z, back) - own.lasting)
    own.power += gain * (x[z] ** 2 + x[z + 1] ** 2 - own.power)
    told = complex(x[i], -x[i + 1])
    left = squared(told + factor * own.lasting)
    if age < LONG or left >= NOT_SHOWN * squared(told):
        return
    if squared(own.lasting) < STANDS * own.power:
        return
    # What is left in the mean is the line's, as far as it is what the motion is now.
    whole = squared(told + turned(x, z, factor * back))
    share = min(left, whole) / max(left, whole)
    for m in range(f.sensor_count):
        other = f.sensors[m]
        if not other.alive:
            continue
        z, i, factor = at.Z + 2 * other.coordinate, line(f, m) + 2 * j, reading_of(f, m)
        told = complex(x[i], -x[i + 1])
        mean = told + factor * other.lines[j].lasting
        x[i], x[i + 1] = share * mean.real, -share * mean.imag
        P[i, i] += 0.5 * squared(mean)
        P[i + 1, i + 1] += 0.5 * squared(mean)
        other.lines[j].since = f.time
        if m == k or (other.scale < 0 and other.coordinate != sensor.coordinate):
            given = (told - share * mean) * back.conjugate() / factor
            x[z] += given.real
            x[z + 1] += given.imag
    f.log_bandwidth = 0.0  # it was that of the beat
    open_modes(f, left / seen_of_lateral(f, k))


@compiled_part
def tuned(log_bandwidth: float, power: float, rate: float, low: float, high: float) -> float:
    """Return the log of a bandwidth moved towards white innovations (mean power 1)."""
    moved = log_bandwidth + rate * (min(power, 8.0) - 1.0)
    return min(max(moved, math.log(low)), math.log(high))
