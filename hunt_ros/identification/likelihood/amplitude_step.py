"""
The growth law between two samples of an envelope, with its derivatives by every coefficient.

`propagate` carries an amplitude from one sample to the next, and `blurred` says how much larger
the window of a sample shows it. The derivatives are exact for the steps taken.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.identification.growth_law import TERMS, powers_of_w

#: Longest step of the integration relative to the fastest rate met, 1: where the law changes
#: the number of steps, the likelihood jumps by its error, here below a hundredth.
_STEP = 0.3
#: Largest w = (A / A_ref)^2 the law is evaluated at: beyond it a trial law may blow up.
_LARGEST = 25.0


@compiled_part
def _terms(
    p: NDArray[np.float64],
    u: float,
    w: float,
    line: float,
    value: NDArray[np.float64],
    slope: NDArray[np.float64],
) -> None:
    """Fill in the derivatives of growth rate and of its derivative by w, by each coefficient."""
    b = p[10] * line
    m1 = w + 2.0 * b
    m2 = w * w + (6.0 * w + 3.0 * b) * b
    m3 = ((w + 12.0 * b) * w + 18.0 * b * b) * w + 4.0 * b * b * b
    d2 = 2.0 * w + 6.0 * b
    d3 = (3.0 * w + 24.0 * b) * w + 18.0 * b * b
    value[0] = 1.0
    value[1] = u
    value[2] = u * u
    value[3] = m1
    value[4] = u * m1
    value[5] = m2
    value[6] = u * m2
    value[7] = m3
    value[8] = u * u * u
    value[9] = u * u * m1
    slope[0] = slope[1] = slope[2] = slope[8] = 0.0
    slope[3] = 1.0
    slope[4] = u
    slope[5] = d2
    slope[6] = u * d2
    slope[7] = d3
    slope[9] = u * u
    first = p[3] + (p[4] + p[9] * u) * u
    second = p[5] + p[6] * u
    value[10] = line * (
        2.0 * first
        + second * (6.0 * w + 6.0 * b)
        + p[7] * ((12.0 * w + 36.0 * b) * w + 12.0 * b * b)
    )
    slope[10] = line * (6.0 * second + p[7] * (24.0 * w + 36.0 * b))


@compiled_part
def propagate(
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
    c0, c1, c2, c3 = powers_of_w(p, u0, line)
    rate = c0 + (c1 + (c2 + c3 * w) * w) * w
    fastest = abs(2.0 * w * (c1 + (2.0 * c2 + 3.0 * c3 * w) * w)) + 2.0 * abs(rate)
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
            if stage != 2:
                at = u0 + (i + (0.0 if stage == 0 else (1.0 if stage == 3 else 0.5))) * du
                c0, c1, c2, c3 = powers_of_w(p, at, line)
            here = start + lead * k
            inside = 1e-18 < here < _LARGEST
            here = min(max(here, 0.0), _LARGEST)
            g = c0 + (c1 + (c2 + c3 * here) * here) * here
            gw = c1 + (2.0 * c2 + 3.0 * c3 * here) * here
            dk_before = dk
            k = 2.0 * here * g
            moved += share * k
            bent += share * 2.0 * here * gw
            if sensitive:
                gww = 2.0 * c2 + 6.0 * c3 * here
                by_w = 2.0 * (g + here * gw)
                bent_by_w = 2.0 * (gw + here * gww)
                d_here = d_start + lead * dk_before if inside else 0.0
                dk = by_w * d_here
                d_moved += share * dk
                d_bent += share * bent_by_w * d_here
                _terms(p, at, here, line, work[5], work[6])
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
def blurred(
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
    c0, c1, c2, c3 = powers_of_w(p, u, line)
    rate = c0 + (c1 + (c2 + c3 * w) * w) * w
    by_w = c1 + (2.0 * c2 + 3.0 * c3 * w) * w
    both = rate + 2.0 * w * by_w
    bend = 0.5 * blur * rate * both
    by_amplitude = 0.0
    if sensitive:
        if -0.3 < bend < 0.5:
            twice = 2.0 * c2 + 6.0 * c3 * w
            change = by_w * both + rate * (3.0 * by_w + 2.0 * w * twice)
            by_amplitude = 0.5 * blur * change * 2.0 * amplitude
            _terms(p, u, w, line, work[5], work[6])
            for j in range(TERMS):
                more = work[5, j] + 2.0 * w * work[6, j]
                work[0, j] = 0.5 * blur * (work[5, j] * both + rate * more)
        else:
            for j in range(TERMS):
                work[0, j] = 0.0
    return 1.0 + max(min(bend, 0.5), -0.3), by_amplitude
