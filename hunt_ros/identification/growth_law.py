"""
The growth laws a recording is fitted with.

    quintic        d ln A / dt = p0 + p1 u + p2 u^2 + (p3 + p4 u) w + p5 w^2
    eps r^5        the same + p6 u w^2
    conicity       p0 + p1 u + p2 u^2 + (p3 + p4 u) K + p6 K^2,   K = w + p5 w^2

with u = v / v_ref - 1 and w = (A / A_ref)^2. The quintic law is Eq. (24) without a
critical speed in it: of order one, and defined even where the data hold no critical
speed. The third lets the amplitude act through the equivalent conicity
K(A) = 3/4 beta30 A^2 + 5/8 beta50 A^4 alone, as it does where only y is nonlinear.

A line of amplitude B that the roller forces on y beside hunting takes part in the cubic and
quintic terms: A^2 -> A^2 + 2 B^2, A^4 -> A^4 + 6 A^2 B^2 + 3 B^4. The laws are those of a
rig without it, and `line` says how much of it there is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.dynamics.normal_form import Criticality

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

    def growth_rate(self, speed: ArrayLike, amplitude: ArrayLike, line: ArrayLike = 0.0) -> Array:
        """
        Growth rate d ln A / dt.

        Parameters
        ----------
        speed, amplitude, line : array_like
            m/s, m and B^2 in m^2; broadcast.

        Returns
        -------
        ndarray
            1/s.
        """
        u = self.detuning(speed)
        w = (np.asarray(amplitude, dtype=np.float64) / self.scales.amplitude) ** 2
        b = np.asarray(line, dtype=np.float64) / self.scales.amplitude**2
        first, second = self.p[3] + self.p[4] * u, self._second(u)
        cubic, quintic = w + 2.0 * b, w**2 + (6.0 * w + 3.0 * b) * b
        if self.name == CONICITY:
            cubic += self.p[5] * quintic
            quintic = cubic**2
        rate: Array = self.linear(u) + first * cubic + second * quintic
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

    def steady_amplitudes(self, speed: ArrayLike, line: ArrayLike = 0.0) -> tuple[Array, Array]:
        """
        Nontrivial steady states.

        Parameters
        ----------
        speed : array_like, shape (n,)
            m/s.
        line : array_like, shape (n,) or ()
            B^2, m^2.

        Returns
        -------
        unstable, stable : ndarray, shape (n,)
            m; NaN where there is none. Where rest is stable the unstable one bounds its basin,
            and the stable one is the first above it; where rest is unstable the stable one is
            the first that growth from rest meets. An unstable one with no stable one above it
            is where a law runs away, outside what it was fitted to: no state of a rig.
        """
        u = np.atleast_1d(self.detuning(speed))
        b = np.asarray(line, dtype=np.float64) / self.scales.amplitude**2
        first, second = self.p[3] + self.p[4] * u, self._second(u)
        p5 = self.p[5] if self.name == CONICITY else 0.0
        if self.name == CONICITY:
            acting = _quadratic(second, first, self.linear(u))
            bent = np.full_like(acting, p5)
            w = _quadratic(bent, 1.0 + 6.0 * p5 * b, (2.0 + 3.0 * p5 * b) * b - acting)
            w = w.reshape(-1, u.size)
        else:
            rest = self.linear(u) + (2.0 * first + 3.0 * second * b) * b
            w = _quadratic(second, first + 6.0 * second * b, rest)
        with np.errstate(invalid='ignore', over='ignore'):
            slope = first + 2.0 * second * (w + 3.0 * b)
            if self.name == CONICITY:
                k = w + 2.0 * b + p5 * (w**2 + (6.0 * w + 3.0 * b) * b)
                slope = (first + 2.0 * second * k) * (1.0 + 2.0 * p5 * (w + 3.0 * b))
            exists = (w > 0.0) & (w < _LARGEST)
            leaves = self.growth_rate(speed, 0.0, line) > 0.0
            barrier = exists & (slope > 0.0) & ~leaves
            unstable = np.min(np.where(barrier, w, np.inf), axis=0)
            above = exists & (slope < 0.0) & ((w > unstable) | ~np.isfinite(unstable))
        stable = np.min(np.where(above, w, np.inf), axis=0)
        unstable = np.where(np.isfinite(stable), unstable, np.inf)
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
        for _ in range(3):
            finer = np.linspace(low, high, 34)
            unstable, stable = self.steady_amplitudes(finer)
            pair = np.isfinite(unstable) & np.isfinite(stable)
            # The upper end has the pair: the interval it was taken from says so.
            last = int(np.flatnonzero(~pair[:-1])[-1]) if not pair[:-1].all() else 0
            low, high = float(finer[last]), float(finer[last + 1])
        return high


def _quadratic(a: Array, b: Array, c: Array) -> Array:
    """Both roots of a x^2 + b x + c, shape (2, ...); NaN where there is none."""
    with np.errstate(all='ignore'):
        q = -0.5 * (b + np.copysign(np.sqrt(b * b - 4.0 * a * c), b))
        return np.stack([q / a, c / q])


def _root(w: Array) -> Array:
    """Square root with NaN for what is not there."""
    return np.sqrt(np.where(np.isfinite(w), w, math.nan))


def monomials(u: Array, w: Array) -> Array:
    """Return the columns that multiply p in the quintic law, shape (n, 6)."""
    return np.stack([np.ones_like(u), u, u**2, w, u * w, w**2], axis=-1)
