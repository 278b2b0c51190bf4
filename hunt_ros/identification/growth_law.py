"""
The growth law that a recording is fitted with: Eq. (24), and terms that it leaves out.

    d ln A / dt =   p0 + p1 u + p2 u^2 + (p3 + p4 u) w + p5 w^2
                  + p6 u w^2 + p7 w^3 + p8 u^3 + p9 u^2 w

with u = v / v_ref - 1 and w = (A / A_ref)^2. The first six terms are the paper's form without
a critical speed in it: of order one, and defined even where the data hold no critical speed.
The others are what a rig may add to it. A prior shrinks them towards zero; its scale is learnt
from the recording, and with the scale at zero the law is the paper's exactly.

A line of amplitude B that the roller forces on y beside hunting takes part in the nonlinear
terms: A^2 -> A^2 + 2 B^2, A^4 -> A^4 + 6 A^2 B^2 + 3 B^4,
A^6 -> A^6 + 12 A^4 B^2 + 18 A^2 B^4 + 4 B^6. Of its power the wheelset feels the share p10: a
line that is partly run-out of the sensor acts less. The law is that of a rig without the line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.dynamics.normal_form import Criticality

Array = NDArray[np.float64]

#: Numbers of coefficients: of the paper's form, of the law, and with the share of the line.
PAPER_TERMS, TERMS = 6, 11
#: Place of the share of the roller's line that the wheelset feels.
FELT = 10
#: Places of the terms without amplitude, and their powers of u.
LINEAR, LINEAR_POWERS = (0, 1, 2, 8), (0, 1, 2, 3)
#: Names of the law, as results give them: as the paper has it, and with further terms.
QUINTIC, EXTENDED = 'quintic', 'quintic with shrunken terms'

#: Largest w = (A / A_ref)^2 at which a limit cycle is looked for.
_LARGEST = 9.0
#: Detuning beyond which no critical speed is looked for: ten times the speed of the data.
_FAR = 9.0


def _powers_of_w(p: Array, u: Any, line: Any) -> tuple[Any, Any, Any, Any]:
    """
    Coefficients of 1, w, w^2 and w^3 in the growth rate at one speed: the law itself.

    Parameters
    ----------
    p : ndarray, shape (11,)
        Coefficients.
    u, line : float or ndarray, shape (n,)
        Detuning, and power (B / A_ref)^2 of the roller's line.
    """
    b = p[10] * line
    first = p[3] + (p[4] + p[9] * u) * u
    second = p[5] + p[6] * u
    third = p[7]
    rest = p[0] + (p[1] + (p[2] + p[8] * u) * u) * u
    return (
        rest + (2.0 * first + (3.0 * second + 4.0 * third * b) * b) * b,
        first + (6.0 * second + 18.0 * third * b) * b,
        second + 12.0 * third * b,
        third + 0.0 * b,
    )


#: The same for the compiled likelihood.
powers_of_w = compiled_part(_powers_of_w)


def lawful(paper: ArrayLike, felt: float = 1.0) -> Array:
    """Return coefficients, shape (11,), from those of the paper's form, shape (6,)."""
    p = np.zeros(TERMS)
    p[:PAPER_TERMS] = paper
    p[FELT] = felt
    return p


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

    @property
    def fastest_rate(self) -> float:
        """Largest sensible growth rate, 1/s: the angular frequency of the mode itself."""
        return 2.0 * math.pi * self.frequency_hz


@dataclass(frozen=True, eq=False)
class LawPrior:
    """
    What is known of the law's coefficients before the data are seen: independent normal numbers.

    Parameters
    ----------
    mean, std : ndarray, shape (11,)
        1/s; a coefficient with std 0 is held at its mean.
    """

    mean: Array
    std: Array


