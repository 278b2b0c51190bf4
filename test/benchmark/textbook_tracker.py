"""
The tracker once more, with filterpy's dense matrices: what the kernel is checked against.

The decisions (bins, kicks, self-tuning) are those of the kernel, run as plain Python.
The algebra of the filter is written down anew, from the model in the docstring
of `tracker.block`, as matrices F, Q and H for `filterpy.kalman.KalmanFilter`. It gives the same
numbers to rounding, two orders of magnitude slower.
"""

from __future__ import annotations

import math
from types import FunctionType
from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

from hunt_ros.estimation.kalman import HuntingTracker
from hunt_ros.estimation.tracker import (
    algebra,
    bins,
    block,
    hypotheses,
    kicks,
    ratio,
    rows,
    tuning,
)
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker_config import TrackerConfig
from hunt_ros.records import zeros

_F = NDArray[np.float64]

_speaks = getattr(algebra.speaks, 'py_func', algebra.speaks)
_known = getattr(algebra.known, 'py_func', algebra.known)


def plain_parts() -> dict[str, Any]:
    """
    Return the functions of the tracker's inner loop as plain Python, not compiled.

    Returns
    -------
    dict
        The one namespace in which they find each other: what is replaced there is
        replaced for all of them, and not in the tracker.
    """
    space: dict[str, Any] = {'at': at}
    for module in (algebra, bins, hypotheses, kicks, ratio, rows, tuning, block):
        space.update(vars(module))
    for name, value in list(space.items()):
        function = getattr(value, 'py_func', value)
        if isinstance(function, FunctionType) and function.__module__.startswith(at.__package__):
            space[name] = FunctionType(
                function.__code__,
                space,
                name,
                function.__defaults__,
                function.__closure__,
            )
    return space


class PlainTracker(HuntingTracker):
    """`HuntingTracker` with its inner loop as plain Python: what runs without a compiler."""

    def __init__(self, config: TrackerConfig | None = None) -> None:
        super().__init__(config)
        self._parts = plain_parts()

    def _memory(self) -> at.Tracker:
        return zeros(at.Tracker, compiled=False)

    def _run(self, *block_of_samples: Any) -> None:
        self._parts['track_block'](self._tracker, self._modes, *block_of_samples)


class ReferenceTracker(PlainTracker):
    """`HuntingTracker` on `filterpy.kalman.KalmanFilter`, Labbe's textbook form."""

    def __init__(self, config: TrackerConfig | None = None) -> None:
        super().__init__(config)
        size = self._filter.states
        self._kf = KalmanFilter(dim_x=size, dim_z=1)
        self._kf.Q = np.zeros((size, size))
        self._read: dict[int, _F] = {}  # H of each filter
        for name in ('predict', 'turn_lines', 'diffuse', 'aim', 'project', 'correct'):
            self._parts[name] = getattr(self, f'_{name}')

    def _load(self, f: at.Filter) -> None:
        self._kf.x = f.x[: f.states].reshape(-1, 1).copy()
        self._kf.P = f.P[: f.states, : f.states].copy()

    def _store(self, f: at.Filter, x: _F) -> None:
        f.x[: f.states], f.P[: f.states, : f.states] = x, self._kf.P

    def _predict(self, f: at.Filter, dt: float) -> None:
        moved, F = transition(f, dt)
        self._load(f)
        self._kf.predict(F=F)
        self._store(f, moved)

    def _turn_lines(self, f: at.Filter, angle: float) -> None:
        F = turning(f, angle - f.angle)
        f.angle = angle
        self._load(f)
        self._kf.P = F @ self._kf.P @ F.T
        f.P[: f.states, : f.states] = self._kf.P

    def _diffuse(self, f: at.Filter, dt: float) -> None:
        f.P[: f.states, : f.states] += process_noise(f, dt)

    def _aim(self, f: at.Filter, k: int) -> None:
        read, H = measurement(f, k)
        self._read[id(f)] = H
        first, lines = at.BIAS + f.sensor_count + 2 * k * f.line_count, 2 * f.line_count
        f.row.place[:lines] = np.arange(first, first + lines)
        others = [p for p in np.flatnonzero(read[0]) if not first <= p < first + lines]
        f.row.direct = f.row.count = lines + len(others)
        f.row.place[lines : f.row.count] = others
        f.row.value[lines : f.row.count] = read[0, others]

    def _project(self, f: at.Filter) -> float:
        H = self._read[id(f)]
        self._load(f)
        return float((H @ self._kf.P @ H.T)[0, 0])

    def _correct(self, f: at.Filter, innovation: float, S: float) -> None:
        H = self._read[id(f)]
        self._load(f)
        noise = S - float((H @ self._kf.P @ H.T)[0, 0])
        value = innovation + float((H @ self._kf.x)[0, 0])
        self._kf.update(value, R=noise, H=H)
        self._store(f, self._kf.x[:, 0])


