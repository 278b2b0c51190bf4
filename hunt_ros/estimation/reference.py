"""
The tracker once more, with filterpy's dense matrices: what the kernel is checked against.

The decisions (bins, kicks, self-tuning) are those of the kernel, run as plain Python.
The algebra of the filter is written down anew, from the model in the kernel's
docstring, as matrices F, Q and H for `filterpy.kalman.KalmanFilter`. It gives the same
numbers to rounding, two orders of magnitude slower.
"""

from __future__ import annotations

import math
from importlib.util import module_from_spec, spec_from_file_location
from types import ModuleType
from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

import hunt_ros.compiled
from hunt_ros.estimation import kernel
from hunt_ros.estimation.kalman import HuntingTracker
from hunt_ros.estimation.tracker_config import TrackerConfig

_F = NDArray[np.float64]


def plain_kernel() -> ModuleType:
    """
    Return a copy of `hunt_ros.estimation.kernel` that is not compiled.

    Returns
    -------
    module
        With functions of its own: replacing one of them there leaves the kernel alone.
    """
    spec = spec_from_file_location('hunt_ros.estimation._plain_kernel', kernel.__file__)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    compiler = hunt_ros.compiled.compiled
    hunt_ros.compiled.compiled = lambda function: function
    try:
        spec.loader.exec_module(module)
    finally:
        hunt_ros.compiled.compiled = compiler
    return module


class PlainTracker(HuntingTracker):
    """`HuntingTracker` with its kernel as plain Python: what runs without a compiler."""

    def __init__(self, config: TrackerConfig | None = None) -> None:
        super().__init__(config)
        self._kernel = plain_kernel()

    def _run(self, *block: Any) -> None:
        self._kernel.track_block(self._filter, *block)


class ReferenceTracker(PlainTracker):
    """`HuntingTracker` on `filterpy.kalman.KalmanFilter`, Labbe's textbook form."""

    def __init__(self, config: TrackerConfig | None = None) -> None:
        super().__init__(config)
        self._kf = KalmanFilter(dim_x=kernel.N, dim_z=1)
        self._kf.Q = np.zeros((kernel.N, kernel.N))
        self._row = np.zeros((1, kernel.N))
        for name in ('predict', 'diffuse', 'expected', 'project', 'correct'):
            setattr(self._kernel, name, getattr(self, f'_{name}'))

    def _load(self, f: kernel.Filter) -> None:
        self._kf.x = f.x.reshape(-1, 1).copy()
        self._kf.P = f.P.copy()

    def _predict(self, f: kernel.Filter, dt: float) -> None:
        moved, F = transition(f, dt)
        self._load(f)
        self._kf.predict(F=F)
        f.x[:], f.P[:] = moved, self._kf.P

    def _diffuse(self, f: kernel.Filter, dt: float) -> None:
        f.P[:] += process_noise(f, dt)

    def _expected(self, f: kernel.Filter, k: int, row: _F) -> float:
        self._row = measurement(k, row)
        return float((self._row @ f.x)[0])

    def _project(self, f: kernel.Filter, k: int, row: _F) -> float:
        self._row = measurement(k, row)
        return float((self._row @ f.P @ self._row.T)[0, 0])

    def _correct(self, f: kernel.Filter, innovation: float, S: float) -> None:
        self._load(f)
        noise = S - float((self._row @ f.P @ self._row.T)[0, 0])
        value = innovation + float((self._row @ f.x)[0])
        self._kf.update(value, R=noise, H=self._row)
        f.x[:], f.P[:] = self._kf.x[:, 0], self._kf.P


def _turn(value: complex) -> _F:
    """Multiplication by a complex number as a real matrix."""
    return np.array([[value.real, -value.imag], [value.imag, value.real]])