def law_prior(scales: GrowthScales, departure: float, size: Array | None, line: bool) -> LawPrior:
    """
    Prior of the law for a rig that departs from the paper's form by so much.

    Parameters
    ----------
    scales : GrowthScales
        Units. No mode that still oscillates grows faster than its own angular frequency.
    departure : float
        Scale of the further terms relative to those they belong to; 0 for the paper's form.
    size : ndarray, shape (6,), optional
        Coefficients of the paper's form; not needed for `departure` 0.
    line : bool
        Whether there is a line of the roller.

    Returns
    -------
    LawPrior
    """
    mean, std = np.zeros(TERMS), np.zeros(TERMS)
    std[:PAPER_TERMS] = scales.fastest_rate
    mean[FELT], std[FELT] = 1.0, 0.5 if line else 0.0
    if departure > 0.0 and size is not None:
        # In a series in u and w each term is about as large as the one before, less w^3 / 6.
        amplitude = float(np.max(np.abs(size[[3, 5]])))
        std[[6, 7, 8, 9]] = departure * np.array(
            [amplitude, 0.3 * amplitude, abs(float(size[1])), amplitude]
        )
    return LawPrior(mean, std)


@dataclass(frozen=True, eq=False)
class GrowthLaw:
    """
    The growth law with its coefficients.

    Parameters
    ----------
    p : ndarray, shape (11,)
        1/s, and the share of the roller's line that is felt.
    scales : GrowthScales
    """

    p: Array
    scales: GrowthScales

    @property
    def name(self) -> str:
        """Name of the law, as results give it."""
        return EXTENDED if np.any(self.p[PAPER_TERMS:FELT] != 0.0) else QUINTIC

    def detuning(self, speed: ArrayLike) -> Array:
        """Return u = v / v_ref - 1 for speeds in m/s, any shape."""
        return np.asarray(speed, dtype=np.float64) / self.scales.speed - 1.0

    def linear(self, u: Array | float) -> Array:
        """Linear growth rate, 1/s."""
        value: Array = self.p[0] + (self.p[1] + (self.p[2] + self.p[8] * u) * u) * u
        return value

    def linear_slope(self, u: float) -> float:
        """Change of the linear growth rate with u, 1/s."""
        return float(self.p[1] + (2.0 * self.p[2] + 3.0 * self.p[8] * u) * u)

    def linear_terms(self, u: float) -> Array:
        """Return what multiplies each coefficient in the linear growth rate, shape (11,)."""
        terms = np.zeros(TERMS)
        terms[list(LINEAR)] = u ** np.array(LINEAR_POWERS)
        return terms

    def _in_w(self, u: Array, line: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """Coefficients of the powers of w, for a line of power B^2 in m^2."""
        b = np.asarray(line, dtype=np.float64) / self.scales.amplitude**2
        return _powers_of_w(self.p, u, b)

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
        w = (np.asarray(amplitude, dtype=np.float64) / self.scales.amplitude) ** 2
        rest, first, second, third = self._in_w(self.detuning(speed), line)
        rate: Array = rest + (first + (second + third * w) * w) * w
        return rate

    def _roots(self) -> list[tuple[float, float]]:
        """Speeds where the linear growth rate is zero and its slope there, the nearest first."""
        p = self.p[list(LINEAR)][::-1]
        if not np.isfinite(p).all():
            return []
        significant = np.abs(p) > 1e-12 * np.max(np.abs(p))
        roots = np.roots(np.where(significant, p, 0.0))
        real = roots.real[np.abs(roots.imag) <= 1e-9 * np.maximum(np.abs(roots.real), 1e-3)]
        found = []
        for u in sorted(real.tolist(), key=abs):
            slope = self.linear_slope(u)
            if slope != 0.0:
                u -= float(self.linear(u)) / slope
            if -1.0 < u < _FAR:
                found.append((self.scales.speed * (1.0 + u), slope))
        return found

    @property
    def critical_speed(self) -> float | None:
        """
        Speed where the linear growth rate rises through zero, m/s; None without one.

        Of several the one nearest to the speeds of the data.
        """
        return next((speed for speed, slope in self._roots() if slope > 0.0), None)

    @property
    def other_root(self) -> float | None:
        """Speed where the linear growth rate falls through zero again, m/s."""
        return next((speed for speed, slope in self._roots() if slope < 0.0), None)

    @property
    def criticality(self) -> Criticality | None:
        """'subcritical' where the cubic term at v_c is destabilising; None without v_c."""
        v_c = self.critical_speed
        if v_c is None:
            return None
        cubic = float(self._in_w(self.detuning(v_c), 0.0)[1])
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
            m; NaN where there is none. The stable one is the smallest amplitude at which growth
            turns into decay: what growth from rest meets, and the first state beyond the basin
            of rest. The unstable one lies below it, where decay turns into growth. An unstable
            one with no stable one above it is where a law runs away, outside what it was fitted
            to: no state of a rig. Neither asks for the sign of the growth from rest, which at
            v_c is a matter of rounding.
        """
        u = np.atleast_1d(self.detuning(speed))
        rest, first, second, third = (np.broadcast_to(c, u.shape) for c in self._in_w(u, line))
        w = _cubic_roots(third, second, first, rest)
        with np.errstate(invalid='ignore', over='ignore'):
            slope = first + (2.0 * second + 3.0 * third * w) * w
            exists = (w > 0.0) & (w < _LARGEST)
            stable = np.min(np.where(exists & (slope < 0.0), w, np.inf), axis=0)
            barrier = exists & (slope > 0.0) & (w < stable) & np.isfinite(stable)
            unstable = np.min(np.where(barrier, w, np.inf), axis=0)
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


def _cubic_roots(a: Array, b: Array, c: Array, d: Array) -> Array:
    """
    Real roots of a x^3 + b x^2 + c x + d, shape (3, n); NaN where there is none.

    References
    ----------
    Press, W. H., et al., Numerical Recipes (2007), Sect. 5.6.
    """
    with np.errstate(all='ignore'):
        q = -0.5 * (c + np.copysign(np.sqrt(c * c - 4.0 * b * d), c))
        square = np.stack([q / b, d / q, np.full_like(q, np.nan)])
        b3, c3, d3 = b / a, c / a, d / a
        big_q = (b3 * b3 - 3.0 * c3) / 9.0
        big_r = (2.0 * b3**3 - 9.0 * b3 * c3 + 27.0 * d3) / 54.0
        angle = np.arccos(big_r / big_q**1.5) / 3.0
        turns = 2.0 * np.pi / 3.0 * np.array([0.0, 1.0, -1.0])[:, None]
        three = -2.0 * np.sqrt(big_q) * np.cos(angle + turns) - b3 / 3.0
        root = np.cbrt(np.abs(big_r) + np.sqrt(big_r**2 - big_q**3))
        root = -np.copysign(root, big_r)
        one = np.where(root == 0.0, 0.0, root + big_q / root) - b3 / 3.0
        alone = np.stack([one, np.full_like(one, np.nan), np.full_like(one, np.nan)])
        full = np.where(np.isfinite(angle), three, alone)
        # A leading term that changes nothing within reach: the others decide, and it is added.
        slight = np.abs(a) * _LARGEST**2 < 1e-6 * (np.abs(b) * _LARGEST + np.abs(c))
        x = np.where(slight, square, full)
        for _ in range(2):
            step = (((a * x + b) * x + c) * x + d) / ((3.0 * a * x + 2.0 * b) * x + c)
            x = np.where(np.abs(step) < 0.1 * np.abs(x), x - step, x)
    return x


def _root(w: Array) -> Array:
    """Square root with NaN for what is not there."""
    return np.sqrt(np.where(np.isfinite(w), w, math.nan))


def monomials(u: Array, w: Array) -> Array:
    """Return the columns that multiply p in the paper's form, shape (n, 6)."""
    return np.stack([np.ones_like(u), u, u**2, w, u * w, w**2], axis=-1)
