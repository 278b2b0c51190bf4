"""The paper's normal form of a growth law: its units and its coefficients."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.growth_law import (
    PAPER_TERMS,
    QUINTIC,
    SATURATION,
    GrowthLaw,
    GrowthScales,
    lawful,
    reading,
)
from hunt_ros.dynamics.normal_form import NormalForm

Array = NDArray[np.float64]

#: What a coefficient may differ from the law's costs so much of an error of ln A on the branches,
#: for a difference as large as the cubic terms.
_LEFT_OPEN = 0.01


def normal_form_of(
    law: GrowthLaw, low: float, high: float, fold: float = math.nan
) -> NormalForm | None:
    """
    Normal form of a law: exact for the paper's form, else the nearest on its branches.

    Parameters
    ----------
    law : GrowthLaw
        With or without further terms.
    low, high : float
        Range of speeds over which it shall hold, m/s.
    fold : float
        Where the branches that begin at v_c end, m/s: further terms may have limit cycles at
        lower speeds, far from all that was measured, which no normal form has. NaN: nowhere.

    Returns
    -------
    NormalForm or None
        In the amplitude coordinate; None without a critical speed. D7, D10 and D15
        are effective coefficients over this range.
    """
    p = law.p[:PAPER_TERMS] if law.name == QUINTIC else _nearest_quintic(law, low, high, fold)
    return None if p is None else to_normal_form(p, law.scales)


def _nearest_quintic(law: GrowthLaw, low: float, high: float, fold: float) -> Array | None:
    """Paper's form with the same v_c and D1, nearest in ln A on both branches."""
    p = law.p
    v_c = law.critical_speed
    if v_c is None:
        return None
    speeds = np.linspace(low, high, 61)
    speeds = speeds[~(speeds < fold)]
    u = law.detuning(speeds)
    u_c = float(law.detuning(v_c))
    rise = float(law.linear_slope(u_c))
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
    own = np.array([*p[3:5], p[5] - p[SATURATION] * p[3], p[2]])
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
    about = reading(0.0, math.log(v_c / scales.speed)) @ lawful(p) * scales.time_scale
    return NormalForm(
        critical_speed=v_c,
        D1=float(about[1]),
        D4=float(about[3] / scales.ratio),
        D7=float(about[2]),
        D10=float(about[4] / scales.ratio),
        D15=float(about[5] / scales.ratio**2),
        length_scale=scales.length_scale,
        time_scale=scales.time_scale,
        frequency_hz=scales.frequency_hz,
    )
