"""
Spectra of the quiet response over the levels of a run, and the fit of a damping law to them.

A law says, from a few global parameters, how the modes of the response to broadband
excitation go with speed (`damping_laws`); here that becomes what a periodogram of
finite length is expected to show, and the parameters of the largest likelihood.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hunt_ros.forecast.levels import SpeedLevel
from hunt_ros.samples import NORMAL_95, Uncertain

_F = NDArray[np.float64]

#: A fit is not refined with fewer bins than this.
FEWEST_BINS = 30
#: Share of a bin that must not be leakage.
OWN = 0.9
#: Of each parameter: step of its derivative, and the farthest it goes at once. Parameters are
#: logarithms, or of the order of 1.
_STEP, _FAR = 1e-5, 0.5
#: Decay times in a window beyond which its bins count as independent.
INDEPENDENT = 15.0


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

    def cost_of(self, expected: _F) -> float:
        """Return -ln of Whittle's likelihood of the periodogram expected, shape (bins,)."""
        return float(np.sum(self.weight * (np.log(expected) + self.power / expected)))

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


def own_bins(law: ResponseLaw, spectra: Spectra, theta: NDArray[np.float64]) -> NDArray[np.bool_]:
    """
    Return which bins show their own frequency, and not leakage.

    Far from a peak the spectrum of a wheelset falls faster than the leakage of a finite
    window. Leakage comes from the two ends of the window: however many bins it fills, it
    is one draw, which a likelihood of independent bins would take for as many witnesses.

    Returns
    -------
    ndarray of bool, shape (bins,)
        True where spectrum and noise make up at least `OWN` of what is expected.
    """
    modes = law.modes(spectra.speed, theta)
    expected = expected_periodogram(law, spectra, theta)
    if modes is None or expected is None:
        return np.ones(spectra.omega.size, dtype=np.bool_)
    own = spectra.of_modes(*modes, leakage=False) * spectra.gain + math.exp(theta[-1])
    return np.asarray(own >= OWN * expected, dtype=np.bool_)


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


class Whittle:
    """
    Minus the logarithm of likelihood times prior of a law, and where it is least.

    The bins of a periodogram are nearly independent, and distributed about the expected spectrum
    as an exponential variable: the likelihood needs the expectation alone (Whittle 1953, J. R.
    Stat. Soc. B 15, 125-139).

    Parameters
    ----------
    law : ResponseLaw
        Makes of parameters, shape (p,), the expected spectrum; and their priors.
    spectra : Spectra
        What was measured.
    """

    def __init__(self, law: ResponseLaw, spectra: Spectra) -> None:
        self._law, self._spectra = law, spectra

    def _expected(self, theta: _F) -> _F | None:
        return expected_periodogram(self._law, self._spectra, theta)

    def cost(self, theta: _F) -> float:
        """Return -ln of likelihood times prior; infinite where there is none."""
        expected = self._expected(theta)
        if expected is None:
            return math.inf
        off = (theta - self._law.prior_mean) / self._law.prior_std
        total = self._spectra.cost_of(expected) + 0.5 * float(np.sum(off**2))
        return total if math.isfinite(total) else math.inf

    def slopes(self, theta: _F) -> tuple[_F, _F, _F]:
        """
        Derivatives at parameters that have a likelihood.

        Returns
        -------
        gradient : ndarray, shape (p,)
            Of the cost.
        information : ndarray, shape (p, p)
            Fisher's, with that of the prior.
        relative : ndarray, shape (p, n)
            Derivatives of ln of the spectrum.
        """
        expected = self._expected(theta)
        assert expected is not None
        relative = np.zeros((theta.size, expected.size))
        for k in range(theta.size):
            for step in (_STEP, -_STEP):
                moved = theta.copy()
                moved[k] += step
                there = self._expected(moved)
                if there is not None:
                    relative[k] = (there - expected) / (step * expected)
                    break
        law, weight = self._law, self._spectra.weight
        gradient = relative @ (weight * (1.0 - self._spectra.power / expected))
        gradient += (theta - law.prior_mean) / law.prior_std**2
        information = (weight * relative) @ relative.T + np.diag(law.prior_std**-2.0)
        return gradient, information, relative

    def least(self, theta: _F, evaluations: int = 60) -> _F | None:
        """
        Return the parameters of least cost near others; None where those have no likelihood.

        Fisher's scoring, damped as by Levenberg and Marquardt.
        """
        cost, damping = self.cost(theta), 1e-2
        if not math.isfinite(cost):
            return None
        while evaluations > 0:
            gradient, information, _ = self.slopes(theta)
            # A parameter of no influence must not make it singular.
            scale = np.diag(np.maximum(np.diag(information), 1e-12))
            gain = 0.0
            while gain <= 0.0 and damping < 1e8 and evaluations > 0:
                step = np.linalg.solve(information + damping * scale, -gradient)
                moved = theta + np.clip(step, -_FAR, _FAR)
                gain = cost - self.cost(moved)
                evaluations -= 1
                damping = max(damping / 5.0, 1e-9) if gain > 0.0 else max(damping * 5.0, 1e-6)
            if gain > 0.0:
                theta, cost = moved, cost - gain
            if gain < 1e-4:
                break
        return theta


