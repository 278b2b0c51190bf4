"""
The growth law: Eq. (24), and terms that it leaves out; its branches and its fold.

    d ln A / dt = sum_j p_j u^i x^k,    u = v / v_ref - 1,    w = (A / A_ref)^2,
    x = w / (1 + c w),    c >= 0,

with the powers i and k of `U_POWERS` and `X_POWERS`. The first six terms, with c = 0, are the
paper's form without a critical speed in it: of order one, and defined even where the data hold no
critical speed. The others are what a rig may add to it. Forces that saturate (conicity and creep)
have c > 0: of the laws with as many coefficients a rational one follows them best, and its limit
cycles at a speed are still two.

A line of amplitude B that the roller forces on y beside hunting takes part in the nonlinear
terms: A^2 -> A^2 + 2 B^2, A^4 -> A^4 + 6 A^2 B^2 + 3 B^4. Of its power the wheelset feels the
share p9: a line that is partly run-out of the sensor acts less. The law is that of a rig without
the line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.dynamics.normal_form import Criticality, real_roots

Array = NDArray[np.float64]

#: Powers of u and of x of each term: the paper's form first.
U_POWERS = (0, 1, 2, 0, 1, 0, 1, 2)
X_POWERS = (0, 0, 0, 1, 1, 2, 2, 1)
#: Numbers of coefficients: of the paper's form, and with saturation and the share of the line.
PAPER_TERMS, TERMS = 6, 10
#: Places of the saturation c, and of the share of the roller's line that the wheelset feels.
SATURATION, FELT = 8, 9
#: Places of the terms without amplitude, which are their powers of u.
LINEAR = (0, 1, 2)
#: Where the terms of a law go when u is replaced by s (1 + u) - 1: place, place it comes from,
#: in how many ways, power of u it comes from and goes to, power of x.
_EXPANDED = np.array(
    [
        (into, out, math.comb(i, j), i, j, k)
        for into, (j, k) in enumerate(zip(U_POWERS, X_POWERS, strict=True))
        for out, (i, same) in enumerate(zip(U_POWERS, X_POWERS, strict=True))
        if same == k and j <= i
    ]
).T
#: Names of the law, as results give them: as the paper has it, and with further terms.
QUINTIC, EXTENDED = 'quintic', 'quintic with saturation'

#: Largest w = (A / A_ref)^2 at which a limit cycle is looked for, and the largest detuning at
#: which a critical speed is: ten times the speed of the data.
_LARGEST = 9.0


def _powers_of_x(p: Any, k: Any, u: Any, line: Any) -> tuple[Any, Any, Any]:
    """
    Coefficients of 1, x and x^2 in the growth rate at one speed: the law itself.

    Parameters
    ----------
    p : ndarray, shape (10, ...)
        Coefficients.
    k : int or Ellipsis
        Which of several laws, or all.
    u, line : float or ndarray
        Detuning, and power (B / A_ref)^2 of the roller's line.
    """
    b = p[FELT, k] * line
    first = p[3, k] + (p[4, k] + p[7, k] * u) * u
    second = p[5, k] + p[6, k] * u
    rest = p[0, k] + (p[1, k] + p[2, k] * u) * u
    return (
        rest + (2.0 * first + 3.0 * second * b) * b,
        first + 6.0 * second * b,
        second + 0.0 * b,
    )


#: The same for the compiled likelihood.
_powers_compiled = compiled_part(_powers_of_x)


@compiled_part
def growth_at(p: Array, k: int, u: float, w: float, line: float) -> tuple[float, float]:
    """Return the growth rate of law k, 1/s, and its derivative by w; p of shape (10, laws)."""
    c0, c1, c2 = _powers_compiled(p, k, u, line)
    s = 1.0 / (1.0 + p[SATURATION, k] * w)
    x = w * s
    return c0 + (c1 + c2 * x) * x, (c1 + 2.0 * c2 * x) * s * s


def saturated(c: Any, w: Array) -> Array:
    """Return x for saturations c and w = (A / A_ref)^2."""
    x: Array = w / (1.0 + c * w)
    return x


def lawful(paper: ArrayLike, felt: float = 1.0) -> Array:
    """Return coefficients, shape (10,), from those of the paper's form, shape (6,)."""
    p = np.zeros(TERMS)
    p[:PAPER_TERMS] = paper
    p[FELT] = felt
    return p


