"""Kicks and glitches: when the covariance opens, and how far."""

from __future__ import annotations

import math

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.algebra import magnified, open_modes, seen_of_lateral
from hunt_ros.estimation.tracker.ratio import SETTLING, loosen

KICK_QUICK = 0.08  # s, time constant of the in-band burst detector
BURST = 20.0  # power over that of white noise taken for a kick
ABSURD = 60.0  # standard deviations beyond which a kick must last 20 ms to be believed
BEYOND = 1e8  # power of an innovation over its variance that is no motion, but another signal
NOISY = 1e3  # variance found over variance expected below which the noise is of another time
KICK_SCALE = 5.0  # the covariance opens to this multiple of the innovation
SLIGHT = 0.03  # of the amplitude: a change that needs no opening of the covariance


@compiled_part
def kicked(f: at.Filter, k: int, innovation: float, S: float, dt: float) -> int:
    """Judge one innovation: 0 ordinary, 1 a kick, 2 leave it out for now, 3 another signal."""
    sensor = f.sensors[k]
    x = f.x
    decay = math.exp(-min(dt, 0.05) / KICK_QUICK)
    step = math.sqrt(1.0 - decay * decay)
    turn_c, turn_s = math.cos(x[at.OMEGA] * dt), math.sin(x[at.OMEGA] * dt)
    if sensor.nis < 1.0 / NOISY:
        return 3
    unit = innovation / math.sqrt(S)
    re, im = sensor.burst_re, sensor.burst_im
    moved_re = decay * (turn_c * re - turn_s * im) + step * unit
    moved_im = decay * (turn_s * re + turn_c * im)
    # What surprises all the time is no surprise: harmonics, a mode that is not modelled.
    usual = max(sensor.nis, 1.0)
    surprising = unit * unit > f.cfg.gate**2 * usual
    # The further off, the longer it must last: an encoder that wraps is not a kick.
    patience = 0.0 if abs(unit) < ABSURD else 0.02
    recent = f.time - f.kick < 0.1
    if surprising and not (recent and patience == 0.0):
        if not sensor.doubted:
            sensor.doubted = True
            sensor.doubted_since = f.time
            return 2
        if f.time - sensor.doubted_since < patience:
            return 2
        if unit * unit > BEYOND * usual:
            return 3
    if not surprising and sensor.doubted:
        f.glitches += 1
    sensor.doubted = False
    sensor.burst_re, sensor.burst_im = moved_re, moved_im
    burst = moved_re * moved_re + moved_im * moved_im
    # A small part of a large motion may come and go without a kick: lines from its nonlinearity.
    z = at.Z + 2 * sensor.coordinate
    slight = SLIGHT * SLIGHT * (x[z] ** 2 + x[z + 1] ** 2) * magnified(f, k)
    # Nor may a wrong frequency keep opening the covariance: give it a second to be learnt.
    if burst > BURST * usual and f.time - f.kick > 1.0:
        return 1 if 2.0 * burst * S * min(dt, 0.05) / KICK_QUICK > slight else 0
    return 1 if surprising else 0


@compiled_part
def handle_kick(f: at.Filter, k: int, innovation: float, dt: float) -> None:
    """Open the covariance after a kick seen by sensor k."""
    sensor = f.sensors[k]
    x, P = f.x, f.P
    size = seen_of_lateral(f, k)
    burst = sensor.burst_re**2 + sensor.burst_im**2
    scale = innovation * innovation + burst * sensor.noise
    limit = 1e8 * sensor.noise  # what double precision can still resolve
    opened = min(KICK_SCALE * KICK_SCALE * scale, limit) / size
    open_modes(f, opened)
    f.kick_size = opened
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
        P[at.OMEGA, at.OMEGA] = max(P[at.OMEGA, at.OMEGA], f.cfg.omega_std**2)
    power = x[0] * x[0] + x[1] * x[1]
    if scale > 9.0 * power * size:
        # A motion much larger than before: what was learnt from noise is worth little.
        off = x[at.OMEGA] - f.mode.omega
        P[at.OMEGA, at.OMEGA] = max(P[at.OMEGA, at.OMEGA], off * off)
        x[at.GROWTH] = min(max(x[at.GROWTH], -f.cfg.growth_std), f.cfg.growth_std)
    f.kick = f.time
    for i in range(f.sensor_count):
        f.sensors[i].burst_re = 0.0
        f.sensors[i].burst_im = 0.0
