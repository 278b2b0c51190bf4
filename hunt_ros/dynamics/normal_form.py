"""
The quintic normal form as an object: steady states, fold, hysteresis, growth rates, metres.

Everything here is in the *amplitude coordinate* unless a name says otherwise:
r := A / (2 d0), with A the fundamental amplitude of y in metres, so that Eq. (32)
holds exactly. What is identified from measured amplitudes is this form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.settings import checked

Criticality = Literal['subcritical', 'supercritical']

#: Names of the real coefficients, in the order used for vectors and covariances.
COEFFICIENTS: tuple[str, ...] = ('D1', 'D4', 'D7', 'D10', 'D15')


@dataclass(frozen=True)
class NormalForm:
    """
    Amplitude equation of the hunting mode, Eq. (24), with its scales.

    dr/dt* = D1 eps r + D4 r^3 + D7 eps^2 r + D10 eps r^3 + D15 r^5

    Parameters
    ----------
    critical_speed : float
        Linear critical speed v_c, m/s.
    D1, D4, D7, D10, D15 : float
        Real parts, dimensionless. D7, D10, D15 are the primed ones of Eq. (24).
    length_scale : float
        d0, m.
    time_scale : float
        1 / omega_psi, s.
    frequency_hz : float
        Hunting frequency, Hz: that at v_c, or, identified, the mean over the motion.

    Raises
    ------
    ConfigError
        For a non-finite coefficient or a non-positive scale or speed.

    References
    ----------
    The paper, Eqs. (5), (24), (26)-(28), (32).
    """

    critical_speed: float
    D1: float
    D4: float
    D7: float
    D10: float
    D15: float
    length_scale: float = 0.0485
    time_scale: float = 1.0 / 25.91
    frequency_hz: float = 2.835

    def __post_init__(self) -> None:
        for name in COEFFICIENTS:
            checked(f'normal form: {name}', getattr(self, name))
        for name in ('critical_speed', 'length_scale', 'time_scale', 'frequency_hz'):
            checked(f'normal form: {name}', getattr(self, name), 'be positive')

    @property
    def criticality(self) -> Criticality:
        """'subcritical' where the cubic term is destabilising (D4 > 0)."""
        return 'subcritical' if self.D4 > 0.0 else 'supercritical'

    def detuning(self, speed: ArrayLike) -> NDArray[np.float64]:
        """Return eps = v / v_c - 1, Eq. (5), for speeds in m/s, any shape."""
        return np.asarray(speed, dtype=np.float64) / self.critical_speed - 1.0

    def growth_rate(self, speed: ArrayLike, amplitude: ArrayLike = 0.0) -> NDArray[np.float64]:
        """
        Growth rate d ln A / dt of the amplitude, Eq. (24) divided by r.

        Parameters
        ----------
        speed : array_like
            Running speed, m/s.
        amplitude : array_like
            Amplitude of y, m. Broadcast with `speed`.

        Returns
        -------
        ndarray
            1/s.
        """
        eps = self.detuning(speed)
        r2 = (np.asarray(amplitude, dtype=np.float64) / (2.0 * self.length_scale)) ** 2
        rate: NDArray[np.float64] = (
            self.D1 * eps + self.D7 * eps**2 + (self.D4 + self.D10 * eps) * r2 + self.D15 * r2**2
        ) / self.time_scale
        return rate

    def steady_amplitudes(
        self, speed: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Nontrivial steady states, Eq. (28): where the growth rate is zero.

        Parameters
        ----------
        speed : array_like
            Running speed, m/s, any shape.

        Returns
        -------
        unstable, stable : ndarray
            Amplitudes, m, of the shape of `speed`; NaN where there is none.
        """
        eps = np.asarray(self.detuning(speed), dtype=np.float64)
        rest, cubic = self.D1 * eps + self.D7 * eps**2, self.D4 + self.D10 * eps
        unstable, stable = steady_radii(rest, cubic, np.full_like(eps, self.D15))
        return 2.0 * self.length_scale * unstable, 2.0 * self.length_scale * stable

    def unstable_amplitude(self, speed: ArrayLike) -> NDArray[np.float64]:
        """Amplitude of the unstable limit cycle, m: the edge of the quiet basin; NaN if none."""
        return self.steady_amplitudes(speed)[0]

    def stable_amplitude(self, speed: ArrayLike) -> NDArray[np.float64]:
        """Amplitude of the stable limit cycle, m; NaN where there is none."""
        return self.steady_amplitudes(speed)[1]

    def saddle_node(self) -> tuple[float, float] | None:
        """
        Fold of the limit cycles: where the discriminant of Eq. (28) vanishes.

        Returns
        -------
        (v_n, amplitude) or None
            Nonlinear critical speed, m/s, and amplitude there, m; None without a fold
            below v_c (supercritical, or no restoring quintic term).
        """
        if self.D4 <= 0.0 or self.D15 >= 0.0:
            return None
        # (D4 + D10 eps)^2 = 4 D15 (D1 eps + D7 eps^2), as a eps^2 + b eps + c = 0
        a = self.D10**2 - 4.0 * self.D15 * self.D7
        b = 2.0 * self.D4 * self.D10 - 4.0 * self.D15 * self.D1
        roots = real_roots(a, b, self.D4**2).tolist()
        for eps in sorted((x for x in roots if -1.0 < x < 0.0), reverse=True):
            r2 = -(self.D4 + self.D10 * eps) / (2.0 * self.D15)
            if r2 > 0.0:
                return self.critical_speed * (1.0 + eps), 2.0 * self.length_scale * math.sqrt(r2)
        return None

    @property
    def nonlinear_critical_speed(self) -> float | None:
        """v_n, m/s: below it hunting dies out whatever the disturbance; None without a fold."""
        fold = self.saddle_node()
        return None if fold is None else fold[0]

    @property
    def hysteresis_width(self) -> float | None:
        """v_c - v_n, m/s; None without a fold."""
        speed = self.nonlinear_critical_speed
        return None if speed is None else self.critical_speed - speed


def real_roots(a: Any, b: Any, c: Any) -> NDArray[np.float64]:
    """
    Real roots of a x^2 + b x + c, shape (2, ...); NaN or infinite where there is none.

    References
    ----------
    Press, W. H., et al., Numerical Recipes (2007), Sect. 5.6: without cancellation.
    """
    with np.errstate(all='ignore'):
        q = -0.5 * (b + np.copysign(np.sqrt(b * b - 4.0 * a * c), b))
        return np.stack([q / a, c / q])


def steady_radii(
    rest: NDArray[np.float64], cubic: NDArray[np.float64], quintic: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Where the growth rate rest + cubic r^2 + quintic r^4 is zero, Eq. (28).

    Parameters
    ----------
    rest, cubic, quintic : ndarray, of one shape
        In units of one another.

    Returns
    -------
    unstable, stable : ndarray, of that shape
        r, the growth rate rising and falling there; NaN where there is none.
    """
    squares = real_roots(quintic, cubic, rest)
    with np.errstate(all='ignore'):
        slope = cubic + 2.0 * quintic * squares
        radii = np.sqrt(np.where((squares > 0.0) & (squares < math.inf), squares, math.nan))
        unstable, stable = (np.where(sign * slope > 0.0, radii, math.nan) for sign in (1.0, -1.0))
    return np.fmax(*unstable), np.fmax(*stable)


#: Coefficients (33) as published, with D1 = 0.12 and the scales of Table 1.
PAPER_NORMAL_FORM = NormalForm(
    critical_speed=8.0, D1=0.12, D4=2030.0, D7=-0.06, D10=-360.0, D15=-4.2e7
)
