"""
How likely a measured envelope is under the growth law: the inner loop of the fit.

    dz = z g(v, |z|) dt + sqrt(Q) dW,     y_k = z_k + sqrt(R) n_k

Between two samples amplitude and its sensitivity follow the growth law (`_propagate`), and a
window shows it as large as `_blurred` says; at each sample a radial and a tangential Kalman step
compare it with the measurement. Without process noise (Q = 0) this is the trajectory fit by
nonlinear least squares with a free initial amplitude for each segment; with it the random walk
that throws a rig out of the quiet state, and the quiet motion before, are part of the model, so
that nothing is selected by its outcome; `Path.beyond` is an error of the law in each step. The
derivatives by law and noise are carried along.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import B1, F1, F2, F3, I1, compiled, compiled_part
from hunt_ros.dynamics.growth_law import TERMS, growth_at, terms_at
from hunt_ros.identification.likelihood.path import Path

#: Number of parameters behind those of the law: how ln Q changes with u and with w, then
#: ln Q (at u = w = 0), ln R and the log of the phase noise.
NOISE_TERMS = 5
#: Number of all of them.
ALL_TERMS = TERMS + NOISE_TERMS
#: Longest step of the integration relative to the fastest rate met, 1: where the law changes
#: the number of steps, the likelihood jumps by its error, here below a hundredth.
_STEP = 0.3
#: Growth over one step by which derivatives are taken.
_DIFFERENCE = 1e-4
#: Largest w = (A / A_ref)^2 the law is evaluated at: beyond it a trial law may blow up.
_LARGEST = 25.0


@compiled_part
def _propagate(
    p: NDArray[np.float64],
    u0: float,
    u1: float,
    dt: float,
    log_amplitude: float,
    line: float,
    sensitive: bool,
    work: NDArray[np.float64],
) -> tuple[float, float, float, float]:
    """
    Carry ln A over dt while u goes from u0 to u1.

    Returns ln A, the integral of the derivative of the growth rate by ln A, and the derivatives
    of both by the first ln A; rows 0 and 1 of `work` are filled with those by the coefficients.
    """
    w = min(math.exp(2.0 * log_amplitude), _LARGEST)
    rate, by_w, _ = growth_at(p, u0, w, line)
    fastest = abs(2.0 * w * by_w) + 2.0 * abs(rate)
    count = int(min(max(math.ceil(dt * fastest / _STEP), 2.0), 60.0))
    h = dt / count
    du = (u1 - u0) / count
    total = 0.0
    # By the start: of w and of the integral; by each coefficient: rows of work.
    dw0 = 2.0 * w
    dt0 = 0.0
    if sensitive:
        work[:, :] = 0.0
    # In w instead of ln A: no exponential in the inner loop.
    for i in range(count):
        start = w
        d_start = dw0
        moved = 0.0
        d_moved = 0.0
        bent = 0.0
        d_bent = 0.0
        k = 0.0
        dk = 0.0
        if sensitive:
            for j in range(TERMS):
                work[2, j] = 0.0
                work[3, j] = 0.0
                work[4, j] = 0.0
        for stage in range(4):
            lead = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
            share = 1.0 if stage == 0 or stage == 3 else 2.0
            at = u0 + (i + (0.0 if stage == 0 else (1.0 if stage == 3 else 0.5))) * du
            here = start + lead * k
            inside = 1e-18 < here < _LARGEST
            here = min(max(here, 0.0), _LARGEST)
            g, gw, gww = growth_at(p, at, here, line)
            dk_before = dk
            k = 2.0 * here * g
            moved += share * k
            bent += share * 2.0 * here * gw
            if sensitive:
                by_w = 2.0 * (g + here * gw)
                bent_by_w = 2.0 * (gw + here * gww)
                d_here = d_start + lead * dk_before if inside else 0.0
                dk = by_w * d_here
                d_moved += share * dk
                d_bent += share * bent_by_w * d_here
                terms_at(p, at, here, line, work[5], work[6])
                for j in range(TERMS):
                    d_j = work[7, j] + lead * work[2, j] if inside else 0.0
                    work[2, j] = by_w * d_j + 2.0 * here * work[5, j]
                    work[3, j] += share * work[2, j]
                    work[4, j] += share * (bent_by_w * d_j + 2.0 * here * work[6, j])
        total += h * bent / 6.0
        new = start + h * moved / 6.0
        inside = 1e-18 < new < _LARGEST
        w = min(max(new, 1e-18), _LARGEST)
        if sensitive:
            dt0 += h * d_bent / 6.0
            dw0 = d_start + h * d_moved / 6.0 if inside else 0.0
            for j in range(TERMS):
                work[1, j] += h * work[4, j] / 6.0
                work[7, j] = work[7, j] + h * work[3, j] / 6.0 if inside else 0.0
    if sensitive:
        for j in range(TERMS):
            work[0, j] = 0.5 * work[7, j] / w
    return 0.5 * math.log(w), total, 0.5 * dw0 / w, dt0


@compiled_part
def _blurred(
    p: NDArray[np.float64],
    u: float,
    amplitude: float,
    line: float,
    blur: float,
    sensitive: bool,
    work: NDArray[np.float64],
) -> tuple[float, float]:
    """
    How much larger a window shows an amplitude that bends: 1 + sigma^2 A'' / 2 A.

    Also its derivative by the amplitude; those by the coefficients fill row 0 of `work`.
    """
    w = min(amplitude * amplitude, _LARGEST)
    rate, by_w, twice = growth_at(p, u, w, line)
    both = rate + 2.0 * w * by_w
    bend = 0.5 * blur * rate * both
    by_amplitude = 0.0
    if sensitive:
        if -0.3 < bend < 0.5:
            change = by_w * both + rate * (3.0 * by_w + 2.0 * w * twice)
            by_amplitude = 0.5 * blur * change * 2.0 * amplitude
            terms_at(p, u, w, line, work[5], work[6])
            for j in range(TERMS):
                more = work[5, j] + 2.0 * w * work[6, j]
                work[0, j] = 0.5 * blur * (work[5, j] * both + rate * more)
        else:
            for j in range(TERMS):
                work[0, j] = 0.0
    return 1.0 + max(min(bend, 0.5), -0.3), by_amplitude


@compiled_part
def _mean_exp(x: float) -> tuple[float, float]:
    """Return (exp(x) - 1) / x, the mean of the exponential over the step, and its derivative."""
    if abs(x) < 1e-4:
        return 1.0 + 0.5 * x, 0.5 + x / 3.0
    power = math.exp(x)
    mean = (power - 1.0) / x
    return mean, (power - mean) / x


@compiled
def _walk(
    theta: F1,
    time: F1,
    u: F1,
    real: F1,
    imag: F1,
    line: F1,
    extra: F1,
    beyond: F1,
    starts: B1,
    window: F1,
    lanes: I1,
    out: F2,
    by: F3,
) -> None:
    """
    Fill out[k] = whitened radial and tangential innovation, and the log of their variances.

    `by` is filled with the derivatives by the parameters whose numbers are in `lanes`.
    """
    p = theta[:TERMS].copy()
    noise = theta[TERMS:]
    r = math.exp(noise[3])
    jitter = math.exp(noise[4])
    blur, reach, shared = window[0], window[1], window[2]
    sensitive = lanes.size > 0
    work = np.zeros((8, TERMS))
    edge = np.zeros((8, TERMS))
    # Derivatives of the state, in the order a_re a_im p_r p_t e_re e_im v_r v_t x_r x_t.
    d = np.zeros((lanes.size, 10))
    # Windows overlap: n_k = e_k + shared e_{k-1}. The last e is part of the state: its
    # estimate, its variances, and its covariances with the amplitude.
    fresh = r / (1.0 + shared * shared)
    a_re = a_im = p_r = p_t = 0.0
    e_re = e_im = v_r = v_t = x_r = x_t = 0.0
    last = 0
    for k in range(time.size):
        out[k, :] = 0.0
        by[:, k, :] = 0.0
        if not math.isfinite(real[k]):
            continue
        p[0] = theta[0] + extra[k]
        if starts[k]:
            seen = max(math.sqrt(real[k] * real[k] + imag[k] * imag[k]), 1e-9)
            gain, _ = _blurred(p, u[k], seen, line[k], blur, sensitive, edge)
            inner = 1.0 / gain
            gain, bend = _blurred(p, u[k], seen * inner, line[k], blur, sensitive, work)
            sharp = 1.0 / gain
            a_re = real[k] * sharp
            a_im = imag[k] * sharp
            p_r = r
            p_t = r
            e_re = e_im = 0.0
            v_r = v_t = fresh
            x_r = x_t = -fresh
            for n in range(lanes.size):
                j = lanes[n]
                change = 0.0
                if j < TERMS:
                    shift = -inner * inner * edge[0, j]
                    change = -sharp * sharp * (work[0, j] + bend * seen * shift)
                own = 1.0 if j == TERMS + 3 else 0.0
                d[n, 0] = real[k] * change
                d[n, 1] = imag[k] * change
                d[n, 2] = d[n, 3] = own * r
                d[n, 4] = d[n, 5] = 0.0
                d[n, 6] = d[n, 7] = own * fresh
                d[n, 8] = d[n, 9] = -own * fresh
            last = k
            continue
        dt = time[k] - time[last]
        before = max(math.sqrt(a_re * a_re + a_im * a_im), 1e-9)
        c = a_re / before
        s = a_im / before
        # How much of the forcing reaches the mode changes with speed and amplitude.
        near = min(before * before, 2.0)
        push = noise[2] + noise[0] * u[k] + noise[1] * near
        q = math.exp(min(max(push, -40.0), 10.0))
        x, slope, x_by, slope_by = _propagate(
            p, u[last], u[k], dt, math.log(before), 0.5 * (line[last] + line[k]), sensitive, work
        )
        grown = x - math.log(before)
        # Sensitivities: along the radius it is that of the amplitude, across it that of the turn.
        log_r = max(min(grown + slope, 20.0), -40.0)
        log_t = max(min(grown, 20.0), -40.0)
        amplitude = math.exp(x)
        pow_r = math.exp(2.0 * log_r)
        pow_t = math.exp(2.0 * log_t)
        mean_r, mean_by_r = _mean_exp(2.0 * log_r)
        mean_t, mean_by_t = _mean_exp(2.0 * log_t)
        turning = jitter * amplitude * amplitude
        m_r = pow_r * p_r + q * dt * mean_r + beyond[k]
        m_t = pow_t * p_t + q * dt * mean_t + turning * dt
        gain, gain_by = _blurred(p, u[k], amplitude, line[k], blur, sensitive, edge)
        n_r = c * e_re + s * e_im
        n_t = c * e_im - s * e_re
        i_r = c * real[k] + s * imag[k] - gain * amplitude - shared * n_r
        i_t = c * imag[k] - s * real[k] - shared * n_t
        # A window smooths the random motion inside it: the variance it takes away counts
        # as noise below zero (exact for a random walk, and in the limit of fast return).
        slow_r = 1.0 + reach * max(-log_r / dt, 0.0)
        slow_t = 1.0 + reach * max(-log_t / dt, 0.0)
        less_r = 0.5 * reach * q / slow_r
        less_t = 0.5 * reach * (q + turning) / slow_t
        keep_r = shared * math.exp(log_r)
        keep_t = shared * math.exp(log_t)
        y_r = keep_r * x_r
        y_t = keep_t * x_t
        s_r = m_r + 2.0 * y_r + shared * shared * v_r + fresh - less_r
        s_t = m_t + 2.0 * y_t + shared * shared * v_t + fresh - less_t
        floor_r = 0.1 * m_r + 0.01 * r
        floor_t = 0.1 * m_t + 0.01 * r
        low_r = s_r < floor_r
        low_t = s_t < floor_t
        s_r = max(s_r, floor_r)
        s_t = max(s_t, floor_t)
        if not (s_r > 0.0 and s_t > 0.0):  # no law of a rig: it has no likelihood
            out[k:, :] = math.nan
            return
        root_r = math.sqrt(s_r)
        root_t = math.sqrt(s_t)
        out[k, 0] = i_r / root_r
        out[k, 1] = i_t / root_t
        out[k, 2] = math.log(s_r)
        out[k, 3] = math.log(s_t)
        k_r = (m_r + y_r) / s_r
        k_t = (m_t + y_t) / s_t
        f_r = fresh / s_r
        f_t = fresh / s_t
        along = amplitude + k_r * i_r
        across = k_t * i_t
        for n in range(lanes.size):
            j = lanes[n]
            d_before = c * d[n, 0] + s * d[n, 1]
            dc = (d[n, 0] - c * d_before) / before
            ds = (d[n, 1] - s * d_before) / before
            d_log = d_before / before
            d_push = 2.0 * noise[1] * before * d_before if before * before < 2.0 else 0.0
            dx = x_by * d_log
            d_slope = slope_by * d_log
            d_gain = 0.0
            d_r = 0.0
            d_jitter = 0.0
            if j < TERMS:
                dx += work[0, j]
                d_slope += work[1, j]
                d_gain = edge[0, j]
            elif j == TERMS:
                d_push += u[k]
            elif j == TERMS + 1:
                d_push += near
            elif j == TERMS + 2:
                d_push += 1.0
            elif j == TERMS + 3:
                d_r = r
            else:
                d_jitter = jitter
            dq = q * d_push if -40.0 < push < 10.0 else 0.0
            d_fresh = d_r / (1.0 + shared * shared)
            d_grown = dx - d_log
            d_log_r = d_grown + d_slope if -40.0 < grown + slope < 20.0 else 0.0
            d_log_t = d_grown if -40.0 < grown < 20.0 else 0.0
            d_amplitude = amplitude * dx
            d_turning = d_jitter * amplitude * amplitude + 2.0 * turning * dx
            dm_r = pow_r * (d[n, 2] + 2.0 * p_r * d_log_r)
            dm_r += dt * (dq * mean_r + 2.0 * q * mean_by_r * d_log_r)
            dm_t = pow_t * (d[n, 3] + 2.0 * p_t * d_log_t)
            dm_t += dt * (dq * mean_t + 2.0 * q * mean_by_t * d_log_t + d_turning)
            d_gain += gain_by * d_amplitude
            dn_r = dc * e_re + c * d[n, 4] + ds * e_im + s * d[n, 5]
            dn_t = dc * e_im + c * d[n, 5] - ds * e_re - s * d[n, 4]
            di_r = dc * real[k] + ds * imag[k] - d_gain * amplitude - gain * d_amplitude
            di_r -= shared * dn_r
            di_t = dc * imag[k] - ds * real[k] - shared * dn_t
            d_slow_r = -reach * d_log_r / dt if log_r < 0.0 else 0.0
            d_slow_t = -reach * d_log_t / dt if log_t < 0.0 else 0.0
            d_less_r = (0.5 * reach * dq - less_r * d_slow_r) / slow_r
            d_less_t = (0.5 * reach * (dq + d_turning) - less_t * d_slow_t) / slow_t
            dy_r = keep_r * (d[n, 8] + x_r * d_log_r)
            dy_t = keep_t * (d[n, 9] + x_t * d_log_t)
            if low_r:
                ds_r = 0.1 * dm_r + 0.01 * d_r
            else:
                ds_r = dm_r + 2.0 * dy_r + shared * shared * d[n, 6] + d_fresh - d_less_r
            if low_t:
                ds_t = 0.1 * dm_t + 0.01 * d_r
            else:
                ds_t = dm_t + 2.0 * dy_t + shared * shared * d[n, 7] + d_fresh - d_less_t
            by[n, k, 0] = (di_r - 0.5 * i_r / s_r * ds_r) / root_r
            by[n, k, 1] = (di_t - 0.5 * i_t / s_t * ds_t) / root_t
            by[n, k, 2] = ds_r / s_r
            by[n, k, 3] = ds_t / s_t
            dk_r = (dm_r + dy_r - k_r * ds_r) / s_r
            dk_t = (dm_t + dy_t - k_t * ds_t) / s_t
            df_r = (d_fresh - f_r * ds_r) / s_r
            df_t = (d_fresh - f_t * ds_t) / s_t
            d_along = d_amplitude + dk_r * i_r + k_r * di_r
            d_across = dk_t * i_t + k_t * di_t
            d[n, 0] = dc * along + c * d_along - ds * across - s * d_across
            d[n, 1] = ds * along + s * d_along + dc * across + c * d_across
            d[n, 2] = dm_r - 2.0 * k_r * dk_r * s_r - k_r * k_r * ds_r
            d[n, 3] = dm_t - 2.0 * k_t * dk_t * s_t - k_t * k_t * ds_t
            d_along = df_r * i_r + f_r * di_r
            d_across = df_t * i_t + f_t * di_t
            d[n, 4] = dc * f_r * i_r + c * d_along - ds * f_t * i_t - s * d_across
            d[n, 5] = ds * f_r * i_r + s * d_along + dc * f_t * i_t + c * d_across
            d[n, 6] = d_fresh - df_r * fresh - f_r * d_fresh
            d[n, 7] = d_fresh - df_t * fresh - f_t * d_fresh
            d[n, 8] = -dk_r * fresh - k_r * d_fresh
            d[n, 9] = -dk_t * fresh - k_t * d_fresh
        a_re = c * along - s * across
        a_im = s * along + c * across
        along = f_r * i_r
        across = f_t * i_t
        e_re = c * along - s * across
        e_im = s * along + c * across
        x_r = -k_r * fresh
        x_t = -k_t * fresh
        v_r = fresh - fresh * f_r
        v_t = fresh - fresh * f_t
        p_r = m_r - k_r * k_r * s_r
        p_t = m_t - k_t * k_t * s_t
        last = k


def innovations(theta: NDArray[np.float64], path: Path) -> NDArray[np.float64]:
    """
    Whitened innovations and log variances along a path.

    Parameters
    ----------
    theta : ndarray, shape (10 + 5,)
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
    return _run(theta, path, np.zeros(0, dtype=np.int64))[0]


