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

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled
from hunt_ros.identification.path import Path

#: Number of parameters behind those of the law: how ln Q changes with u and with w, then
#: ln Q (at u = w = 0), ln R and the log of the phase noise.
NOISE_TERMS = 5

#: Longest step of the integration relative to the fastest rate met, 1: where the law changes
#: the number of steps, the likelihood jumps by its error, here below a hundredth.
_STEP = 0.3
#: Largest w = (A / A_ref)^2 the law is evaluated at: beyond it a trial law may blow up.
_LARGEST = 25.0


@compiled
def _rate(p: NDArray[np.float64], u: float, w: float, b: float) -> float:
    """Growth rate beside a line of power b; p[7] tells the conicity law from the polynomial."""
    rate: float = p[0] + (p[1] + p[2] * u) * u
    cubic = w + 2.0 * b
    quintic = w * w + (6.0 * w + 3.0 * b) * b
    if p[7] > 0.5:
        conicity = cubic + p[5] * quintic
        rate += (p[3] + p[4] * u + p[6] * conicity) * conicity
    else:
        rate += (p[3] + p[4] * u) * cubic + (p[5] + p[6] * u) * quintic
    return rate


@compiled
def _slope(p: NDArray[np.float64], u: float, w: float, b: float) -> float:
    """Derivative of the growth rate by ln A."""
    quintic = 2.0 * w + 6.0 * b
    if p[7] > 0.5:
        conicity = w + 2.0 * b + p[5] * (w * w + (6.0 * w + 3.0 * b) * b)
        steep = 2.0 * w * (1.0 + p[5] * quintic)
        slope: float = (p[3] + p[4] * u + 2.0 * p[6] * conicity) * steep
    else:
        slope = 2.0 * w * (p[3] + p[4] * u + (p[5] + p[6] * u) * quintic)
    return slope


@compiled
def _propagate(
    p: NDArray[np.float64], u0: float, u1: float, dt: float, log_amplitude: float, b: float
) -> tuple[float, float]:
    """Carry ln A over dt while u goes from u0 to u1; also the integral of the slope."""
    w = min(math.exp(2.0 * log_amplitude), _LARGEST)
    fastest = abs(_slope(p, u0, w, b)) + 2.0 * abs(_rate(p, u0, w, b))
    count = int(min(max(math.ceil(dt * fastest / _STEP), 2.0), 60.0))
    h = dt / count
    du = (u1 - u0) / count
    total = 0.0
    # In w instead of ln A: no exponential in the inner loop.
    for i in range(count):
        ua = u0 + i * du
        ub = ua + 0.5 * du
        uc = ua + du
        k1 = 2.0 * w * _rate(p, ua, w, b)
        w2 = min(max(w + 0.5 * h * k1, 0.0), _LARGEST)
        k2 = 2.0 * w2 * _rate(p, ub, w2, b)
        w3 = min(max(w + 0.5 * h * k2, 0.0), _LARGEST)
        k3 = 2.0 * w3 * _rate(p, ub, w3, b)
        w4 = min(max(w + h * k3, 0.0), _LARGEST)
        k4 = 2.0 * w4 * _rate(p, uc, w4, b)
        slope = _slope(p, ua, w, b) + 2.0 * (_slope(p, ub, w2, b) + _slope(p, ub, w3, b))
        w = min(max(w + h * (k1 + 2.0 * (k2 + k3) + k4) / 6.0, 1e-18), _LARGEST)
        total += h * (slope + _slope(p, uc, w4, b)) / 6.0
    return 0.5 * math.log(w), total