def transition(f: kernel.Filter, dt: float) -> tuple[_F, _F]:
    """Return f(x) and its Jacobian F, shapes (20,) and (20, 20)."""
    omega, growth = f.x[kernel.OMEGA], f.x[kernel.GROWTH]
    first = _turn(complex(np.exp((growth + 1j * omega) * dt)))
    second = _turn(complex(np.exp((-f.m[kernel.M_DECAY2] + 1j * f.m[kernel.M_OMEGA2]) * dt)))
    keep = math.exp(-dt / kernel.REVERSION)
    F = np.eye(kernel.N)
    for k in range(2):
        z, w = kernel.Z + 2 * k, kernel.W + 2 * k
        F[z : z + 2, z : z + 2] = first
        F[w : w + 2, w : w + 2] = second
    F[kernel.OMEGA, kernel.OMEGA] = F[kernel.GROWTH, kernel.GROWTH] = keep
    moved = F @ f.x
    moved[kernel.OMEGA] += (1.0 - keep) * f.m[kernel.M_OMEGA0]
    for k in range(2):
        z = kernel.Z + 2 * k
        power, doubt = moved[z] ** 2 + moved[z + 1] ** 2, f.P[z, z] + f.P[z + 1, z + 1]
        share = power / (power + doubt) if power > 2.0 * doubt else 0.0
        a, b = moved[z] * dt * share, moved[z + 1] * dt * share
        F[z : z + 2, kernel.OMEGA] = -b, a
        F[z : z + 2, kernel.GROWTH] = a, b
    return moved, F


def _rank_one(variance: float, ratio: complex, spread: float) -> _F:
    """Covariance of (u, (ratio + e) u), u complex and isotropic, shape (4, 4)."""
    shape = np.vstack([np.eye(2), _turn(ratio)])
    covariance: _F = variance * shape @ shape.T
    covariance[2:, 2:] += 2.0 * variance * spread * np.eye(2)
    return covariance


def process_noise(f: kernel.Filter, dt: float) -> _F:
    """Return Q for a step of dt seconds, shape (20, 20)."""
    Q = np.zeros((kernel.N, kernel.N))
    alive = f.sensors[:, kernel.S_ALIVE] > 0.0
    density = f.sensors[:, kernel.S_NOISE] * f.sensors[:, kernel.S_STEP]
    ratio = complex(f.m[kernel.M_RHO_RE], f.m[kernel.M_RHO_IM])
    spread = f.m[kernel.M_RHO_VAR]
    size = abs(ratio) ** 2 + 2.0 * spread
    tied = alive[1] and (not alive[0] or abs(ratio) ** 2 > 2.0 * spread)
    information = (1.0 / density[0] if alive[0] else 0.0) + (size / density[1] if tied else 0.0)
    q = math.exp(2.0 * f.m[kernel.M_LAMBDA]) / information * dt
    z, w = slice(kernel.Z, kernel.Z + 4), slice(kernel.W, kernel.W + 4)
    Q[z, z] = _rank_one(q, ratio, spread)
    second = complex(f.m[kernel.M_RHO2_RE], f.m[kernel.M_RHO2_IM])
    free = math.isnan(second.real)
    Q[w, w] = _rank_one(q, 0j, 0.5 * size) if free else _rank_one(q, second, 0.0)
    drift = 0.5 * f.cfg[kernel.C_RATIO_FLOOR] ** 2 * dt * (f.x[2] ** 2 + f.x[3] ** 2)
    Q[2, 2] += drift
    Q[3, 3] += drift
    Q[kernel.OMEGA, kernel.OMEGA] = f.cfg[kernel.C_OMEGA_DRIFT] ** 2 * dt
    growing = f.cfg[kernel.C_GROWTH_DRIFT] ** 2 + 0.25 * f.x[kernel.GROWTH] ** 2
    Q[kernel.GROWTH, kernel.GROWTH] = growing * dt
    for k in np.flatnonzero(alive):
        sensor = f.sensors[k]
        Q[kernel.BIAS + k, kernel.BIAS + k] = (
            math.exp(2.0 * sensor[kernel.S_LAMBDA_BIAS]) * density[k] * dt
        )
        rough = math.exp(2.0 * sensor[kernel.S_LAMBDA_ROUGH]) * density[k] * dt
        for i in range(kernel.ROUGH + 4 * k, kernel.ROUGH + 4 * k + 4):
            Q[i, i] = rough * sensor[kernel.S_ROLLER]
    return Q


def measurement(k: int, row: _F) -> _F:
    """Return H for a bin of sensor k, shape (1, 20); `row` as in the kernel."""
    H = np.zeros((1, kernel.N))
    H[0, kernel.Z + 2 * k] = row[0]
    H[0, kernel.W + 2 * k] = 1.0
    H[0, kernel.BIAS + k] = 1.0
    H[0, kernel.ROUGH + 4 * k : kernel.ROUGH + 4 * k + 4] = row[1:]
    return H