def sensitivities(
    theta: NDArray[np.float64], path: Path, free: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Innovations as by `innovations`, and their derivatives.

    Parameters
    ----------
    theta : ndarray, shape (15,)
        Growth law and noise.
    path : Path
        The measured envelope.
    free : ndarray of bool, shape (15,)
        Parameters by which the derivatives are wanted.

    Returns
    -------
    out : ndarray, shape (n, 4)
    by : ndarray, shape (15, n, 4)
        Zeros for what is not free.
    """
    lanes = np.flatnonzero(free).astype(np.int64)
    out, some = _run(theta, path, lanes)
    by = np.zeros((theta.size, *out.shape))
    by[lanes] = some
    return out, by


def by_growth(
    theta: NDArray[np.float64], path: Path, cells: NDArray[np.int64], count: int
) -> NDArray[np.float64]:
    """
    Return the derivatives of the innovations by a growth rate of its own in each cell.

    Parameters
    ----------
    theta : ndarray, shape (15,)
        Growth law and noise.
    path : Path
        The measured envelope.
    cells : ndarray of int, shape (n,)
        Number of the cell through which the way to each instant leads; -1: none.
    count : int
        Number of cells.

    Returns
    -------
    ndarray, shape (count, n, 4)
    """
    by = np.zeros((count, path.time.size, 4))
    for cell in np.unique(cells[cells >= 0]).tolist():
        rate = _DIFFERENCE / max(float(np.ptp(path.time)) / path.time.size, 1e-9)
        extra = np.where(cells == cell, rate, 0.0)
        above, below = (innovations(theta, replace(path, extra=x)) for x in (extra, -extra))
        by[cell] = (above - below) / (2.0 * rate)
    return by


def _run(
    theta: NDArray[np.float64], path: Path, lanes: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    out = np.empty((path.time.size, 4))
    by = np.empty((lanes.size, path.time.size, 4))
    _walk(
        np.ascontiguousarray(theta),
        path.time,
        path.u,
        np.ascontiguousarray(path.phasor.real),
        np.ascontiguousarray(path.phasor.imag),
        np.zeros(path.time.size) if path.line is None else path.line,
        np.zeros(path.time.size) if path.extra is None else path.extra,
        path.beyond,
        path.starts,
        np.array([path.blur, path.reach, _shared(path.overlap)]),
        lanes,
        out,
        by,
    )
    return out, by


def _shared(correlation: float) -> float:
    """Coefficient b of the moving average e_k + b e_{k-1} of a correlation b / (1 + b^2)."""
    if correlation == 0.0:
        return 0.0
    return (1.0 - math.sqrt(1.0 - 4.0 * correlation**2)) / (2.0 * correlation)
