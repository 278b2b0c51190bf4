"""
How likely a measured envelope is under a growth law: the inner loop of the fit.

    dz = z g(v, |z|) dt + sqrt(Q) dW,     y_k = z_k + sqrt(R) n_k

Between two samples amplitude and its sensitivity follow the growth law; at each sample
a radial and a tangential Kalman step compare it with the measurement. Without process
noise (Q = 0) this is the trajectory fit by nonlinear least squares with a free initial
amplitude for each segment; with it the random walk that throws a rig out of the quiet
state, and the quiet motion before, are part of the model, so that nothing is selected
by its outcome.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled

#: Longest step of the integration relative to the fastest rate met, 1.
_STEP = 0.5
#: Largest w = (A / A_ref)^2 the law is evaluated at: beyond it a trial law may blow up.
_LARGEST = 25.0


@compiled
def _rate(p: NDArray[np.float64], u: float, w: float) -> float:
    """Growth rate; p[7] tells the conicity law (1) from the polynomial (0)."""
    rate: float = p[0] + (p[1] + p[2] * u) * u
    if p[7] > 0.5:
        conicity = w * (1.0 + p[5] * w)
        rate += (p[3] + p[4] * u + p[6] * conicity) * conicity
    else:
        rate += (p[3] + p[4] * u) * w + (p[5] + p[6] * u) * w * w
    return rate


@compiled
def _slope(p: NDArray[np.float64], u: float, w: float) -> float:
    """Derivative of the growth rate by ln A."""
    if p[7] > 0.5:
        conicity = w * (1.0 + p[5] * w)
        steep = 2.0 * w * (1.0 + 2.0 * p[5] * w)
        slope: float = (p[3] + p[4] * u + 2.0 * p[6] * conicity) * steep
    else:
        slope = 2.0 * w * (p[3] + p[4] * u + 2.0 * (p[5] + p[6] * u) * w)
    return slope


@compiled
def _propagate(
    p: NDArray[np.float64], u0: float, u1: float, dt: float, log_amplitude: float
) -> tuple[float, float]:
    """Carry ln A over dt while u goes from u0 to u1; also the integral of the slope."""
    w = min(math.exp(2.0 * log_amplitude), _LARGEST)
    fastest = abs(_slope(p, u0, w)) + 2.0 * abs(_rate(p, u0, w))
    count = int(min(max(math.ceil(dt * fastest / _STEP), 2.0), 60.0))
    h = dt / count
    du = (u1 - u0) / count
    total = 0.0
    # In w instead of ln A: no exponential in the inner loop.
    for i in range(count):
        ua = u0 + i * du
        ub = ua + 0.5 * du
        uc = ua + du
        k1 = 2.0 * w * _rate(p, ua, w)
        w2 = min(max(w + 0.5 * h * k1, 0.0), _LARGEST)
        k2 = 2.0 * w2 * _rate(p, ub, w2)
        w3 = min(max(w + 0.5 * h * k2, 0.0), _LARGEST)
        k3 = 2.0 * w3 * _rate(p, ub, w3)
        w4 = min(max(w + h * k3, 0.0), _LARGEST)
        k4 = 2.0 * w4 * _rate(p, uc, w4)
        slope = _slope(p, ua, w) + 2.0 * (_slope(p, ub, w2) + _slope(p, ub, w3))
        w = min(max(w + h * (k1 + 2.0 * (k2 + k3) + k4) / 6.0, 1e-18), _LARGEST)
        total += h * (slope + _slope(p, uc, w4)) / 6.0
    return 0.5 * math.log(w), total


@compiled
def _innovations(
    p: NDArray[np.float64],
    noise: NDArray[np.float64],
    time: NDArray[np.float64],
    u: NDArray[np.float64],
    real: NDArray[np.float64],
    imag: NDArray[np.float64],
    restart: NDArray[np.bool_],
    blur: float,
    reach: float,
    out: NDArray[np.float64],
) -> None:
    """Fill out[k] = whitened radial and tangential innovation, and the log of their variances."""
    q = math.exp(noise[0])
    r = math.exp(noise[1])
    jitter = math.exp(noise[2])
    started = False
    a_re = a_im = p_r = p_t = 0.0
    last = 0
    for k in range(time.size):
        out[k, 0] = 0.0
        out[k, 1] = 0.0
        out[k, 2] = 0.0
        out[k, 3] = 0.0
        if restart[k]:
            started = False
        if not math.isfinite(real[k]):
            continue
        if not started:
            started = True
            seen = max(math.sqrt(real[k] * real[k] + imag[k] * imag[k]), 1e-9)
            sharp = 1.0 / _blurred(p, u[k], seen, blur)
            sharp = 1.0 / _blurred(p, u[k], seen * sharp, blur)
            a_re = real[k] * sharp
            a_im = imag[k] * sharp
            p_r = r
            p_t = r
            last = k
            continue
        dt = time[k] - time[last]
        amplitude = max(math.sqrt(a_re * a_re + a_im * a_im), 1e-9)
        c = a_re / amplitude
        s = a_im / amplitude
        before = math.log(amplitude)
        x, slope = _propagate(p, u[last], u[k], dt, before)
        grown = x - before
        # Sensitivities: along the radius it is that of the amplitude, across it that of the turn.
        log_r = max(min(grown + slope, 20.0), -40.0)
        log_t = max(min(grown, 20.0), -40.0)
        amplitude = math.exp(x)
        p_r = math.exp(2.0 * log_r) * p_r + q * dt * _mean_exp(2.0 * log_r)
        p_t = math.exp(2.0 * log_t) * p_t + q * dt * _mean_exp(2.0 * log_t)
        turning = jitter * amplitude * amplitude
        p_t += turning * dt
        gain = _blurred(p, u[k], amplitude, blur)
        e_r = c * real[k] + s * imag[k] - gain * amplitude
        e_t = c * imag[k] - s * real[k]
        # A window smooths the random motion inside it: the variance it takes away counts
        # as noise below zero (exact for a random walk, and in the limit of fast return).
        r_r = r - 0.5 * reach * q / (1.0 + reach * max(-log_r / dt, 0.0))
        r_t = r - 0.5 * reach * (q + turning) / (1.0 + reach * max(-log_t / dt, 0.0))
        s_r = max(p_r + r_r, 0.1 * p_r + 0.01 * r)
        s_t = max(p_t + r_t, 0.1 * p_t + 0.01 * r)
        out[k, 0] = e_r / math.sqrt(s_r)
        out[k, 1] = e_t / math.sqrt(s_t)
        out[k, 2] = math.log(s_r)
        out[k, 3] = math.log(s_t)
        along = amplitude + p_r / s_r * e_r
        across = p_t / s_t * e_t
        a_re = c * along - s * across
        a_im = s * along + c * across
        p_r = p_r * (1.0 - p_r / s_r)
        p_t = p_t * (1.0 - p_t / s_t)
        last = k


@compiled
def _blurred(p: NDArray[np.float64], u: float, amplitude: float, blur: float) -> float:
    """How much larger a window shows an amplitude that bends: 1 + sigma^2 A'' / 2 A."""
    w = min(amplitude * amplitude, _LARGEST)
    rate = _rate(p, u, w)
    bend = 0.5 * blur * rate * (rate + _slope(p, u, w))
    return 1.0 + max(min(bend, 0.5), -0.3)


@compiled
def _mean_exp(x: float) -> float:
    """Return (exp(x) - 1) / x, the mean of the exponential over the step."""
    if abs(x) < 1e-4:
        return 1.0 + 0.5 * x
    return (math.exp(x) - 1.0) / x


@dataclass(frozen=True, eq=False)
class Path:
    """
    The envelope of all records in a row, in the variables of the fit.

    Parameters
    ----------
    time : ndarray, shape (n,)
        s, rising within each segment.
    u : ndarray, shape (n,)
        v / v_ref - 1.
    phasor : ndarray of complex, shape (n,)
        z / A_ref; NaN where nothing was measured.
    restart : ndarray of bool, shape (n,)
        True where a segment begins: the amplitude there is free.
    cluster : ndarray of int, shape (n,)
        Run or block each instant belongs to, 0-based, for robust variances.
    blur : float
        Variance of the window in which each phasor was measured, s^2.
    reach : float
        Mean distance of two instants of such a window, s.
    conicity : bool
        Whether the law is that of the equivalent conicity.
    weight : ndarray, shape (n,), optional
        What an instant counts, where a law is not to be held to all of them.
    """

    time: NDArray[np.float64]
    u: NDArray[np.float64]
    phasor: NDArray[np.complex128]
    restart: NDArray[np.bool_]
    cluster: NDArray[np.int64]
    blur: float = 0.0
    reach: float = 0.0
    conicity: bool = False
    weight: NDArray[np.float64] | None = None

    @property
    def clusters(self) -> int:
        """Number of clusters."""
        return int(self.cluster.max()) + 1 if self.cluster.size else 0

    def broken_at(self, jumps: NDArray[np.bool_]) -> Path:
        """Return the path with new segments after `jumps`, whose windows are left out."""
        hit = jumps.copy()
        hit[:-1] |= jumps[1:]
        hit[1:] |= jumps[:-1] & ~self.restart[1:]
        after = self.restart.copy()
        after[1:] |= hit[:-1]
        return replace(self, phasor=np.where(hit, np.nan, self.phasor), restart=after)


def innovations(theta: NDArray[np.float64], path: Path) -> NDArray[np.float64]:
    """
    Whitened innovations and log variances along a path.

    Parameters
    ----------
    theta : ndarray, shape (6 + 3,) or (7 + 3,)
        Growth law p, then ln Q, ln R (in units of A_ref^2 / s and A_ref^2) and the log of
        the phase noise (rad^2 / s).
    path : Path
        The measured envelope.

    Returns
    -------
    ndarray, shape (n, 4)
        Radial and tangential innovation over its standard deviation, then the two log
        variances; zeros where a sample carries no information.
    """
    law = np.zeros(8)
    law[: theta.size - 3] = theta[:-3]
    law[7] = float(path.conicity)
    out = np.empty((path.time.size, 4))
    _innovations(
        law,
        np.ascontiguousarray(theta[-3:]),
        path.time,
        path.u,
        np.ascontiguousarray(path.phasor.real),
        np.ascontiguousarray(path.phasor.imag),
        path.restart,
        path.blur,
        path.reach,
        out,
    )
    return out
