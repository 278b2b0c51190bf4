"""
The two damping laws that carry the damping seen to the speed where it vanishes.

Each says, from a few global parameters, how damping, frequency and strength of the
response to broadband excitation go with speed: one by the wheelset's own equations,
one by smoothness alone.

Both laws end at v_c, where a linear response has no bound. The cubic term of the normal
form gives it one, and is the last parameter before the noise floor: see `held_growth`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.forecast.levels import SpeedLevel
from hunt_ros.forecast.response import Spectra

#: d growth / d ln v at v_c over the hunting frequency: its order of magnitude, for the start of
#: a fit and for the unit of the cubic damping.
STEEPNESS = 0.17
#: Unit of the cubic damping, theta[-2], relative to (STEEPNESS omega)^2. The bend of the damping
#: near v_c is 2 sqrt(this) wide: 3 % of v_c, as of a quiet motion that has a quarter of the
#: unstable amplitude 5 % below v_c. Its prior has this deviation.
CUBIC = 3e-4
#: Relative standard deviation of stiffness ratio and conicity of a rig that is given.
TOLERANCE = 0.05


def held_growth(
    growth: NDArray[np.float64], cubic: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """
    Growth rate of the response that holds itself down, or up, by its own amplitude.

    Of a' = growth a + D |a|^2 a + noise the linear system that behaves most alike has the
    growth rate growth + 2 D <|a|^2> (statistical linearisation), and <|a|^2> goes inversely
    with it: r = growth - c / (-r), with c = -2 D times the intensity of the noise.

    Parameters
    ----------
    growth : ndarray
        Of the linear law, 1/s; positive beyond v_c.
    cubic : ndarray
        c, 1/s^2: positive where larger motion is damped more (supercritical), negative where
        it is damped less.

    Returns
    -------
    ndarray or None
        r, 1/s, negative; None where some response does not stay: it escapes.

    References
    ----------
    Roberts and Spanos 1990, Random vibration and statistical linearization.
    """
    inside = growth * growth + 4.0 * cubic
    if inside.min() < 0.0:
        return None
    rate: NDArray[np.float64] = 0.5 * (growth - np.sqrt(inside))
    return rate if rate.max() < 0.0 else None


def cubic_unit(omega: NDArray[np.float64], intensity: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the unit of c of `held_growth` at each speed, 1/s^2.

    Parameters
    ----------
    omega : ndarray, shape (m,)
        Angular frequency of the hunting mode, rad/s.
    intensity : ndarray, shape (m,)
        Of the noise that drives it, in any unit: c is proportional to it.
    """
    unit: NDArray[np.float64] = CUBIC * (STEEPNESS * omega) ** 2 * intensity / np.mean(intensity)
    return unit


