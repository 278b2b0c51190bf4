"""
The inner loop of the simulation: wheelset, flange, drive and sensors, sample by sample.

One function that runs as machine code where numba is installed; it draws no
random numbers itself, so the stream of numbers is the same without it.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import F1, F2, compiled, compiled_part

Array = NDArray[np.float64]

# Places in `model`.
(
    STEP,  # integration step, dimensionless
    D11,  # creep damping times the speed scale: divided by v in m/s it is d11 / v*
    D22,
    LATERAL_CREEP,  # d11 = -k12
    K11,
    K21,
    CLEARANCE,  # y* at flange contact
    FLANGE_STIFFNESS,
    FLANGE_DAMPING,
    LOWEST_SPEED,  # m/s, see `simulation`
    LAG,  # share of the way to the set point done in one step
    MOST_CHANGE,  # largest change of speed in one step, m/s
    STEP_S,  # integration step, s
    ANGLE_PER_METRE,  # 2 / D
    LENGTH,  # d0, m
    FORCING,  # white yaw forcing, held over a step
    YAW_LIMIT,  # rad, of the argument of the nonlinear terms
) = range(17)

# Places in `state`.
Y, Y_RATE, PSI, PSI_RATE, SPEED, ANGLE = range(6)


@compiled_part
def _power_terms(y: float, p: float, c: Array) -> float:
    """Cubic and quintic terms; c: 30, 21, 12, 03, 50, 41, 32, 23, 14, 05."""
    p2 = p * p
    third: float = ((c[0] * y + c[1] * p) * y + c[2] * p2) * y + c[3] * p * p2
    fifth: float = ((c[4] * y + c[5] * p) * y + c[6] * p2) * y + c[7] * p * p2
    total: float = third + (fifth * y + c[8] * p2 * p2) * y + c[9] * p * p2 * p2
    return total


@compiled_part
def _slope(angle: float, harmonics: Array) -> float:
    """Direction of rolling, rad, at a roller angle; rows: order, slope amplitude."""
    total = 0.0
    for k in range(harmonics.shape[0]):
        total += harmonics[k, 1] * math.sin(harmonics[k, 0] * angle)
    return total


@compiled_part
def _accelerations(
    y: float,
    y_rate: float,
    psi: float,
    psi_rate: float,
    slowness: float,
    slope: float,
    moment: float,
    model: Array,
    terms: Array,
) -> tuple[float, float]:
    """Eqs. (2), (3) with the flange, rolling direction and yaw forcing added."""
    clearance, limit = model[CLEARANCE], model[YAW_LIMIT]
    # Beyond the flange the tread polynomials describe nothing: hold their argument.
    y_tread = min(max(y, -clearance), clearance)
    psi_tread = min(max(psi, -limit), limit)
    lateral = (
        -model[D11] * slowness * y_rate
        - model[K11] * y
        + model[LATERAL_CREEP] * (psi + slope)
        - _power_terms(y_tread, psi_tread, terms[0])
    )
    yaw = (
        -model[D22] * slowness * psi_rate
        - model[K21] * y
        - psi
        - _power_terms(y_tread, psi_tread, terms[1])
        + moment
    )
    depth = abs(y) - clearance
    if depth > 0.0:
        outward = y_rate if y > 0.0 else -y_rate
        push = model[FLANGE_STIFFNESS] * depth + model[FLANGE_DAMPING] * outward
        if push > 0.0:  # a flange pushes, it does not pull
            lateral -= push if y > 0.0 else -push
    return lateral, yaw


@compiled_part
def _step(
    state: Array,
    target: float,
    moment: float,
    s0: float,
    model: Array,
    terms: Array,
    harmonics: Array,
) -> float:
    """
    Advance the state by one step: classical Runge-Kutta, speed and angle exact on it.

    s0 is the direction of rolling at the start; that at the end is returned.
    """
    h = model[STEP]
    y, a, p, b = state[Y], state[Y_RATE], state[PSI], state[PSI_RATE]
    v0, angle0 = state[SPEED], state[ANGLE]
    change = (target - v0) * model[LAG]
    v1 = v0 + min(max(change, -model[MOST_CHANGE]), model[MOST_CHANGE])
    vm = 0.5 * (v0 + v1)
    angle1 = angle0 + vm * model[STEP_S] * model[ANGLE_PER_METRE]
    sm = _slope(0.5 * (angle0 + angle1), harmonics)
    s1 = _slope(angle1, harmonics)
    lowest = model[LOWEST_SPEED]
    r0, rm, r1 = 1.0 / max(v0, lowest), 1.0 / max(vm, lowest), 1.0 / max(v1, lowest)
    a1, b1 = _accelerations(y, a, p, b, r0, s0, moment, model, terms)
    ya, pa = a + 0.5 * h * a1, b + 0.5 * h * b1
    a2, b2 = _accelerations(y + 0.5 * h * a, ya, p + 0.5 * h * b, pa, rm, sm, moment, model, terms)
    yb, pb = a + 0.5 * h * a2, b + 0.5 * h * b2
    a3, b3 = _accelerations(
        y + 0.5 * h * ya, yb, p + 0.5 * h * pa, pb, rm, sm, moment, model, terms
    )
    yc, pc = a + h * a3, b + h * b3
    a4, b4 = _accelerations(y + h * yb, yc, p + h * pb, pc, r1, s1, moment, model, terms)
    state[Y] = y + h / 6.0 * (a + 2.0 * (ya + yb) + yc)
    state[PSI] = p + h / 6.0 * (b + 2.0 * (pa + pb) + pc)
    state[Y_RATE] = a + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
    state[PSI_RATE] = b + h / 6.0 * (b1 + 2.0 * (b2 + b3) + b4)
    state[SPEED] = v1
    state[ANGLE] = angle1
    return s1


@compiled
def advance(
    state: F1,
    targets: F1,
    forcing: Annotated[Array, 2, 'A'],
    model: F1,
    terms: F2,
    harmonics: F2,
    out: F2,
) -> None:
    """
    Look, then advance, once a sample.

    Parameters
    ----------
    state : ndarray, shape (6,)
        Changed in place.
    targets : ndarray, shape (n,)
        Speed set points, m/s.
    forcing : ndarray, shape (n, substeps)
        Standard normal numbers of the white yaw forcing.
    model : ndarray, shape (17,)
        Numbers at the places named above.
    terms : ndarray, shape (2, 10)
        alpha and beta, as `_power_terms` takes them.
    harmonics : ndarray, shape (k, 2)
        As `_slope` takes them.
    out : ndarray, shape (4, n)
        Filled: speed, m/s; roller angle, rad; lateral motion, m; yaw, rad.
    """
    slope = _slope(state[ANGLE], harmonics)
    for n in range(targets.shape[0]):
        out[0, n], out[1, n] = state[SPEED], state[ANGLE]
        out[2, n], out[3, n] = state[Y] * model[LENGTH], state[PSI]
        for k in range(forcing.shape[1]):
            moment = model[FORCING] * forcing[n, k]
            slope = _step(state, targets[n], moment, slope, model, terms, harmonics)