def _turn(value: complex) -> _F:
    """Multiplication by a complex number as a real matrix."""
    return np.array([[value.real, -value.imag], [value.imag, value.real]])


def transition(f: at.Filter, dt: float) -> tuple[_F, _F]:
    """Return f(x) and its Jacobian F, shapes (n,) and (n, n)."""
    omega, growth = f.x[at.OMEGA], f.x[at.GROWTH]
    first = _turn(complex(np.exp((growth + 1j * omega) * dt)))
    second = _turn(complex(np.exp((-f.mode.decay2 + 1j * f.mode.omega2) * dt)))
    keep = math.exp(-dt / algebra.REVERSION)
    F = np.eye(f.states)
    for k in range(2):
        z, w = at.Z + 2 * k, at.W + 2 * k
        F[z : z + 2, z : z + 2] = first
        F[w : w + 2, w : w + 2] = second
    F[at.OMEGA, at.OMEGA] = F[at.GROWTH, at.GROWTH] = keep
    moved: _F = F @ f.x[: f.states]
    moved[at.OMEGA] += (1.0 - keep) * f.mode.omega
    for k in range(2):
        z = at.Z + 2 * k
        power, doubt = moved[z] ** 2 + moved[z + 1] ** 2, f.P[z, z] + f.P[z + 1, z + 1]
        share = power / (power + doubt) if power > 2.0 * doubt else 0.0
        a, b = moved[z] * dt * share, moved[z + 1] * dt * share
        F[z : z + 2, at.OMEGA] = -b, a
        F[z : z + 2, at.GROWTH] = a, b
    return moved, F


def turning(f: at.Filter, turned: float) -> _F:
    """Add the slips to the angles of the lines; return the Jacobian, shape (n, n)."""
    F = np.eye(f.states)
    if not math.isfinite(turned):
        return F
    count = f.line_count
    first = f.states - f.slip_count
    for j in range(f.slip_count):
        f.slips[j].turned += f.x[first + j] * turned
    for j, known in enumerate(f.lines[:count]):
        for k in range(f.sensor_count):
            own = at.BIAS + f.sensor_count + 2 * (k * count + j)
            part = slice(own, own + 2)
            power, doubt = f.x[part] @ f.x[part], np.trace(f.P[part, part])
            if known.slip >= 0 and power > 2.0 * doubt:
                share = known.order * turned * power / (power + doubt)
                F[part, first + known.slip] = _turn(-1j) @ f.x[part] * share
    return F


def _rank_one(variance: float, ratio: complex, spread: float) -> _F:
    """Covariance of (u, (ratio + e) u), u complex and isotropic, shape (4, 4)."""
    shape = np.vstack([np.eye(2), _turn(ratio)])
    covariance: _F = variance * shape @ shape.T
    covariance[2:, 2:] += 2.0 * variance * spread * np.eye(2)
    return covariance