class WheelsetLaw:
    """
    The wheelset's own law: Eqs. (2), (3) with white yaw forcing.

    theta = (ln d11, ln d22, ln k11, ln of the conicity coupling k21/d22, ln wn, power
    of v in wn, cubic damping in its unit, ln of the noise floor). Stiffness and conicity are
    those of the rig within `TOLERANCE`; the creep coefficients are free.

    Parameters
    ----------
    rig : RigParameters
        Geometry, stiffness and masses; its creep coefficients are only a first guess.
    channel : 'lateral' or 'yaw'
        Which of the two was measured.
    """

    name = 'wheelset'

    def __init__(self, rig: RigParameters, channel: str = 'lateral') -> None:
        self._rig = rig
        self._lateral = channel == 'lateral'
        self._guess = (math.log(rig.d11), math.log(rig.d22))
        coupling = rig.k21 / rig.d22
        wide = 10.0
        self.prior_mean = np.array(
            [*self._guess, math.log(rig.k11), math.log(coupling), -11.0, 0.0, 0.0, -28.0]
        )
        self.prior_std = np.array([1.5, 1.5, TOLERANCE, TOLERANCE, wide, 0.5, 1.0, wide])

    def band(self, levels: Sequence[SpeedLevel]) -> tuple[float, float]:
        """Return a band around both natural frequencies, between which hunting lies (B-1)."""
        rates = (self._rig.lateral_frequency_rad_per_s, self._rig.yaw_frequency_rad_per_s)
        return 0.7 * min(rates) / (2.0 * math.pi), 1.5 * max(rates) / (2.0 * math.pi)

    def starts(self, spectra: Spectra) -> list[NDArray[np.float64]]:
        """Return the best three of a grid of creep coefficients, each with fitted strength."""
        tried = []
        for shift11 in (-0.8, 0.0, 0.8):
            for shift22 in (-0.8, 0.0, 0.8):
                theta = self.prior_mean.copy()
                theta[0] += shift11
                theta[1] += shift22
                theta[4], theta[-1] = 0.0, math.log(spectra.floor)
                modes = self.modes(spectra.speed, theta)
                if modes is None:
                    continue
                signal = np.maximum(spectra.of_modes(*modes) * spectra.gain, 1e-300)
                excess = max(float(np.sum(spectra.power - spectra.floor)), 0.0)
                ratio = max(excess, 0.01 * float(np.sum(spectra.power))) / float(np.sum(signal))
                theta[4] = 0.5 * math.log(ratio)
                tried.append((spectra.cost_of(ratio * signal + spectra.floor), theta))
        tried.sort(key=lambda pair: pair[0])
        return [theta for _, theta in tried[:3]]

    def _polynomial(
        self, theta: NDArray[np.float64], speed: NDArray[np.float64]
    ) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64]]:
        """Dimensionless eigenvalues (m, 4) and the two dampings d/v* (m,)."""
        d11, d22, k11, coupling = np.exp(theta[:4])
        reduced = speed / self._rig.speed_scale
        a, b = d11 / reduced, d22 / reduced
        matrix = np.zeros((speed.size, 4, 4))
        matrix[:, 0, 1] = matrix[:, 2, 3] = 1.0
        matrix[:, 1, 0], matrix[:, 1, 1], matrix[:, 1, 2] = -k11, -a, d11
        matrix[:, 3, 0], matrix[:, 3, 2], matrix[:, 3, 3] = -d22 * coupling, -1.0, -b
        return np.linalg.eigvals(matrix).astype(np.complex128), a, b

    def modes(
        self, speed: NDArray[np.float64], theta: NDArray[np.float64]
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]] | None:
        """
        Modes of y = d11 w / p(s) or psi = (s^2 + s d11/v* + k11) w / p(s).

        p(s) is the characteristic polynomial, w the forcing; the residues of a spectrum
        n(s) n(-s) wn^2 / (p(s) p(-s)) are n(lambda) n(-lambda) wn^2 / (p'(lambda) p(-lambda)).
        """
        rate, a, b = self._polynomial(theta, speed)
        d11, d22, k11, coupling = np.exp(theta[:4])
        a, b = a[:, None], b[:, None]
        lateral, yaw = rate**2 + a * rate + k11, rate**2 + b * rate + 1.0
        slope = (2.0 * rate + a) * yaw + lateral * (2.0 * rate + b)
        lateral_mirrored = rate**2 - a * rate + k11
        mirrored = lateral_mirrored * (rate**2 - b * rate + 1.0) + d11 * d22 * coupling
        strength = np.exp(
            2.0 * (theta[4] + theta[5] * np.log(speed / self._rig.speed_scale / 5.0))
        )
        gain = (d11 * self._rig.length_scale) ** 2 if self._lateral else lateral * lateral_mirrored
        residue = gain * strength[:, None] / (slope * mirrored)
        growth = rate.real.max(axis=1)
        hunting = rate.real == growth[:, None]
        omega = np.abs(rate.imag).max(axis=1, where=hunting, initial=0.0)
        intensity = np.abs(residue * growth[:, None]).max(axis=1, where=hunting, initial=0.0)
        held = held_growth(growth, theta[6] * cubic_unit(omega, intensity))
        if held is None:
            return None
        rate = rate + np.where(hunting, (held - growth)[:, None], 0.0)
        residue = residue * np.where(hunting, (growth / held)[:, None], 1.0)
        return rate / self._rig.time_scale, residue

    def critical_speed(self, theta: NDArray[np.float64]) -> float:
        """v_c from (B-1): where the characteristic polynomial has the root i omega."""
        d11, d22, k11, coupling = np.exp(theta[:4])
        square = (d11 + d22 * k11) / (d11 + d22)
        below = (k11 - square) * (1.0 - square) + d11 * d22 * coupling
        if below <= 0.0:
            return math.inf
        return float(self._rig.speed_scale * math.sqrt(d11 * d22 * square / below))

    def eigenvalue(self, theta: NDArray[np.float64], speed: float) -> complex:
        """Eigenvalue of the least damped oscillation, 1/s."""
        rate = self._polynomial(theta, np.array([speed]))[0][0] / self._rig.time_scale
        return complex(max(rate[rate.imag >= 0.0], key=lambda value: value.real))