@compiled
def _innovations(
    p: NDArray[np.float64],
    noise: NDArray[np.float64],
    time: NDArray[np.float64],
    u: NDArray[np.float64],
    real: NDArray[np.float64],
    imag: NDArray[np.float64],
    line: NDArray[np.float64],
    starts: NDArray[np.bool_],
    window: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Fill out[k] = whitened radial and tangential innovation, and the log of their variances."""
    r = math.exp(noise[3])
    jitter = math.exp(noise[4])
    blur, reach, shared = window[0], window[1], window[2]
    # Windows overlap: n_k = e_k + shared e_{k-1}. The last e is part of the state: its
    # estimate, its variances, and its covariances with the amplitude.
    fresh = r / (1.0 + shared * shared)
    a_re = a_im = p_r = p_t = 0.0
    e_re = e_im = v_r = v_t = x_r = x_t = 0.0
    last = 0
    for k in range(time.size):
        out[k, 0] = 0.0
        out[k, 1] = 0.0
        out[k, 2] = 0.0
        out[k, 3] = 0.0
        if not math.isfinite(real[k]):
            continue
        if starts[k]:
            seen = max(math.sqrt(real[k] * real[k] + imag[k] * imag[k]), 1e-9)
            sharp = 1.0 / _blurred(p, u[k], seen, line[k], blur)
            sharp = 1.0 / _blurred(p, u[k], seen * sharp, line[k], blur)
            a_re = real[k] * sharp
            a_im = imag[k] * sharp
            p_r = r
            p_t = r
            e_re = e_im = 0.0
            v_r = v_t = fresh
            x_r = x_t = -fresh
            last = k
            continue
        dt = time[k] - time[last]
        amplitude = max(math.sqrt(a_re * a_re + a_im * a_im), 1e-9)
        c = a_re / amplitude
        s = a_im / amplitude
        before = math.log(amplitude)
        # How much of the forcing reaches the mode changes with speed and amplitude.
        near = min(amplitude * amplitude, 2.0)
        push = noise[2] + noise[0] * 0.5 * (u[last] + u[k]) + noise[1] * near
        q = math.exp(min(max(push, -40.0), 10.0))
        x, slope = _propagate(p, u[last], u[k], dt, before, 0.5 * (line[last] + line[k]))
        grown = x - before
        # Sensitivities: along the radius it is that of the amplitude, across it that of the turn.
        log_r = max(min(grown + slope, 20.0), -40.0)
        log_t = max(min(grown, 20.0), -40.0)
        amplitude = math.exp(x)
        p_r = math.exp(2.0 * log_r) * p_r + q * dt * _mean_exp(2.0 * log_r)
        p_t = math.exp(2.0 * log_t) * p_t + q * dt * _mean_exp(2.0 * log_t)
        turning = jitter * amplitude * amplitude
        p_t += turning * dt
        gain = _blurred(p, u[k], amplitude, line[k], blur)
        i_r = c * real[k] + s * imag[k] - gain * amplitude - shared * (c * e_re + s * e_im)
        i_t = c * imag[k] - s * real[k] - shared * (c * e_im - s * e_re)
        # A window smooths the random motion inside it: the variance it takes away counts
        # as noise below zero (exact for a random walk, and in the limit of fast return).
        less_r = 0.5 * reach * q / (1.0 + reach * max(-log_r / dt, 0.0))
        less_t = 0.5 * reach * (q + turning) / (1.0 + reach * max(-log_t / dt, 0.0))
        x_r *= shared * math.exp(log_r)
        x_t *= shared * math.exp(log_t)
        noise_r = shared * shared * v_r + fresh
        noise_t = shared * shared * v_t + fresh
        s_r = max(p_r + 2.0 * x_r + noise_r - less_r, 0.1 * p_r + 0.01 * r)
        s_t = max(p_t + 2.0 * x_t + noise_t - less_t, 0.1 * p_t + 0.01 * r)
        out[k, 0] = i_r / math.sqrt(s_r)
        out[k, 1] = i_t / math.sqrt(s_t)
        out[k, 2] = math.log(s_r)
        out[k, 3] = math.log(s_t)
        k_r = (p_r + x_r) / s_r
        k_t = (p_t + x_t) / s_t
        along = amplitude + k_r * i_r
        across = k_t * i_t
        a_re = c * along - s * across
        a_im = s * along + c * across
        along = fresh / s_r * i_r
        across = fresh / s_t * i_t
        e_re = c * along - s * across
        e_im = s * along + c * across
        x_r = -k_r * fresh
        x_t = -k_t * fresh
        v_r = fresh - fresh * fresh / s_r
        v_t = fresh - fresh * fresh / s_t
        p_r -= k_r * k_r * s_r
        p_t -= k_t * k_t * s_t
        last = k


@compiled
def _blurred(p: NDArray[np.float64], u: float, amplitude: float, b: float, blur: float) -> float:
    """How much larger a window shows an amplitude that bends: 1 + sigma^2 A'' / 2 A."""
    w = min(amplitude * amplitude, _LARGEST)
    rate = _rate(p, u, w, b)
    bend = 0.5 * blur * rate * (rate + _slope(p, u, w, b))
    return 1.0 + max(min(bend, 0.5), -0.3)


@compiled
def _mean_exp(x: float) -> float:
    """Return (exp(x) - 1) / x, the mean of the exponential over the step."""
    if abs(x) < 1e-4:
        return 1.0 + 0.5 * x
    return (math.exp(x) - 1.0) / x


def innovations(theta: NDArray[np.float64], path: Path) -> NDArray[np.float64]:
    """
    Whitened innovations and log variances along a path.

    Parameters
    ----------
    theta : ndarray, shape (6 + 5,) or (7 + 5,)
        Growth law p, then d ln Q / du and d ln Q / dw, ln Q and ln R (in units of
        A_ref^2 / s and A_ref^2) and the log of the phase noise (rad^2 / s).
    path : Path
        The measured envelope.

    Returns
    -------
    ndarray, shape (n, 4)
        Radial and tangential innovation over its standard deviation, then the two log
        variances; zeros where a sample carries no information.
    """
    law = np.zeros(8)
    law[: theta.size - NOISE_TERMS] = theta[:-NOISE_TERMS]
    law[7] = float(path.conicity)
    out = np.empty((path.time.size, 4))
    _innovations(
        law,
        np.ascontiguousarray(theta[-NOISE_TERMS:]),
        path.time,
        path.u,
        np.ascontiguousarray(path.phasor.real),
        np.ascontiguousarray(path.phasor.imag),
        np.zeros(path.time.size) if path.line is None else path.line,
        path.starts,
        np.array([path.blur, path.reach, _shared(path.overlap)]),
        out,
    )
    return out


def _shared(correlation: float) -> float:
    """Coefficient b of the moving average e_k + b e_{k-1} of a correlation b / (1 + b^2)."""
    if correlation == 0.0:
        return 0.0
    return (1.0 - math.sqrt(1.0 - 4.0 * correlation**2)) / (2.0 * correlation)
