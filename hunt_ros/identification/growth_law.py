"""
The growth law in the variables the fit works in, and its way to and from the normal form.

    d ln A / dt = p0 + p1 u + p2 u^2 + (p3 + p4 u) w + p5 w^2   [+ p6 u w^2]
    u = v / v_ref - 1,   w = (A / A_ref)^2

It is Eq. (24) again, without a critical speed in it: linear in p, of order one, and
defined even where the data hold no critical speed at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.normal_form import NormalForm

#: Number of coefficients of the quintic law, and with the added eps r^5 term.
QUINTIC = 6
EXTENDED = 7


@dataclass(frozen=True)
class GrowthScales:
    """
    Units of the fit's variables.

    Parameters
    ----------
    speed : float
        v_ref, m/s.
    amplitude : float
        A_ref, m.
    length_scale, time_scale : float
        d0 (m) and 1 / omega_psi (s) of the normal form.
    frequency_hz : float
        Hunting frequency.
    """

    speed: float
    amplitude: float
    length_scale: float
    time_scale: float
    frequency_hz: float

    @property
    def ratio(self) -> float:
        """(A_ref / 2 d0)^2: turns w into r^2."""
        return (self.amplitude / (2.0 * self.length_scale)) ** 2


def monomials(
    u: NDArray[np.float64], w: NDArray[np.float64], terms: int = QUINTIC
) -> NDArray[np.float64]:
    """Return the columns that multiply p, shape (n, terms)."""
    one = np.ones_like(u)
    columns = [one, u, u**2, w, u * w, w**2, u * w**2][:terms]
    return np.stack(columns, axis=-1)


def critical_speeds(p: NDArray[np.float64], scales: GrowthScales) -> list[float]:
    """
    Speeds where the linear growth rate rises through zero, m/s, in ascending order.

    A second root, where it falls again, is no critical speed and is left out.
    """
    if abs(p[2]) < 1e-12 * max(abs(p[0]), abs(p[1]), 1e-300):
        roots = [-p[0] / p[1]] if p[1] > 0.0 else []
    else:
        discriminant = p[1] ** 2 - 4.0 * p[2] * p[0]
        if discriminant < 0.0:
            return []
        # Rising root: 2 p2 u + p1 = + sqrt(discriminant), in the form without cancellation.
        root = math.sqrt(discriminant)
        denominator = p[1] + root
        if abs(denominator) > 1e-12 * (abs(p[1]) + root):
            roots = [-2.0 * p[0] / denominator]
        else:
            roots = [(-p[1] + root) / (2.0 * p[2])]
    return [float(scales.speed * (1.0 + u)) for u in roots if u > -1.0]


def to_normal_form(p: NDArray[np.float64], scales: GrowthScales) -> NormalForm | None:
    """
    Normal form of a growth law.

    Parameters
    ----------
    p : ndarray, shape (6,) or more
        Only the first six are used.
    scales : GrowthScales
        Units of p, and those of the form.

    Returns
    -------
    NormalForm or None
        None where the linear growth rate nowhere rises through zero: there is no v_c.
    """
    speeds = critical_speeds(p, scales)
    if not speeds:
        return None
    v_c = speeds[0]
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


def from_normal_form(form: NormalForm, scales: GrowthScales) -> NDArray[np.float64]:
    """Growth law of a normal form, shape (6,); the inverse of `to_normal_form`."""
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