class SmoothLaw:
    """
    A law without a model: one damped mode whose damping is smooth in the speed.

    With u = v_c/v - 1: growth rate -s u (1 + kappa u), angular frequency
    omega_c (1 + f1 u + f2 u^2), strength a quadratic in ln v, and a skew of the peak in
    proportion to its width. kappa = 0 is the law a + b/v of a damping inversely
    proportional to speed, as creep gives it; its prior, 0 -/+ 0.2, is what the
    extrapolation takes for granted.
    theta = (ln v_c, ln s, kappa, ln omega_c, f1, f2, ln q, q1, q2, skew, cubic damping in its
    unit, ln floor).
    """

    name = 'smooth'

    def __init__(self) -> None:
        wide = 10.0
        self.prior_mean = np.array(
            [2.0, 1.0, 0.0, 3.0, 0.0, 0.0, -24.0, 0.0, 0.0, 0.0, 0.0, -28.0]
        )
        self.prior_std = np.array(
            [wide, wide, 0.2, wide, 0.3, 0.3, wide, 2.0, 1.0, 2.0, 1.0, wide]
        )
        self._reference = 1.0

    def band(self, levels: Sequence[SpeedLevel]) -> tuple[float, float]:
        """Return 0.6 to 1.4 times the frequency at which the fastest levels peak."""
        fastest = sorted(levels, key=lambda level: level.speed)[-3:]
        grid = np.linspace(fastest[-1].omega[0], fastest[-1].omega[-1], 400)
        total = np.zeros(grid.size)
        for level in fastest:
            # About a fifth of a hertz wide: narrower than the peak, wider than a bin.
            width = max(round(0.2 * level.duration_s), 1)
            held = np.convolve(level.weight, np.ones(width), 'same')
            power = np.convolve(level.periodogram * level.weight, np.ones(width), 'same')
            mean = np.divide(power, held, out=np.zeros_like(power), where=held > 0.3 * width)
            total += np.interp(grid, level.omega, mean)
        peak = float(grid[np.argmax(total)]) / (2.0 * math.pi)
        return 0.6 * peak, 1.4 * peak

    def starts(self, spectra: Spectra) -> list[NDArray[np.float64]]:
        """Return four guesses of v_c, the rest read off the spectra."""
        self._reference = float(np.mean(spectra.speed))
        fastest = spectra.level == int(np.argmax(spectra.speed))
        power = np.convolve(spectra.power[fastest], np.ones(5) / 5.0, 'same')
        peak = float(spectra.omega[fastest][np.argmax(power)])
        per_bin = float(np.mean(np.maximum(spectra.power - spectra.floor, 0.0)))
        result = []
        for beyond in (0.95, 1.05, 1.2, 1.6):
            theta = self.prior_mean.copy()
            theta[0] = math.log(beyond * float(np.max(spectra.speed)))
            theta[1], theta[3] = math.log(STEEPNESS * peak), math.log(peak)
            theta[6] = math.log(max(per_bin, 1e-3 * spectra.floor) * 2.0)
            theta[-2] = 1.0  # a response that stays, also beyond v_c
            theta[-1] = math.log(spectra.floor)
            result.append(theta)
        return result

    def _mode(
        self, theta: NDArray[np.float64], speed: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        u = math.exp(theta[0]) / speed - 1.0
        rate = -math.exp(theta[1]) * u * (1.0 + theta[2] * u)
        return rate, math.exp(theta[3]) * (1.0 + theta[4] * u + theta[5] * u**2)

    def modes(
        self, speed: NDArray[np.float64], theta: NDArray[np.float64]
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]] | None:
        """Return the one mode and its conjugate."""
        growth, omega = self._mode(theta, speed)
        if omega.min() <= 0.0:
            return None
        run = np.log(speed / self._reference)
        strength = np.exp(theta[6] + theta[7] * run + theta[8] * run**2)
        rate = held_growth(growth, theta[10] * cubic_unit(omega, strength))
        if rate is None:
            return None
        residue = strength / -rate * np.exp(1j * np.arctan(theta[9] * rate / omega))
        pair = np.stack([rate + 1j * omega, rate - 1j * omega], axis=1)
        return pair, np.stack([residue, residue.conj()], axis=1)

    def critical_speed(self, theta: NDArray[np.float64]) -> float:
        """v_c, which is a parameter."""
        return math.exp(theta[0])

    def eigenvalue(self, theta: NDArray[np.float64], speed: float) -> complex:
        """Eigenvalue of the mode, 1/s."""
        rate, omega = self._mode(theta, np.array([speed]))
        return complex(rate[0], omega[0])