def reading(log_gain: ArrayLike, log_speed: ArrayLike) -> Array:
    """
    Return the matrix that turns the coefficients of a law into those of its readings.

    Parameters
    ----------
    log_gain : array_like, shape (...)
        Logarithm of measured over true amplitude.
    log_speed : array_like, shape (...)
        Logarithm of true over measured speed.

    Returns
    -------
    ndarray, shape (..., 10, 10)
        Exact: with 1 + u = s (1 + u') a power of u is a polynomial in u' of the same degree.
    """
    gain, speed = np.broadcast_arrays(log_gain, log_speed)
    s, shrunk = np.exp(speed)[..., None], np.exp(-2.0 * gain)[..., None]
    matrix = np.zeros((*gain.shape, TERMS, TERMS))
    matrix[..., FELT, FELT], matrix[..., SATURATION, SATURATION] = 1.0, shrunk[..., 0]
    into, out, ways, i, j, k = _EXPANDED
    matrix[..., into, out] = ways * (s - 1.0) ** (i - j) * s**j * shrunk**k
    return matrix


@dataclass(frozen=True)
class GrowthScales:
    """
    Units of the law's variables.

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
class GrowthLaw:
    """
    The growth law with its coefficients, or many laws at once.

    Parameters
    ----------
    p : ndarray, shape (10,) or (laws, 10)
        1/s; saturation and the share of the roller's line that is felt are numbers.
    scales : GrowthScales
    """

    p: Array
    scales: GrowthScales

    @property
    def name(self) -> str:
        """Name of the law, as results give it."""
        return EXTENDED if np.any(self.p[..., PAPER_TERMS:FELT] != 0.0) else QUINTIC

    @property
    def _columns(self) -> Array:
        """The coefficients, each as a scalar or, of many laws, as a column, (laws, 1)."""
        return self.p if self.p.ndim == 1 else self.p.T[:, :, None]

    def detuning(self, speed: ArrayLike) -> Array:
        """Return u = v / v_ref - 1 for speeds in m/s, any shape."""
        return np.asarray(speed, dtype=np.float64) / self.scales.speed - 1.0

    def linear(self, u: Array | float) -> Array:
        """Linear growth rate, 1/s; of many laws shape (laws, ...)."""
        p = self._columns
        value: Array = p[0] + (p[1] + p[2] * u) * u
        return value

    def linear_slope(self, u: Array | float) -> Array:
        """Change of the linear growth rate with u, 1/s; of many laws shape (laws, ...)."""
        p = self._columns
        slope: Array = p[1] + 2.0 * p[2] * u
        return slope

    def linear_terms(self, u: float) -> Array:
        """Return what multiplies each coefficient in the linear growth rate, shape (10,)."""
        terms = np.zeros(TERMS)
        terms[list(LINEAR)] = u ** np.array(LINEAR)
        return terms

    def _in_x(self, speed: ArrayLike, line: ArrayLike) -> tuple[Array, Array, Array]:
        """Coefficients of the powers of x, for a line of power B^2 in m^2."""
        b = np.asarray(line, dtype=np.float64) / self.scales.amplitude**2
        return _powers_of_x(self._columns, ..., self.detuning(speed), b)

    def growth_rate(self, speed: ArrayLike, amplitude: ArrayLike, line: ArrayLike = 0.0) -> Array:
        """
        Growth rate d ln A / dt.

        Parameters
        ----------
        speed, amplitude, line : array_like
            m/s, m and B^2 in m^2; broadcast; of many laws with shape (laws, 1) or (laws, n).

        Returns
        -------
        ndarray
            1/s.
        """
        w = (np.asarray(amplitude, dtype=np.float64) / self.scales.amplitude) ** 2
        rest, first, second = self._in_x(speed, line)
        x = saturated(self._columns[SATURATION], w)
        rate: Array = rest + (first + second * x) * x
        return rate

    def _zero(self, sign: float) -> Array:
        """Speeds where the linear growth rate rises, or falls, through zero; NaN without one."""
        p = np.atleast_2d(self.p)
        u = real_roots(p[:, 2], p[:, 1], p[:, 0])
        with np.errstate(invalid='ignore', over='ignore'):
            slope = p[:, 1] + 2.0 * p[:, 2] * u
            there = (u > -1.0) & (u < _LARGEST) & (sign * slope > 0.0)
        nearest = np.argmin(np.where(there, np.abs(u), np.inf), axis=0)
        found = np.take_along_axis(np.where(there, u, np.nan), nearest[None], axis=0)[0]
        speeds: Array = self.scales.speed * (1.0 + found)
        return speeds

    @property
    def critical_speeds(self) -> Array:
        """
        Speeds where the linear growth rates rise through zero, m/s, shape (laws,); NaN: none.

        Of several the one nearest to the speeds of the data.
        """
        return self._zero(1.0)

    @property
    def critical_speed(self) -> float | None:
        """Critical speed of the one law, m/s; None without one."""
        return _known(self.critical_speeds[0])

    @property
    def other_root(self) -> float | None:
        """Speed where the linear growth rate falls through zero again, m/s."""
        return _known(self._zero(-1.0)[0])

    @property
    def soft(self) -> NDArray[np.bool_]:
        """Whether the cubic term at v_c is stabilising, shape (laws,); False without v_c."""
        many = GrowthLaw(np.atleast_2d(self.p), self.scales)
        cubic: Array = many._in_x(self.critical_speeds[:, None], 0.0)[1][:, 0]
        return np.asarray(cubic <= 0.0)

    @property
    def criticality(self) -> Criticality | None:
        """'subcritical' where the cubic term at v_c is destabilising; None without v_c."""
        if self.critical_speed is None:
            return None
        return 'supercritical' if self.soft[0] else 'subcritical'

    def steady_amplitudes(self, speed: ArrayLike, line: ArrayLike = 0.0) -> tuple[Array, Array]:
        """
        Nontrivial steady states.

        Parameters
        ----------
        speed : array_like, shape (n,)
            m/s; of many laws also (laws, n).
        line : array_like, shape (n,) or ()
            B^2, m^2.

        Returns
        -------
        unstable, stable : ndarray, shape (n,) or (laws, n)
            m; NaN where there is none. The stable one is the smallest amplitude at which growth
            turns into decay: what growth from rest meets, and the first state beyond the basin
            of rest. The unstable one lies below it, where decay turns into growth. An unstable
            one with no stable one above it is where a law runs away, outside what it was fitted
            to: no state of a rig. Neither asks for the sign of the growth from rest, which at
            v_c is a matter of rounding.
        """
        rest, first, second = np.broadcast_arrays(*self._in_x(np.atleast_1d(speed), line))
        c = self._columns[SATURATION]
        x = real_roots(second, first, rest)
        with np.errstate(all='ignore'):
            slope = first + 2.0 * second * x
            w = x / (1.0 - c * x)
            exists = (w > 0.0) & (w < _LARGEST)
            stable = np.min(np.where(exists & (slope < 0.0), w, np.inf), axis=0)
            barrier = exists & (slope > 0.0) & (w < stable) & np.isfinite(stable)
            unstable = np.min(np.where(barrier, w, np.inf), axis=0)
        size = self.scales.amplitude
        return size * _root(unstable), size * _root(stable)

    def folds(self, lowest: float, highest: float = math.inf) -> Array:
        """
        Nonlinear critical speeds, where the pairs of limit cycles end, and the amplitudes there.

        Parameters
        ----------
        lowest : float
            Speed below which none is looked for, m/s.
        highest : float, optional
            Speed above which none is looked for, m/s.

        Returns
        -------
        ndarray, shape (2, laws)
            m/s and m; NaN where there is no fold between `lowest` and v_c, or `highest`.
        """
        many = GrowthLaw(np.atleast_2d(self.p), self.scales)
        end = np.fmin(many.critical_speeds, highest)
        end = np.where(np.isfinite(end), end, math.nan)
        # Closest next to v_c: a hysteresis may be narrow.
        share = 1.0 - np.linspace(1.0, 0.0, 121)[:-1] ** 3
        speeds = lowest + np.maximum(end - lowest, 0.0)[:, None] * share
        pair: NDArray[np.bool_] = ~np.isnan(np.add(*many.steady_amplitudes(speeds)))
        folds = (end > lowest) & pair[:, -1] & ~pair.all(axis=1)
        rows = np.arange(len(end))
        last = np.minimum(119 - np.argmin(pair[:, ::-1], axis=1), 118)
        low, high = speeds[rows, last], speeds[rows, last + 1]
        for _ in range(24):
            middle = 0.5 * (low + high)
            there = np.isfinite(np.add(*many.steady_amplitudes(middle[:, None])))[:, 0]
            low, high = np.where(there, low, middle), np.where(there, middle, high)
        amplitude = 0.5 * np.add(*many.steady_amplitudes(high[:, None]))[:, 0]
        return np.where(folds, [high, amplitude], np.nan)

    def saddle_node(self, lowest: float) -> float | None:
        """Nonlinear critical speed v_n of the one law, m/s; None without one above `lowest`."""
        return _known(self.folds(lowest)[0, 0])


def _root(w: Array) -> Array:
    """Square root with NaN for what is not there."""
    return np.sqrt(np.where(np.isfinite(w), w, math.nan))


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