def process_noise(f: at.Filter, dt: float) -> _F:
    """Return Q for a step of dt seconds, shape (n, n)."""
    Q = np.zeros((f.states, f.states))
    sensors = f.sensors[: f.sensor_count]
    alive = np.array([sensor.alive for sensor in sensors])
    speaking = np.array([_speaks(f, k) for k in range(f.sensor_count)])
    heard = speaking if speaking.any() else alive
    density = np.array([sensor.noise * sensor.spacing for sensor in sensors])
    ratio = complex(f.rho_re, f.rho_im)
    spread = f.rho_var
    size = abs(ratio) ** 2 + 2.0 * spread
    seen = np.array([(s.unit * f.x[at.OMEGA] ** s.derivative) ** 2 for s in sensors])
    lateral = np.array([sensor.coordinate == 0 for sensor in sensors])
    informs = np.divide(seen, density, out=np.zeros(seen.size), where=heard)
    information = float(informs[lateral].sum())
    if not information or abs(ratio) ** 2 > 2.0 * spread:
        information += size * float(informs[~lateral].sum())
    q = math.exp(2.0 * f.log_bandwidth) / information * dt
    z, w = slice(at.Z, at.Z + 4), slice(at.W, at.W + 4)
    Q[z, z] = _rank_one(q, ratio, spread)
    second = complex(f.mode.rho2_re, f.mode.rho2_im)
    free = math.isnan(second.real)
    Q[w, w] = _rank_one(q, 0j, 0.5 * size) if free else _rank_one(q, second, 0.0)
    pole = complex(-f.mode.decay2, f.mode.omega2)
    unknown = 0.5 * f.mode.std2**2 * abs(pole) ** 2 / (-2.0 * pole.real)
    for side, part in enumerate((slice(at.W, at.W + 2), slice(at.W + 2, at.W + 4))):
        power = f.x[part] @ f.x[part] + np.trace(f.P[part, part] + Q[part, part])
        own = f.coordinates[side]
        left = own.second_left * math.exp(2.0 * (1.0 - f.mode.std2) * pole.real * dt)
        own.second_left = min(left, power)
        Q[part, part] += unknown * dt * own.second_left * np.eye(2)
    drift = 0.5 * at.RATIO_FLOOR**2 * dt * (f.x[2] ** 2 + f.x[3] ** 2)
    Q[2, 2] += drift
    Q[3, 3] += drift
    Q[at.OMEGA, at.OMEGA] = at.OMEGA_DRIFT**2 * dt
    growing = at.GROWTH_DRIFT**2 + 0.25 * f.x[at.GROWTH] ** 2
    Q[at.GROWTH, at.GROWTH] = growing * dt
    for k in np.flatnonzero(alive):
        sensor = f.sensors[k]
        walk = density[k] * dt
        Q[at.BIAS + k, at.BIAS + k] = math.exp(2.0 * sensor.log_bias_bandwidth) * walk
        bandwidths = np.array([line.log_bandwidth for line in sensor.lines[: f.line_count]])
        rough = np.exp(2.0 * bandwidths) * walk * sensor.angle_known
        places = at.BIAS + f.sensor_count + 2 * k * rough.size + np.arange(2 * rough.size)
        Q[places, places] = np.repeat(rough, 2)
        if sensor.scale >= 0:
            places = sensor.scale + np.arange(2)
            scale = np.full(2, algebra.SCALE_STD**2)
            new = 2.0 * scale * dt / algebra.SCALE_TIME
            Q[places, places] = np.where(f.P[places, places] < scale, new, 0.0)
    places = f.states - f.slip_count + np.arange(f.slip_count)
    variance = np.array([slip.deviation**2 for slip in f.slips[: f.slip_count]])
    new = 2.0 * variance * dt / algebra.REVERSION
    Q[places, places] = np.where(f.P[places, places] < variance, new, 0.0)
    return Q


def measurement(f: at.Filter, k: int) -> tuple[_F, _F]:
    """Return what makes the expected reading of a bin of sensor k of x, and H of it, (1, n)."""
    sensor, x = f.sensors[k], f.x[: f.states]
    H, n = np.zeros((1, f.states)), sensor.derivative
    z, w = at.Z + 2 * sensor.coordinate, at.W + 2 * sensor.coordinate
    pole, second = complex(x[at.GROWTH], x[at.OMEGA]), complex(-f.mode.decay2, f.mode.omega2)
    phasor = complex(x[z], x[z + 1])
    scale = 1.0 + (complex(x[sensor.scale], x[sensor.scale + 1]) if sensor.scale >= 0 else 0.0)
    for place, factor in (
        (z, f.row.averaged * scale * sensor.unit * pole**n),
        (w, sensor.unit * second**n),
    ):
        H[0, place], H[0, place + 1] = factor.real, -factor.imag
    H[0, at.BIAS + k] = 1.0
    count = 2 * f.line_count
    first = at.BIAS + f.sensor_count + k * count
    H[0, first : first + count] = f.row.value[:count]
    reading = H.copy()
    sure = f.row.averaged * _known(f, z) * sensor.unit
    if n > 0:
        slope = sure * scale * n * pole ** (n - 1) * phasor
        H[0, at.GROWTH], H[0, at.OMEGA] = slope.real, -slope.imag
    if sensor.scale >= 0:
        seen = sure * pole**n * phasor
        H[0, sensor.scale], H[0, sensor.scale + 1] = seen.real, -seen.imag
    return reading, H
