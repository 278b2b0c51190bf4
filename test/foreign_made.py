"""
Rigs of another make: a wheelset on rollers by its own equations of motion.

Nothing of hunt_ros.dynamics is in them: conicity and creep that saturate, forcing of the yaw
acceleration, lines of the roller as creep. v_c is that of the eigenvalues; v_n is where a settled
limit cycle dies when the speed is lowered step by step, without forcing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from made import record_of
from numba import njit

from hunt_ros.samples import Record

#: kg, kg m^2 and half the gauge, m; stiffness of y over that of yaw, in squares of frequencies.
_MASS, _INERTIA, _GAUGE, _LATERAL = 1.0, 0.25, 0.5, 0.34**2
#: Samples in a second of all channels.
_RATE_HZ = 200.0
#: Forcing, sensor noise and lines of the roller, in shares of the amplitude at the fold.
_FORCING, _NOISE, _LINES = 0.01, 0.005, (0.03, 0.01)


@dataclass(frozen=True)
class Foreign:
    """
    A rig: speeds in m/s, lengths in m.

    `conicity` is that at y = 0; it changes by `bends` times (y / `scale`)^2 and ^4, or, where
    `exponential`, by as much of two exponentials. `creep` is the force at which creep saturates
    (0: never). `size` is the amplitude at the fold.
    """

    v_c: float
    v_n: float | None
    hertz: float
    yaw_rate: float
    conicity: float
    bends: tuple[float, float]
    scale: float
    size: float
    exponential: bool = False
    creep: float = 0.0
    diameter: float = 0.3
    loss: float = 2.5

    @property
    def told(self) -> dict[str, float]:
        """What a user tells of it, as settings of the identification."""
        return {'roller_diameter_m': self.diameter, 'hunting_frequency_hz': 1.1 * self.hertz}


RIGS: Mapping[str, Foreign] = {
    'conicity of fifth order': Foreign(
        8.0, 7.190, 2.84, 23.892355, 0.39407446, (1.0, -1.0), 1e-3, 7.77e-4
    ),
    'conicity that saturates': Foreign(
        14.0, 12.382, 4.0, 33.651204, 0.29780521, (0.6, 1.2), 1e-3, 1.48e-3, True, diameter=0.35
    ),
    'creep that saturates': Foreign(
        22.0, 20.925, 4.5, 37.857604, 0.34887511, (0.3, -0.2), 1e-3, 9.57e-4, creep=3.6320833,
        diameter=0.8,
    ),
    'soft onset': Foreign(
        12.0, None, 4.0, 33.651204, 0.57906568, (-0.3, 0.0), 1e-3, 1.0e-3, diameter=0.5
    ),
}  # fmt: skip


@njit(cache=True)
def _rates(x, v, slip, p):  # type: ignore[no-untyped-def]
    """Rates of y, y', psi, psi' at a speed, with the slip that the roller adds."""
    bend, far, scale, exponential = p[1], p[2], p[3], p[4]
    q = (x[0] / scale) ** 2
    if exponential:
        conicity = p[0] * (1.0 + bend * (1.0 - math.exp(-q)) - far * (1.0 - math.exp(-q / 9.0)))
    else:
        conicity = p[0] * (1.0 + bend * q + far * q * q)
    across = p[5] * (x[1] / v - x[2] - slip)
    along = p[6] * (conicity * x[0] / p[7] + _GAUGE * x[3] / v)
    share = 1.0
    if p[8] > 0.0:
        u = math.hypot(across, along) / p[8]
        share = 1.0 - u / 3.0 + u * u / 27.0 if u < 3.0 else 1.0 / u
    y2 = -(2.0 * share * across) / _MASS - _LATERAL * p[9] ** 2 * x[0]
    psi2 = -(2.0 * _GAUGE * share * along) / _INERTIA - p[9] ** 2 * x[2]
    return np.array([x[1], y2, x[3], psi2])


@njit(cache=True)
def _motion(x, speed, impulse, lines, phases, step, count, p):  # type: ignore[no-untyped-def]
    """States and angle of the roller at each sample: RK4 between impulses of the yaw rate."""
    states, angles, angle, h = np.empty((speed.size, 4)), np.empty(speed.size), 0.0, step / count
    for k in range(speed.size):
        states[k], angles[k], v = x, angle, speed[k]
        x[3] += impulse[k]
        for _ in range(count):
            slip, total, rate = 0.0, np.zeros(4), np.zeros(4)
            for order in range(lines.size):
                slip += lines[order] * math.cos((order + 1) * angle + phases[order])
            for stage in range(4):
                lead = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
                rate = _rates(x + lead * rate, v, slip, p)
                total += rate * (1.0 if stage == 0 or stage == 3 else 2.0)
            x = x + h / 6.0 * total
            angle += v / p[7] * h
    return states, angles


def recorded(
    rig: Foreign, times: Sequence[float], speeds: Sequence[float], kicks: Mapping[float, float],
    seed: int, noise: float = _NOISE,
) -> Record:  # fmt: skip
    """Record a run: corners in s and shares of v_c; kicks by their time, in shares of `size`."""
    rng = np.random.default_rng(seed)
    step = 1.0 / _RATE_HZ
    time = np.arange(0.0, times[-1], step)
    speed = rig.v_c * np.interp(time, times, speeds)
    creep = rig.loss * rig.yaw_rate * rig.v_c * np.array([0.5, 0.5 * _INERTIA / _GAUGE**2])
    law = rig.conicity, *rig.bends, rig.scale, rig.exponential
    p = np.array([*law, *creep, 0.5 * rig.diameter, rig.creep, rig.yaw_rate])
    # The left eigenvector of the hunting tells what yaw acceleration does to y.
    near = [_rates(1e-9 * row, 0.9 * rig.v_c, 0.0, p) / 1e-9 for row in np.eye(4)]
    values, vectors = np.linalg.eig(np.array(near).T)
    mode = int(np.argmax(np.where(values.imag > 0.0, values.real, -np.inf)))
    reach = 2.0 * abs(np.linalg.inv(vectors)[mode, 3] * vectors[0, mode])
    turn = rig.size * 2.0 * math.pi * rig.hertz / rig.v_c
    push = _FORCING * rig.size * math.sqrt(2.0 * abs(values[mode].real) * step) / reach
    # Ten seconds of rest before it begins.
    speed = np.concatenate([np.full(round(10.0 / step), speed[0]), speed])
    impulse = push * rng.standard_normal(speed.size)
    for at, share in kicks.items():
        impulse[round((10.0 + at) / step)] += rng.choice([-1.0, 1.0]) * share * rig.size / reach
    lines, phases = turn * np.array(_LINES), rng.uniform(0.0, 6.0, 2)
    count = math.ceil(50.0 * rig.hertz * step)
    moved = _motion(np.zeros(4), speed, impulse, lines, phases, step, count, p)
    states, angle, speed = (one[-time.size :] for one in (*moved, speed))
    sizes = {'lateral': (states[:, 0], noise * rig.size), 'yaw': (states[:, 2], noise * turn),
             'speed': (speed, 1e-4 * rig.v_c), 'roller': (angle, 0.0)}  # fmt: skip
    noisy = {n: v + std * rng.standard_normal(time.size) for n, (v, std) in sizes.items()}
    return record_of(time, **noisy)


def _passage(
    rig: Foreign, seconds: float, both: bool = True
) -> tuple[list[float], list[float], dict[float, float]]:
    """Corners of a ramp through the hysteresis in so many seconds, and back."""
    low, high = 0.82 if rig.v_n is None else 0.93 * rig.v_n / rig.v_c, 1.11
    lasts = np.cumsum([0.0, 5.0, seconds, 10.0, seconds, 5.0])[: 6 if both else 4]
    return lasts.tolist(), [low, low, high, high, low, low][: lasts.size], {}


def _stairs(rig: Foreign) -> tuple[list[float], list[float], dict[float, float]]:
    """Corners of holds of 40 s up and down between kicks."""
    low = 0.93 if rig.v_n is None else 0.96 * rig.v_n / rig.v_c
    levels = [*np.linspace(low, 1.05, 7), *np.linspace(1.03, low - 0.01, 6)]
    times = [at for k in range(len(levels)) for at in (44.0 * k, 44.0 * k + 40.0)]
    return times, np.repeat(levels, 2).tolist(), {14.0: 0.8, 58.0: 0.9, 102.0: 0.9}


RECORDINGS = {
    'ramps of two minutes': lambda rig, seed: recorded(rig, *_passage(rig, 120.0), seed),
    'ramps of 25 s': lambda rig, seed: recorded(rig, *_passage(rig, 25.0), seed),
    'up alone in 80 s': lambda rig, seed: recorded(rig, *_passage(rig, 80.0, False), seed),
    'kicked holds': lambda rig, seed: recorded(rig, *_stairs(rig), seed),
    '10 % sensor noise': lambda rig, seed: recorded(rig, *_passage(rig, 120.0), seed, 0.1),
}
