"""
The growth laws a recording is fitted with, and their way to and from the normal form.

    quintic        d ln A / dt = p0 + p1 u + p2 u^2 + (p3 + p4 u) w + p5 w^2
    eps r^5        the same + p6 u w^2
    conicity       p0 + p1 u + p2 u^2 + (p3 + p4 u) K + p6 K^2,   K = w + p5 w^2

with u = v / v_ref - 1 and w = (A / A_ref)^2. The quintic law is Eq. (24) without a
critical speed in it: of order one, and defined even where the data hold no critical
speed. The third lets the amplitude act through the equivalent conicity
K(A) = 3/4 beta30 A^2 + 5/8 beta50 A^4 alone, as it does where only y is nonlinear.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.dynamics.normal_form import Criticality, NormalForm

Array = NDArray[np.float64]

#: Names of the laws, as results give them, and their numbers of coefficients.
QUINTIC, EXTENDED, CONICITY = 'quintic', 'quintic + eps r^5', 'equivalent conicity'
TERMS = {QUINTIC: 6, EXTENDED: 7, CONICITY: 7}

#: Largest w = (A / A_ref)^2 at which a limit cycle is looked for.
_LARGEST = 9.0


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


@dataclass(frozen=True, eq=False)
class GrowthLaw:
    """
    A growth law with its coefficients.

    Parameters
    ----------
    name : str
        Key of `TERMS`.
    p : ndarray, shape (6,) or (7,)
        1/s.
    scales : GrowthScales
    """

    name: str
    p: Array
    scales: GrowthScales

    def detuning(self, speed: ArrayLike) -> Array:
        """Return u = v / v_ref - 1 for speeds in m/s, any shape."""
        return np.asarray(speed, dtype=np.float64) / self.scales.speed - 1.0

    def linear(self, u: Array) -> Array:
        """Linear growth rate, 1/s."""
        value: Array = self.p[0] + (self.p[1] + self.p[2] * u) * u
        return value

    def growth_rate(self, speed: ArrayLike, amplitude: ArrayLike) -> Array:
        """Growth rate d ln A / dt, 1/s, at speeds (m/s) and amplitudes (m), broadcast."""
        u = self.detuning(speed)
        w = (np.asarray(amplitude, dtype=np.float64) / self.scales.amplitude) ** 2
        first, second = self.p[3] + self.p[4] * u, self._second(u)
        acting = w * (1.0 + self.p[5] * w) if self.name == CONICITY else w
        rate: Array = self.linear(u) + (first + second * acting) * acting
        return rate

    def _second(self, u: Array) -> Array:
        """Coefficient of the square of what acts (w or K)."""
        if self.name == QUINTIC:
            return np.full_like(u, self.p[5])
        if self.name == EXTENDED:
            return np.asarray(self.p[5] + self.p[6] * u)
        return np.full_like(u, self.p[6])

    @property
    def critical_speed(self) -> float | None:
        """Speed where the linear growth rate rises through zero, m/s; None without one."""
        p0, p1, p2 = self.p[:3]
        discriminant = p1 * p1 - 4.0 * p2 * p0
        if discriminant < 0.0:
            return None
        # Rising root: 2 p2 u + p1 = + sqrt(discriminant), without cancellation.
        root = math.sqrt(discriminant)
        if p1 + root > 1e-12 * (abs(p1) + root):
            u = -2.0 * p0 / (p1 + root)
        elif abs(p2) > 0.0:
            u = (-p1 + root) / (2.0 * p2)
        else:
            return None
        return float(self.scales.speed * (1.0 + u)) if u > -1.0 else None

    @property
    def other_root(self) -> float | None:
        """Speed where the linear growth rate falls through zero again, m/s."""
        p0, p1, p2 = self.p[:3]
        discriminant = p1 * p1 - 4.0 * p2 * p0
        if discriminant <= 0.0 or p2 == 0.0:
            return None
        u = (-p1 - math.sqrt(discriminant)) / (2.0 * p2)
        return float(self.scales.speed * (1.0 + u))

    @property
    def criticality(self) -> Criticality | None:
        """'subcritical' where the cubic term at v_c is destabilising; None without v_c."""
        v_c = self.critical_speed
        if v_c is None:
            return None
        cubic = self.p[3] + self.p[4] * float(self.detuning(v_c))
        return 'subcritical' if cubic > 0.0 else 'supercritical'

    def steady_amplitudes(self, speed: ArrayLike) -> tuple[Array, Array]:
        """
        Nontrivial steady states.

        Parameters
        ----------
        speed : array_like, shape (n,)
            m/s.

        Returns
        -------
        unstable, stable : ndarray, shape (n,)
            m; NaN where there is none. The stable one is the first above the unstable.
        """
        u = np.atleast_1d(self.detuning(speed))
        first, second = self.p[3] + self.p[4] * u, self._second(u)
        acting = _quadratic(second, first, self.linear(u))
        w = acting
        if self.name == CONICITY:
            flat = np.full_like(acting, self.p[5])
            w = _quadratic(flat, np.ones_like(acting), -acting).reshape(-1, u.size)
        with np.errstate(invalid='ignore', over='ignore'):
            slope = first + 2.0 * second * w
            if self.name == CONICITY:
                k = w * (1.0 + self.p[5] * w)
                slope = (first + 2.0 * second * k) * (1.0 + 2.0 * self.p[5] * w)
            exists = (w > 0.0) & (w < _LARGEST)
            unstable = np.min(np.where(exists & (slope > 0.0), w, np.inf), axis=0)
            above = exists & (slope < 0.0) & ((w > unstable) | ~np.isfinite(unstable))
        stable = np.min(np.where(above, w, np.inf), axis=0)
        size = self.scales.amplitude
        return size * _root(unstable), size * _root(stable)

    def saddle_node(self, lowest: float) -> float | None:
        """
        Nonlinear critical speed v_n, m/s: where the pair of limit cycles ends.

        Parameters
        ----------
        lowest : float
            Speed below which it is not looked for, m/s.

        Returns
        -------
        float or None
            None where there is no fold between `lowest` and v_c.
        """
        v_c = self.critical_speed
        if v_c is None or v_c <= lowest:
            return None
        speeds = np.linspace(lowest, v_c, 241)[:-1]
        unstable, stable = self.steady_amplitudes(speeds)
        pair = np.isfinite(unstable) & np.isfinite(stable)
        if not pair[-1] or pair.all():
            return None
        last = int(np.flatnonzero(~pair)[-1])
        low, high = float(speeds[last]), float(speeds[last + 1])
        for _ in range(30):
            middle = 0.5 * (low + high)
            a, b = self.steady_amplitudes(middle)
            if np.isfinite(a[0]) and np.isfinite(b[0]):
                high = middle
            else:
                low = middle
        return high

    def normal_form(self, low: float, high: float) -> NormalForm | None:
        """
        Normal form of the law: exact for the quintic, else the nearest on its branches.

        Parameters
        ----------
        low, high : float
            Range of speeds over which it shall hold, m/s.

        Returns
        -------
        NormalForm or None
            In the amplitude coordinate; None without a critical speed. D7, D10 and D15
            are effective coefficients over this range.
        """
        p = self.p if self.name == QUINTIC else self._nearest_quintic(low, high)
        return to_normal_form(p, self.scales)

    def _nearest_quintic(self, low: float, high: float) -> Array:
        """Quintic with the same linear growth, nearest in ln A on both branches."""
        speeds = np.linspace(low, high, 61)
        u = self.detuning(speeds)
        rows, right = [], []
        for branch in self.steady_amplitudes(speeds):
            here = np.isfinite(branch)
            w = (branch[here] / self.scales.amplitude) ** 2
            x = u[here]
            nearby = branch[here] * 1e-4
            above = self.growth_rate(speeds[here], branch[here] + nearby)
            below = self.growth_rate(speeds[here], branch[here] - nearby)
            # Next to the fold the slope vanishes: a floor keeps its weight finite.
            steep = np.maximum(np.abs(above - below) / 2e-4, 0.2 * np.max(np.abs(self.p[3:5])))
            rows.append(np.stack([w, x * w, w**2], axis=1) / steep[:, None])
            right.append(-self.linear(x) / steep)
        matrix, target = np.concatenate(rows), np.concatenate(right)
        if len(matrix) < 6:
            taylor = self.p[5] if self.name == EXTENDED else self.p[3] * self.p[5] + self.p[6]
            return np.array([*self.p[:5], taylor])
        nonlinear = np.linalg.lstsq(matrix, target, rcond=None)[0]
        return np.concatenate([self.p[:3], nonlinear])


def _quadratic(a: Array, b: Array, c: Array) -> Array:
    """Both roots of a x^2 + b x + c, shape (2, ...); NaN where there is none."""
    with np.errstate(all='ignore'):
        q = -0.5 * (b + np.copysign(np.sqrt(b * b - 4.0 * a * c), b))
        return np.stack([q / a, c / q])


def _root(w: Array) -> Array:
    """Square root with NaN for what is not there."""
    return np.sqrt(np.where(np.isfinite(w), w, math.nan))


def to_normal_form(p: Array, scales: GrowthScales) -> NormalForm | None:
    """
    Normal form of a quintic law.

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
    v_c = GrowthLaw(QUINTIC, p, scales).critical_speed
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
    """Quintic law of a normal form, shape (6,); the inverse of `to_normal_form`."""
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


def monomials(u: Array, w: Array) -> Array:
    """Return the columns that multiply p in the quintic law, shape (n, 6)."""
    return np.stack([np.ones_like(u), u, u**2, w, u * w, w**2], axis=-1)