@dataclass(frozen=True, eq=False)
class Fit:
    """
    Where the likelihood is largest, and how sharply.

    Parameters
    ----------
    theta : ndarray, shape (p,)
    covariance : ndarray, shape (p, p)
        Of theta: the inverse of Fisher information and prior; from `best_fit` with the
        correlation of neighbouring bins.
    cost : float
        Negative logarithm of likelihood times prior.
    misfit : float
        Mean square of the standardised residuals of groups of bins; 1 for the right law.
    expected : ndarray, shape (bins,)
        The periodogram expected, m^2 s.
    spectra : Spectra
        The bins used: from `best_fit`, without those that show leakage.
    """

    theta: NDArray[np.float64]
    covariance: NDArray[np.float64]
    cost: float
    misfit: float
    expected: NDArray[np.float64]
    spectra: Spectra


def fitted(
    law: ResponseLaw, spectra: Spectra, start: NDArray[np.float64], evaluations: int = 60
) -> Fit | None:
    """Return the fit of largest likelihood near `start`; None where that has none."""
    whittle = Whittle(law, spectra)
    theta = whittle.least(start, evaluations)
    expected = None if theta is None else expected_periodogram(law, spectra, theta)
    if theta is None or expected is None:
        return None
    covariance = np.asarray(np.linalg.inv(whittle.slopes(theta)[1]), dtype=np.float64)
    misfit = _misfit(spectra, expected)
    return Fit(theta, covariance, whittle.cost(theta), misfit, expected, spectra)


def best_fit(
    law: ResponseLaw, spectra: Spectra, before: NDArray[np.float64] | None = None
) -> Fit | None:
    """Return the best of the fits from all starts of the law, and from the fit `before`."""
    starts = [*law.starts(spectra), *([] if before is None else [before])]
    fits = [fit for fit in (fitted(law, spectra, start) for start in starts) if fit is not None]
    if not fits:
        return None
    best = min(fits, key=lambda fit: fit.cost)
    for _ in range(2):
        kept = own_bins(law, spectra, best.theta)
        if kept.sum() < FEWEST_BINS:
            break
        refined = fitted(law, spectra.only(kept), best.theta)
        if refined is None:
            break
        best = refined
    return replace(best, covariance=_covariance(law, best))


def _covariance(law: ResponseLaw, fit: Fit) -> NDArray[np.float64]:
    """
    Covariance of the estimate, with the correlation of neighbouring bins (Godambe 1960).

    H^-1 J H^-1 with J the variance of the score: equal to H^-1 for independent bins.
    """
    spectra = fit.spectra
    _, fisher, relative = Whittle(law, spectra).slopes(fit.theta)
    derivatives, inverse = relative.T, np.linalg.inv(fisher)
    modes = law.modes(spectra.speed, fit.theta)
    assert modes is not None  # theta was fitted
    score = np.diag(law.prior_std**-2.0)
    for level in range(spectra.speed.size):
        inside = spectra.level == level
        # The windows averaged in a level are independent: their weight counts once.
        pull = derivatives[inside] * np.sqrt(spectra.weight[inside])[:, None]
        slowest = float(np.min(-modes[0][level].real)) * float(spectra.duration[level])
        if slowest > INDEPENDENT:
            score += pull.T @ pull
        else:
            score += pull.T @ spectra.correlation_of_bins(level, *modes, fit.expected) @ pull
    return np.asarray(inverse @ score @ inverse, dtype=np.float64)


def _misfit(spectra: Spectra, expected: NDArray[np.float64], group: int = 24) -> float:
    """Mean square of (mean of power/expected - 1) in groups of bins, in its own deviations."""
    squares = []
    ratio = spectra.power / expected - 1.0
    for level in range(spectra.speed.size):
        inside = np.flatnonzero(spectra.level == level)
        for part in np.array_split(inside, max(inside.size // group, 1)):
            if part.size:
                weight = spectra.weight[part]
                squares.append(float((weight * ratio[part]).sum() ** 2 / weight.sum()))
    return float(np.mean(squares)) if squares else 0.0


def critical_interval(law: ResponseLaw, fit: Fit, fastest: float) -> Uncertain:
    """
    v_c with its 95 % interval.

    The interval is symmetric in ln(v_c / v' - 1) with v' = 0.9 times the highest speed
    seen, or v_c where that is lower: the further the extrapolation, the more it is open
    towards high speeds.
    """
    value = law.critical_speed(fit.theta)
    if not math.isfinite(value):
        return Uncertain(value, math.inf, 0.0, math.inf)
    reference = 0.9 * min(fastest, value)
    slope = np.empty(fit.theta.size)
    for k in range(slope.size):
        moved = fit.theta.copy()
        moved[k] += 1e-4
        slope[k] = math.log(law.critical_speed(moved) / value) / 1e-4
    spread = math.sqrt(max(float(slope @ fit.covariance @ slope), 0.0) * max(fit.misfit, 1.0))
    beyond = value / reference - 1.0
    scaled = spread * value / (reference * beyond)
    low, high = (
        reference * (1.0 + beyond * math.exp(sign * min(NORMAL_95 * scaled, 30.0)))
        for sign in (-1.0, 1.0)
    )
    return Uncertain(value, spread * value, low, high)
