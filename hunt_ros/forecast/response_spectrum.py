"""
Expected spectra of the quiet response over the levels of a run, for any damping law.

A law says, from a few global parameters, how the modes of the response to broadband
excitation go with speed (`damping_laws`); here that becomes what a periodogram of
finite length is expected to show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hunt_ros.forecast.level_spectrum import SpeedLevel


class Spectra:
    """
    The levels of a run as flat arrays, bin after bin.

    Parameters
    ----------
    levels : sequence of SpeedLevel
    low_hz, high_hz : float
        Band that is used, Hz.
    """

    def __init__(self, levels: Sequence[SpeedLevel], low_hz: float, high_hz: float) -> None:
        keep = [
            (level.omega >= 2.0 * math.pi * low_hz)
            & (level.omega <= 2.0 * math.pi * high_hz)
            & (level.weight > 0.0)
            for level in levels
        ]
        pairs = list(zip(levels, keep, strict=True))
        self.speed = np.array([level.speed for level in levels])
        self.duration = np.array([level.duration_s for level in levels])
        self.floor = float(np.median([level.floor for level in levels])) if levels else math.nan
        self.level = np.repeat(np.arange(len(levels)), [int(k.sum()) for k in keep])
        self.omega = np.concatenate([level.omega[k] for level, k in pairs])
        self.power = np.concatenate([level.periodogram[k] for level, k in pairs])
        self.weight = np.concatenate([level.weight[k] for level, k in pairs])
        self.gain = np.concatenate([level.gain[k] for level, k in pairs])

    def only(self, kept: NDArray[np.bool_]) -> Spectra:
        """Return the same levels with some of their bins."""
        part = copy(self)
        for name in ('level', 'omega', 'power', 'weight', 'gain'):
            setattr(part, name, getattr(self, name)[kept])
        return part

    def of_modes(
        self,
        eigenvalues: NDArray[np.complex128],
        residues: NDArray[np.complex128],
        leakage: bool = True,
    ) -> NDArray[np.float64]:
        """
        Expected periodogram of a stationary process, each level over its own window.

        The autocovariance is sum_k c_k exp(lambda_k |tau|). The window is finite, and a
        weakly damped peak may be narrower than its resolution; the expectation holds the
        leakage exactly (Sykulski, Olhede, Guillaumin, Lilly and Early 2019, The debiased
        Whittle likelihood, Biometrika 106, 251-266, Lemma 1, for continuous time).

        Parameters
        ----------
        eigenvalues, residues : ndarray of complex, shape (levels, modes)
            lambda_k (1/s) and c_k (m^2); complex ones in conjugate pairs.
        leakage : bool
            False for the spectrum itself, as a window without end would show it.

        Returns
        -------
        ndarray, shape (bins,)
            m^2 s, two-sided.
        """
        total = np.zeros(self.omega.size)
        span = self.duration[self.level]
        for k in range(eigenvalues.shape[1]):
            rate, residue = eigenvalues[:, k], residues[:, k]
            # At Fourier frequencies exp(z T) = exp(lambda T): one number a level.
            decay = np.exp(rate * self.duration)[self.level]
            z = rate[self.level] - 1j * self.omega
            if not leakage:
                total += 2.0 * np.real(-residue[self.level] / z)
                continue
            total += 2.0 * np.real(residue[self.level] * (decay - 1.0 - z * span) / (z * z * span))
        return total

    def correlation_of_bins(
        self,
        level: int,
        eigenvalues: NDArray[np.complex128],
        residues: NDArray[np.complex128],
        expected: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """
        Correlation of the periodogram between the bins of one level.

        Bins are independent only where the window is long against the decay; a peak
        narrower than a bin moves its neighbours together. For a Gaussian process it is
        |E X_j conj(X_k)|^2 / (S_j S_k), and E X_j conj(X_k), j unequal k, is the sum of
        c (exp(lambda T) - 1) [1/(z_j z_k) + 1/(w_j w_k)] / T over the modes, with
        z = lambda - i omega and w = lambda + i omega.

        Parameters
        ----------
        level : int
            Which.
        eigenvalues, residues : ndarray of complex, shape (levels, modes)
            As in `of_modes`.
        expected : ndarray, shape (bins,)
            S, of all levels.

        Returns
        -------
        ndarray, shape (n, n)
        """
        inside = self.level == level
        omega, root = self.omega[inside], np.sqrt(expected[inside] / self.gain[inside])
        span = self.duration[level]
        joint = np.zeros((omega.size, omega.size), dtype=np.complex128)
        for rate, residue in zip(eigenvalues[level], residues[level], strict=True):
            below, above = 1.0 / (rate - 1j * omega), 1.0 / (rate + 1j * omega)
            factor = residue * (np.exp(rate * span) - 1.0) / span
            joint += factor * (np.outer(below, below) + np.outer(above, above))
        correlation: NDArray[np.float64] = np.abs(joint / np.outer(root, root)) ** 2
        np.fill_diagonal(correlation, 1.0)
        return correlation


def expected_periodogram(
    law: ResponseLaw, spectra: Spectra, theta: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """
    Expected periodogram of the response over its noise floor.

    Returns
    -------
    ndarray, shape (bins,), or None
        m^2 s; None where theta makes no stationary response.
    """
    modes = law.modes(spectra.speed, theta)
    if modes is None:
        return None
    expected: NDArray[np.float64] = spectra.of_modes(*modes) * spectra.gain + math.exp(theta[-1])
    return expected if expected.min() > 0.0 and np.all(np.isfinite(expected)) else None


def own_bins(
    law: ResponseLaw, spectra: Spectra, theta: NDArray[np.float64], share: float = 0.9
) -> NDArray[np.bool_]:
    """
    Return which bins show their own frequency, and not leakage.

    Far from a peak the spectrum of a wheelset falls faster than the leakage of a finite
    window. Leakage comes from the two ends of the window: however many bins it fills, it
    is one draw, which a likelihood of independent bins would take for as many witnesses.

    Returns
    -------
    ndarray of bool, shape (bins,)
        True where spectrum and noise make up at least `share` of what is expected.
    """
    modes = law.modes(spectra.speed, theta)
    expected = expected_periodogram(law, spectra, theta)
    if modes is None or expected is None:
        return np.ones(spectra.omega.size, dtype=np.bool_)
    own = spectra.of_modes(*modes, leakage=False) * spectra.gain + math.exp(theta[-1])
    return np.asarray(own >= share * expected, dtype=np.bool_)


class ResponseLaw(Protocol):
    """A law with global parameters theta, each with a normal prior."""

    name: str
    prior_mean: NDArray[np.float64]
    prior_std: NDArray[np.float64]

    def band(self, levels: Sequence[SpeedLevel]) -> tuple[float, float]:
        """Return the band in which the law holds, Hz."""

    def starts(self, spectra: Spectra) -> list[NDArray[np.float64]]:
        """Return parameters from which the fit may set out."""

    def modes(
        self, speed: NDArray[np.float64], theta: NDArray[np.float64]
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]] | None:
        """
        Return eigenvalues (1/s) and residues (m^2), each of shape (speeds, modes).

        They are those of the autocovariance sum_k c_k exp(lambda_k |tau|). None where theta
        makes no stationary response. The last of theta is the ln of the noise floor.
        """

    def critical_speed(self, theta: NDArray[np.float64]) -> float:
        """Return v_c, m/s; inf where the damping never vanishes."""

    def eigenvalue(self, theta: NDArray[np.float64], speed: float) -> complex:
        """Return the eigenvalue of the hunting mode, 1/s."""
