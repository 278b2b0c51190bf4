"""Surprises: what is one, and how far it opens the covariance if it was a kick or a step."""

from __future__ import annotations

import math

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.algebra import magnified, open_modes, seen_of_lateral
from hunt_ros.estimation.tracker.ratio import SETTLING, loosen

KICK_QUICK = 0.08  # s, time constant of the in-band burst detector
BURST = 20.0  # power over that of white noise taken for a surprise
OPENED = 5.0  # the covariance opens to this multiple of the innovation
SLIGHT = 0.03  # of the amplitude: a change that needs no opening of the covariance
RESOLVED = 1e8  # power over that of the noise that double precision can still resolve


@compiled_part
def usual(f: at.Filter, k: int) -> float:
    """Variance of the innovations of sensor k over the expected one: 1 if the model is right."""
    # What surprises all the time is no surprise: harmonics, a mode that is not modelled.
    return max(f.sensors[k].nis, 1.0)


@compiled_part
def surprising(f: at.Filter, k: int) -> bool:
    """Return True if the innovation at hand is beyond what noise gives."""
    return f.innovation * f.innovation > at.GATE**2 * usual(f, k) * f.variance


@compiled_part
def gather_burst(f: at.Filter, k: int, dt: float) -> float:
    """
    Add the innovation at hand to the burst, demodulated at the hunting frequency.

    Returns
    -------
    float
        Its power over that of white noise if it is one that needs the covariance opened, else 0.
    """
    sensor, x = f.sensors[k], f.x
    dt = min(dt, 0.05)
    decay = math.exp(-dt / KICK_QUICK)
    step = math.sqrt(1.0 - decay * decay)
    turn_c, turn_s = math.cos(x[at.OMEGA] * dt), math.sin(x[at.OMEGA] * dt)
    re, im = sensor.burst_re, sensor.burst_im
    unit = f.innovation / math.sqrt(f.variance)
    sensor.burst_re = decay * (turn_c * re - turn_s * im) + step * unit
    sensor.burst_im = decay * (turn_s * re + turn_c * im)
    burst = sensor.burst_re**2 + sensor.burst_im**2
    # A wrong frequency may not keep opening the covariance: give it a second to be learnt.
    if burst <= BURST * usual(f, k) or f.time - f.opened <= 1.0:
        return 0.0
    # A small part of a large motion may come and go without a kick: lines from its nonlinearity.
    z = at.Z + 2 * sensor.coordinate
    slight = SLIGHT * SLIGHT * (x[z] ** 2 + x[z + 1] ** 2) * magnified(f, k)
    if 2.0 * burst * f.variance * dt / KICK_QUICK <= slight:
        return 0.0
    return burst / usual(f, k)


@compiled_part
def seen(f: at.Filter, k: int) -> float:
    """Power of what surprises, in the signal of sensor k."""
    sensor = f.sensors[k]
    burst = sensor.burst_re**2 + sensor.burst_im**2
    return f.innovation * f.innovation + burst * sensor.noise


@compiled_part
def begin(f: at.Filter, event: int) -> None:
    """Note what the covariance is opened for."""
    f.event = event
    f.opened = f.time
    for i in range(f.sensor_count):
        f.sensors[i].burst_re = 0.0
        f.sensors[i].burst_im = 0.0


@compiled_part
def open_level(f: at.Filter, k: int) -> None:
    """Open the covariance for a step of the level of sensor k."""
    opened = min(OPENED * OPENED * seen(f, k), RESOLVED * f.sensors[k].noise)
    f.P[at.BIAS + k, at.BIAS + k] += opened
    if f.sensors[k].stepped == -math.inf:
        f.sensors[k].stepped = f.time
    begin(f, at.STEP)


@compiled_part
def open_kick(f: at.Filter, k: int, dt: float) -> None:
    """Open the covariance for a kick seen by sensor k."""
    sensor = f.sensors[k]
    x, P = f.x, f.P
    size, scale = seen_of_lateral(f, k), seen(f, k)
    open_modes(f, min(OPENED * OPENED * scale, RESOLVED * sensor.noise) / size)
    since = f.time - f.kick
    if since > SETTLING:
        f.kicks += 1
        f.kick_chain = f.time
    # A kick is over in a quarter of a period. What goes on, or comes again at once, is noise
    # or motion outside the model.
    if f.time - f.kick_chain > 0.2:
        sensor.noise *= math.exp(5.0 * dt)
        loosen(f, 1.1)  # or the two sensors are tied by a wrong ratio
    elif SETTLING < since < 2.0:
        sensor.noise *= 1.25
        f.log_bandwidth = min(f.log_bandwidth + 0.2, math.log(100.0))
        loosen(f, 4.0)
        # Or the frequency is wrong, and each beat looks like a kick.
        P[at.OMEGA, at.OMEGA] = max(P[at.OMEGA, at.OMEGA], at.OMEGA_STD**2)
    power = x[0] * x[0] + x[1] * x[1]
    if scale > 9.0 * power * size:
        # A motion much larger than before: what was learnt from noise is worth little.
        off = x[at.OMEGA] - f.mode.omega
        P[at.OMEGA, at.OMEGA] = max(P[at.OMEGA, at.OMEGA], off * off)
        x[at.GROWTH] = min(max(x[at.GROWTH], -at.GROWTH_STD), at.GROWTH_STD)
    f.kick = f.time
    begin(f, at.KICK)
