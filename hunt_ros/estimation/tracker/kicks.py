"""Kicks and glitches: when the covariance opens, and how far."""

from __future__ import annotations

import math

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.algebra import open_modes
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
    decay = math.exp(-min(dt, 0.05) / KICK_QUICK)
    step = math.sqrt(1.0 - decay * decay)
    turn_c, turn_s = math.cos(f.x[at.OMEGA] * dt), math.sin(f.x[at.OMEGA] * dt)
    if f.sensors[k, at.S_NIS] < 1.0 / NOISY:
        return 3
    unit = innovation / math.sqrt(S)
    re, im = f.sensors[k, at.S_K_RE], f.sensors[k, at.S_K_IM]
    moved_re = decay * (turn_c * re - turn_s * im) + step * unit
    moved_im = decay * (turn_s * re + turn_c * im)
    # What surprises all the time is no surprise: harmonics, a mode that is not modelled.
    usual = max(f.sensors[k, at.S_NIS], 1.0)
    surprising = unit * unit > f.cfg[at.C_GATE] ** 2 * usual
    # The further off, the longer it must last: an encoder that wraps is not a kick.
    patience = 0.0 if abs(unit) < ABSURD else 0.02
    recent = f.m[at.M_TIME] - f.m[at.M_KICK] < 0.1
    if surprising and not (recent and patience == 0.0):
        if f.sensors[k, at.S_PENDING] == 0.0:
            f.sensors[k, at.S_PENDING] = 1.0
            f.sensors[k, at.S_DOUBT] = f.m[at.M_TIME]
            return 2
        if f.m[at.M_TIME] - f.sensors[k, at.S_DOUBT] < patience:
            return 2
        if unit * unit > BEYOND * usual:
            return 3
    if not surprising and f.sensors[k, at.S_PENDING] == 1.0:
        f.counters[at.I_GLITCHES] += 1
    f.sensors[k, at.S_PENDING] = 0.0
    f.sensors[k, at.S_K_RE], f.sensors[k, at.S_K_IM] = moved_re, moved_im
    burst = moved_re * moved_re + moved_im * moved_im
    # A small part of a large motion may come and go without a kick: lines from its nonlinearity.
    z = at.Z + 2 * k
    slight = SLIGHT * SLIGHT * (f.x[z] ** 2 + f.x[z + 1] ** 2)
    # Nor may a wrong frequency keep opening the covariance: give it a second to be learnt.
    if burst > BURST * usual and f.m[at.M_TIME] - f.m[at.M_KICK] > 1.0:
        return 1 if 2.0 * burst * S * min(dt, 0.05) / KICK_QUICK > slight else 0
    return 1 if surprising else 0


@compiled_part
def handle_kick(f: at.Filter, k: int, innovation: float, dt: float) -> None:
    """Open the covariance after a kick seen by sensor k."""
    size = 1.0
    if k == 1:
        size = f.m[at.M_RHO_RE] ** 2 + f.m[at.M_RHO_IM] ** 2 + 2.0 * f.m[at.M_RHO_VAR]
    burst = f.sensors[k, at.S_K_RE] ** 2 + f.sensors[k, at.S_K_IM] ** 2
    scale = innovation * innovation + burst * f.sensors[k, at.S_NOISE]
    limit = 1e8 * f.sensors[k, at.S_NOISE]  # what double precision can still resolve
    opened = min(KICK_SCALE * KICK_SCALE * scale, limit) / size
    open_modes(f, opened)
    f.m[at.M_KICK_SIZE] = opened
    since = f.m[at.M_TIME] - f.m[at.M_KICK]
    if since > SETTLING:
        f.counters[at.I_KICKS] += 1
        f.m[at.M_CHAIN] = f.m[at.M_TIME]
    # A kick is over in a quarter of a period. What goes on, or comes again at once, is noise
    # or motion outside the model.
    if f.m[at.M_TIME] - f.m[at.M_CHAIN] > 0.2:
        f.sensors[k, at.S_NOISE] *= math.exp(5.0 * dt)
        loosen(f, 1.1)  # or the two sensors are tied by a wrong ratio
    elif SETTLING < since < 2.0:
        f.sensors[k, at.S_NOISE] *= 1.25
        f.m[at.M_LAMBDA] = min(f.m[at.M_LAMBDA] + 0.2, math.log(100.0))
        loosen(f, 4.0)
        # Or the frequency is wrong, and each beat looks like a kick.
        f.P[at.OMEGA, at.OMEGA] = max(f.P[at.OMEGA, at.OMEGA], f.cfg[at.C_OMEGA_STD] ** 2)
    power = f.x[0] * f.x[0] + f.x[1] * f.x[1]
    if scale > 9.0 * power * size:
        # A motion much larger than before: what was learnt from noise is worth little.
        off = f.x[at.OMEGA] - f.m[at.M_OMEGA0]
        f.P[at.OMEGA, at.OMEGA] = max(f.P[at.OMEGA, at.OMEGA], off * off)
        f.x[at.GROWTH] = min(max(f.x[at.GROWTH], -f.cfg[at.C_GROWTH_STD]), f.cfg[at.C_GROWTH_STD])
    f.m[at.M_KICK] = f.m[at.M_TIME]
    for i in range(2):
        f.sensors[i, at.S_K_RE] = 0.0
        f.sensors[i, at.S_K_IM] = 0.0
