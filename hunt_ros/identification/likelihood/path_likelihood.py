"""
How likely a measured envelope is under the growth law: the inner loop of the fit.

    dz = z g(v, |z|) dt + sqrt(Q) dW,     y_k = z_k + sqrt(R) n_k

Between two samples amplitude and its sensitivity follow the growth law (`_propagate`), and a
window shows it as large as `_blurred` says; at each sample a radial and a tangential Kalman step
compare it with the measurement. Without process noise (Q = 0) this is the trajectory fit by
nonlinear least squares with a free initial amplitude for each segment; with it the random walk
that throws a rig out of the quiet state, and the quiet motion before, are part of the model, so
that nothing is selected by its outcome; `Path.beyond` is an error of the law in each step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import B1, C1, F1, F2, F3, I1, compiled, compiled_part
from hunt_ros.dynamics.growth_law import TERMS, growth_at
from hunt_ros.identification.likelihood.path import Path

Array = NDArray[np.float64]
#: Number of all parameters. Behind those of the law: how ln Q changes with u and with w, then
#: ln Q (at u = w = 0), ln R and the log of the phase noise.
ALL_TERMS = TERMS + 5
#: Longest step of the integration relative to the fastest rate met, 1: where the law changes
#: the number of steps, the likelihood jumps by its error, here below a hundredth.
_STEP = 0.3
#: Least and largest w = (A / A_ref)^2 the law is evaluated at: a trial law may blow up.
_SMALLEST, _LARGEST = 1e-18, 25.0


@compiled_part
def _steps(laws: Array, u: float, w: float, line: float, dt: float) -> int:
    """Return how many steps the integration over dt takes, by the first of the laws."""
    rate, by_w = growth_at(laws, 0, u, w, line)
    fastest = abs(2.0 * w * by_w) + 2.0 * abs(rate)
    return int(min(max(math.ceil(dt * fastest / _STEP), 2.0), 60.0))


@compiled_part
def _propagate(
    laws: Array,
    u0: float,
    u1: float,
    dt: float,
    line: float,
    count: int,
    w: Array,
    slope: Array,
    work: Array,
) -> None:
    """Carry w over dt while u goes from u0 to u1; slope is the integral of dg / d ln A."""
    h = dt / count
    du = (u1 - u0) / count
    slope[:] = 0.0
    # In w instead of ln A: no exponential in the inner loop.
    for i in range(count):
        work[0] = w
        work[1:] = 0.0
        for stage in range(4):
            part = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            share = h / 6.0 if stage == 0 or stage == 3 else h / 3.0
            lead = part * h
            at = u0 + (i + part) * du
            for j in range(w.size):
                here = min(max(work[0, j] + lead * work[1, j], 0.0), _LARGEST)
                g, by_w = growth_at(laws, j, at, here, line)
                work[1, j] = 2.0 * here * g
                work[2, j] += share * work[1, j]
                slope[j] += share * 2.0 * here * by_w
        for j in range(w.size):
            w[j] = min(max(work[0, j] + work[2, j], _SMALLEST), _LARGEST)


@compiled_part
def _blurred(laws: Array, k: int, u: float, w: float, line: float, blur: float) -> float:
    """Return how much larger a window shows an amplitude that bends: 1 + sigma^2 A'' / 2 A."""
    w = min(w, _LARGEST)
    rate, by_w = growth_at(laws, k, u, w, line)
    return 1.0 + max(min(0.5 * blur * rate * (rate + 2.0 * w * by_w), 0.5), -0.3)


@compiled_part
def _square(z: complex) -> float:
    return z.real * z.real + z.imag * z.imag


@compiled_part
def _updated(
    log: float,
    dt: float,
    q: float,
    driven: float,
    more: float,
    p: float,
    gain: float,
    left: float,
    r: float,
    reach: float,
    shared: float,
) -> tuple[float, float, float, float]:
    """
    Predict a variance p of the amplitude, or of what is across it, and update it by a window.

    Returns the variance of the innovation, the gains of the amplitude and of the new noise of the
    window, and the variance afterwards.

    Parameters
    ----------
    log, dt : float
        Logarithm of what a deviation grows by on the way, and how long that takes, s.
    q, driven, more : float
        Forcing, forcing and turning, 1/s; further variance.
    p, gain, left : float
        Variance and gains after the window before.
    r, reach, shared : float
        Noise of a window, its reach, s, and the share of that before.
    """
    fresh = r / (1.0 + shared * shared)
    grown = math.expm1(2.0 * log)
    m = (1.0 + grown) * p + more
    m += q * (dt if log == 0.0 else dt * grown / (2.0 * log))
    # Windows overlap: n_k = e_k + shared e_{k-1}, and the last e goes with the amplitude.
    y = -shared * math.sqrt(1.0 + grown) * gain * fresh
    # A window smooths the random motion inside it: the variance it takes away counts as noise
    # below zero (exact for a random walk, and in the limit of fast return).
    less = 0.5 * reach * driven / (1.0 + reach * max(-log / dt, 0.0))
    s = m + 2.0 * y + shared * shared * fresh * (1.0 - left) + fresh - less
    s = max(s, 0.1 * m + 0.01 * r)
    k = (m + y) / s
    return s, k, fresh / s, m - k * k * s


@compiled
def _walk(
    thetas: F2,
    time: F1,
    u: F1,
    phasor: C1,
    line: F1,
    cells: I1,
    beyond: F1,
    starts: B1,
    window: F1,
    out: F3,
) -> None:
    """
    Fill out[i, k] = whitened radial and tangential innovation, and the log of their variances.

    All rows of `thetas` walk side by side, with the steps of the integration that the first one
    needs: their differences hold no error of it.
    """
    blur, reach, shared = window[0], window[1], window[2]
    laws = np.ascontiguousarray(thetas[:, :TERMS].T)
    before, w, slope = np.zeros(len(thetas)), np.zeros(len(thetas)), np.zeros(len(thetas))
    work = np.zeros((3, len(thetas)))
    r, jitter = np.exp(thetas[:, TERMS + 3]), np.exp(thetas[:, TERMS + 4])
    # Of each its amplitude, the last e that it has in common with the next window, variance and
    # gains along the radius and across it.
    amplitudes = np.zeros(thetas.shape[0], dtype=np.complex128)
    common = amplitudes.copy()
    states = np.zeros((thetas.shape[0], 6))
    last = 0
    count = 2
    out[:] = 0.0
    for k in range(time.size):
        if not math.isfinite(phasor[k].real):
            continue
        dt = time[k] - time[last]
        for i in range(thetas.shape[0]):
            laws[0, i] = thetas[i, 0]
            if cells[k] >= 0:
                laws[0, i] += thetas[i, ALL_TERMS + cells[k]]
        if not starts[k]:
            beside = 0.5 * (line[last] + line[k])
            for i in range(thetas.shape[0]):
                before[i] = math.sqrt(max(_square(amplitudes[i]), _SMALLEST))
                w[i] = min(before[i] * before[i], _LARGEST)
            count = _steps(laws, u[last], w[0], beside, dt)
            _propagate(laws, u[last], u[k], dt, beside, count, w, slope, work)
        for i in range(thetas.shape[0]):
            if starts[k]:
                seen = max(_square(phasor[k]), _SMALLEST)
                gain = _blurred(laws, i, u[k], seen, line[k], blur)
                gain = _blurred(laws, i, u[k], seen / (gain * gain), line[k], blur)
                amplitudes[i] = phasor[k] * (1.0 / gain)
                common[i] = 0.0
                states[i, 0] = states[i, 3] = r[i]
                states[i, 1] = states[i, 4] = 1.0
                states[i, 2] = states[i, 5] = 0.0
                continue
            turn = amplitudes[i] * (1.0 / before[i])
            # How much of the forcing reaches the mode changes with speed and amplitude.
            push = thetas[i, TERMS + 2] + thetas[i, TERMS] * u[k]
            push += thetas[i, TERMS + 1] * min(before[i] * before[i], 2.0)
            q = math.exp(min(max(push, -40.0), 10.0))
            amplitude = math.sqrt(w[i])
            # Deviations grow along the radius as the amplitude, and across it as the turn.
            log = math.log(amplitude / before[i])
            turning = jitter[i] * w[i]
            s_r, k_r, f_r, states[i, 0] = _updated(
                max(min(log + slope[i], 20.0), -40.0),
                dt,
                q,
                q,
                beyond[k],
                states[i, 0],
                states[i, 1],
                states[i, 2],
                r[i],
                reach,
                shared,
            )
            s_t, k_t, f_t, states[i, 3] = _updated(
                log,
                dt,
                q,
                q + turning,
                turning * dt,
                states[i, 3],
                states[i, 4],
                states[i, 5],
                r[i],
                reach,
                shared,
            )
            if not (s_r > 0.0 and s_t > 0.0):  # no law of a rig: it has no likelihood
                out[:, k:, :] = math.nan
                return
            off = turn.conjugate() * (phasor[k] - shared * common[i])
            along = off.real - _blurred(laws, i, u[k], w[i], line[k], blur) * amplitude
            out[i, k, 0] = along / math.sqrt(s_r)
            out[i, k, 1] = off.imag / math.sqrt(s_t)
            out[i, k, 2] = math.log(s_r)
            out[i, k, 3] = math.log(s_t)
            amplitudes[i] = turn * complex(amplitude + k_r * along, k_t * off.imag)
            common[i] = turn * complex(f_r * along, f_t * off.imag)
            states[i, 1], states[i, 4] = k_r, k_t
            states[i, 2], states[i, 5] = f_r, f_t
        last = k


def innovations(
    thetas: NDArray[np.float64], path: Path, cells: NDArray[np.int64] | None = None
) -> NDArray[np.float64]:
    """
    Whitened innovations and log variances along a path.

    Parameters
    ----------
    thetas : ndarray, shape (10 + 5 + cells,) or (m, 10 + 5 + cells)
        Growth law p, then d ln Q / du and d ln Q / dw, ln Q and ln R (in units of
        A_ref^2 / s and A_ref^2) and the log of the phase noise (rad^2 / s); then growth rates
        beside the law's, 1/s. Of several, all are integrated as the first one asks for, so that
        small differences between them are right.
    path : Path
        The measured envelope.
    cells : ndarray of int, shape (n,), optional
        Which of these rates holds on the way to each instant; -1: none.

    Returns
    -------
    ndarray, shape (n, 4) or (m, n, 4)
        Radial and tangential innovation over its standard deviation, then the two log
        variances; zeros where a sample carries no information.
    """
    rows = np.ascontiguousarray(np.atleast_2d(thetas))
    out = np.empty((len(rows), path.time.size, 4))
    _walk(
        rows,
        path.time,
        path.u,
        np.ascontiguousarray(path.phasor),
        np.zeros(path.time.size) if path.line is None else path.line,
        np.full(path.time.size, -1) if cells is None else cells,
        path.beyond,
        path.starts,
        np.array([path.blur, path.reach, _shared(path.overlap)]),
        out,
    )
    return out if thetas.ndim > 1 else out[0]


def _shared(correlation: float) -> float:
    """Coefficient b of the moving average e_k + b e_{k-1} of a correlation b / (1 + b^2)."""
    if correlation == 0.0:
        return 0.0
    return (1.0 - math.sqrt(1.0 - 4.0 * correlation**2)) / (2.0 * correlation)
