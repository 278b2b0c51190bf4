"""The complex normal form, Eq. (22), and its two real coordinates."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.dynamics.normal_form import NormalForm


@dataclass(frozen=True)
class ComplexNormalForm:
    """
    Eq. (22) with complex coefficients, in the paper's coordinate.

    deta/dt* = i omega eta + D1 eps eta + D4 eta^2 conj(eta) + D7 eps^2 eta
    + D10 eps eta^2 conj(eta) + D15 eta^3 conj(eta)^2, with eta = r exp(i theta),
    and y* = 2 r cos(theta) at first order.

    Parameters
    ----------
    critical_speed : float
        v_c, m/s.
    omega : float
        Eq. (B-1), dimensionless.
    D1, D4, D7, D10, D15 : complex
        Dimensionless; D7, D10, D15 are the primed ones.
    w101, w210 : complex
        y* components of the resonant part of W: the fundamental amplitude of y*
        is 2 r |1 + w101 eps + w210 r^2 + ...|.
    length_scale, time_scale : float
        d0, m, and 1 / omega_psi, s.
    """

    critical_speed: float
    omega: float
    D1: complex
    D4: complex
    D7: complex
    D10: complex
    D15: complex
    w101: complex
    w210: complex
    length_scale: float
    time_scale: float

    @property
    def paper_coordinate(self) -> NormalForm:
        """The real form (24) in r of Eq. (23): exact in eta, but 2 d0 r is not quite y_amp."""
        return self._real(self.D10.real, self.D15.real)

    @property
    def amplitude_coordinate(self) -> NormalForm:
        """
        The real form in r = (fundamental amplitude of y) / (2 d0): compare this with measurements.

        With rho = r (1 + p eps + q r^2), p = Re w101 and q = Re w210, the growth
        rate of rho has D10 - 2 p D4 + 2 q D1 in place of D10. D1, D4, D7 and, at
        this order, Re D15 stay what they were.
        """
        p, q = self.w101.real, self.w210.real
        d10 = self.D10.real - 2.0 * p * self.D4.real + 2.0 * q * self.D1.real
        return self._real(d10, self.D15.real)

    def frequency_hz(self, speed: ArrayLike, amplitude: ArrayLike) -> NDArray[np.float64]:
        """
        Hunting frequency, Eq. (25), at a fundamental amplitude of y.

        Parameters
        ----------
        speed, amplitude : array_like
            m/s and m; broadcast.

        Returns
        -------
        ndarray
            Hz.
        """
        eps = np.asarray(speed, dtype=np.float64) / self.critical_speed - 1.0
        rho2 = (np.asarray(amplitude, dtype=np.float64) / (2.0 * self.length_scale)) ** 2
        r2 = rho2 * (1.0 - 2.0 * self.w101.real * eps - 2.0 * self.w210.real * rho2)
        rate: NDArray[np.float64] = (
            self.omega
            + self.D1.imag * eps
            + self.D4.imag * r2
            + self.D7.imag * eps**2
            + self.D10.imag * eps * rho2
            + self.D15.imag * rho2**2
        ) / (2.0 * math.pi * self.time_scale)
        return rate

    def _real(self, d10: float, d15: float) -> NormalForm:
        return NormalForm(
            critical_speed=self.critical_speed,
            D1=self.D1.real,
            D4=self.D4.real,
            D7=self.D7.real,
            D10=d10,
            D15=d15,
            length_scale=self.length_scale,
            time_scale=self.time_scale,
            frequency_hz=self.omega / (2.0 * math.pi * self.time_scale),
        )
