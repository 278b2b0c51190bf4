"""The way between a growth law and the normal form, Eq. (24), whose coefficients are given."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.identification.growth_law import (
    PAPER_TERMS,
    QUINTIC,
    GrowthLaw,
    GrowthScales,
    lawful,
)

Array = NDArray[np.float64]

#: What a coefficient may differ from the law's costs so much of an error of ln A on the branches,
#: for a difference as large as the cubic terms.
_LEFT_OPEN = 0.01


def normal_form_of(law: GrowthLaw, low: float, high: float) -> NormalForm | None:
    """
    Normal form of a law: exact for the paper's form, else the nearest on its branches.

    Parameters
    ----------
    law : GrowthLaw
        With or without further terms.
    low, high : float
        Range of speeds over which it shall hold, m/s.

    Returns
    -------
    NormalForm or None
        In the amplitude coordinate; None without a critical speed. D7, D10 and D15
        are effective coefficients over this range.
    """
    p = law.p[:PAPER_TERMS] if law.name == QUINTIC else _nearest_quintic(law, low, high)
    return None if p is None else to_normal_form(p, law.scales)


def _nearest_quintic(law: GrowthLaw, low: float, high: float) -> Array | None:
    """Paper's form with the same v_c and D1, nearest in ln A on both branches."""
    p = law.p
    v_c = law.critical_speed
    if v_c is None:
        return None
    speeds = np.linspace(low, high, 61)
    u = law.detuning(speeds)
    u_c = float(law.detuning(v_c))
    rise = law.linear_slope(u_c)
    rows, right = [], []
    for branch in law.steady_amplitudes(speeds):
        here = np.isfinite(branch)
        w = (branch[here] / law.scales.amplitude) ** 2
        x = u[here]
        nearby = branch[here] * 1e-4
        above = law.growth_rate(speeds[here], branch[here] + nearby)
        below = law.growth_rate(speeds[here], branch[here] - nearby)
        # Next to the fold the slope vanishes: a floor keeps its weight finite.
        steep = np.maximum(np.abs(above - below) / 2e-4, 0.2 * np.max(np.abs(p[3:5])))
        rows.append(np.stack([w, x * w, w**2, (x - u_c) ** 2], axis=1) / steep[:, None])
        right.append(-rise * (x - u_c) / steep)
    # D7 is free to serve the branches: it is an effective coefficient, and not Taylor's. What the
    # branches leave open (one alone does, over few speeds) stays what it is in the law.
    own = np.array([*p[3:6], p[2] + 3.0 * p[8] * u_c])
    matrix, target = np.concatenate(rows), np.concatenate(right)
    weight = _LEFT_OPEN * math.sqrt(max(len(matrix), 1)) / np.max(np.abs(p[3:5]))
    keep = weight * np.eye(own.size)
    matrix, target = np.concatenate([matrix, keep]), np.concatenate([target, keep @ own])
    cubic, mixed, quintic, bend = np.linalg.lstsq(matrix, target, rcond=None)[0]
    linear = np.array([-rise * u_c, rise, 0.0]) + bend * np.array([u_c**2, -2.0 * u_c, 1.0])
    return np.array([*linear, cubic, mixed, quintic])


def to_normal_form(p: Array, scales: GrowthScales) -> NormalForm | None:
    """
    Normal form of a law without further terms.

    Parameters
    ----------
    p : ndarray, shape (6,)
        Coefficients, 1/s.
    scales : GrowthScales
        Units of p, and those of the form.

    Returns
    -------
    NormalForm or None
        None where the linear growth rate nowhere rises through zero: there is no v_c.
    """
    v_c = GrowthLaw(lawful(p), scales).critical_speed
    if v_c is None:
        return None
    u_c = v_c / scales.speed - 1.0
    stretch = v_c / scales.speed  # u - u_c = eps * stretch
    tau, ratio = scales.time_scale, scales.ratio
    return NormalForm(
        critical_speed=v_c,
        D1=float((p[1] + 2.0 * p[2] * u_c) * stretch * tau),
        D4=float((p[3] + p[4] * u_c) * tau / ratio),
        D7=float(p[2] * stretch**2 * tau),
        D10=float(p[4] * stretch * tau / ratio),
        D15=float(p[5] * tau / ratio**2),
        length_scale=scales.length_scale,
        time_scale=tau,
        frequency_hz=scales.frequency_hz,
    )


def from_normal_form(form: NormalForm, scales: GrowthScales) -> Array:
    """Coefficients of the paper's form, shape (6,); the inverse of `to_normal_form`."""
    tau = scales.time_scale
    # The form's own scales may differ: bring its coefficients onto ours first.
    time = tau / form.time_scale
    length = (scales.length_scale / form.length_scale) ** 2
    d1, d7 = form.D1 * time, form.D7 * time
    d4, d10, d15 = form.D4 * time * length, form.D10 * time * length, form.D15 * time * length**2
    stretch = form.critical_speed / scales.speed
    u_c = stretch - 1.0
    ratio = scales.ratio
    p2 = d7 / stretch**2 / tau
    p1 = d1 / stretch / tau - 2.0 * p2 * u_c
    p0 = -p1 * u_c - p2 * u_c**2
    p4 = d10 / stretch * ratio / tau
    p3 = d4 * ratio / tau - p4 * u_c
    return np.array([p0, p1, p2, p3, p4, d15 * ratio**2 / tau])
