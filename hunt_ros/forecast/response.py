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
#: Bins whose residuals are summed up in a misfit.
_GROUP = 24


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
    ) -> _F:
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
        expected: _F,
    ) -> _F:
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
        correlation: _F = np.abs(joint / np.outer(root, root)) ** 2
        np.fill_diagonal(correlation, 1.0)
        return correlation


class ResponseLaw(Protocol):
    """A law with global parameters theta, each with a normal prior."""

    name: str
    prior_mean: _F
    prior_std: _F

    def band(self, levels: Sequence[SpeedLevel]) -> tuple[float, float]:
        """Return the band in which the law holds, Hz."""

    def starts(self, spectra: Spectra) -> list[_F]:
        """Return parameters from which the fit may set out."""

    def modes(
        self, speed: _F, theta: _F
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]] | None:
        """
        Return eigenvalues (1/s) and residues (m^2), each of shape (speeds, modes).

        They are those of the autocovariance sum_k c_k exp(lambda_k |tau|). None where theta
        makes no stationary response. The last of theta is the ln of the noise floor.
        """

    def critical_speed(self, theta: _F) -> float:
        """Return v_c, m/s; inf where the damping never vanishes."""

    def eigenvalue(self, theta: _F, speed: float) -> complex:
        """Return the eigenvalue of the hunting mode, 1/s."""


class Fit:
    """
    A law at some parameters, beside the spectra: what it expects, and how likely that is.

    The bins of a periodogram are nearly independent, and distributed about the expected spectrum
    as an exponential variable: the likelihood needs the expectation alone (Whittle 1953, J. R.
    Stat. Soc. B 15, 125-139).

    Parameters
    ----------
    law : ResponseLaw
    spectra : Spectra
        What was measured.
    theta : ndarray, shape (p,)
        Parameters of the law.

    Attributes
    ----------
    expected : ndarray, shape (bins,)
        The periodogram expected, its noise floor included, m^2 s.
    cost : float
        Minus the logarithm of likelihood times prior; infinite where theta makes no stationary
        response: then nothing else of the fit has a meaning.
    """

    def __init__(self, law: ResponseLaw, spectra: Spectra, theta: _F) -> None:
        self.law, self.spectra, self.theta = law, spectra, theta
        self.cost, expected = math.inf, self._expected(theta)
        self.expected: _F = spectra.power if expected is None else expected
        if expected is not None:
            off = (theta - law.prior_mean) / law.prior_std
            total = spectra.cost_of(expected) + 0.5 * float(np.sum(off**2))
            self.cost = total if math.isfinite(total) else math.inf

    def _spectrum(self, theta: _F, leakage: bool = True) -> _F | None:
        modes = self.law.modes(self.spectra.speed, theta)
        if modes is None:
            return None
        response = self.spectra.of_modes(*modes, leakage) * self.spectra.gain
        spectrum: _F = response + math.exp(theta[-1])
        return spectrum

    def _expected(self, theta: _F) -> _F | None:
        found = self._spectrum(theta)
        if found is None or not 0.0 < found.min() <= found.max() < math.inf:
            return None
        return found

    def slopes(self) -> tuple[_F, _F, _F]:
        """
        Derivatives by the parameters.

        Returns
        -------
        gradient : ndarray, shape (p,)
            Of the cost.
        information : ndarray, shape (p, p)
            Fisher's, with that of the prior.
        relative : ndarray, shape (p, n)
            Derivatives of ln of the spectrum.
        """
        theta, expected = self.theta, self.expected
        relative = np.zeros((theta.size, expected.size))
        for k in range(theta.size):
            for step in (_STEP, -_STEP):
                there = self._expected(_moved(theta, k, step))
                if there is not None:
                    relative[k] = (there - expected) / (step * expected)
                    break
        law, weight = self.law, self.spectra.weight
        gradient = relative @ (weight * (1.0 - self.spectra.power / expected))
        gradient += (theta - law.prior_mean) / law.prior_std**2
        information = (weight * relative) @ relative.T + np.diag(law.prior_std**-2.0)
        return gradient, information, relative

    def best(self, evaluations: int = 60) -> Fit:
        """
        Return the fit of least cost near this one; itself where it has no likelihood.

        Fisher's scoring, damped as by Levenberg and Marquardt.
        """
        fit, damping = self, 1e-2
        while evaluations > 0 and math.isfinite(fit.cost):
            gradient, information, _ = fit.slopes()
            # A parameter of no influence must not make it singular.
            scale = np.diag(np.maximum(np.diag(information), 1e-12))
            gain, moved = 0.0, fit
            while gain <= 0.0 and damping < 1e8 and evaluations > 0:
                step = np.linalg.solve(information + damping * scale, -gradient)
                moved = Fit(fit.law, fit.spectra, fit.theta + np.clip(step, -_FAR, _FAR))
                gain = fit.cost - moved.cost
                evaluations -= 1
                damping = max(damping / 5.0, 1e-9) if gain > 0.0 else max(damping * 5.0, 1e-6)
            if gain > 0.0:
                fit = moved
            if gain < 1e-4:
                break
        return fit

    def own_bins(self) -> NDArray[np.bool_]:
        """
        Return which bins show their own frequency, and not leakage, shape (bins,).

        Far from a peak the spectrum of a wheelset falls faster than the leakage of a finite
        window. Leakage comes from the two ends of the window: however many bins it fills, it
        is one draw, which a likelihood of independent bins would take for as many witnesses.
        Own are those of which spectrum and noise make up at least `OWN` of what is expected.
        """
        # It may be below 0 far from its peak: not own either.
        own = self._spectrum(self.theta, leakage=False)
        kept = self.expected > 0.0 if own is None else own >= OWN * self.expected
        return np.asarray(kept, dtype=np.bool_)

    @property
    def covariance(self) -> _F:
        """
        Covariance of theta, with the correlation of neighbouring bins (Godambe 1960).

        H^-1 J H^-1 with J the variance of the score: equal to H^-1 for independent bins.
        """
        spectra, (_, fisher, relative) = self.spectra, self.slopes()
        derivatives, inverse = relative.T, np.linalg.inv(fisher)
        modes = self.law.modes(spectra.speed, self.theta)
        assert modes is not None  # there is a likelihood
        score = np.diag(self.law.prior_std**-2.0)
        for level in range(spectra.speed.size):
            inside = spectra.level == level
            # The windows averaged in a level are independent: their weight counts once.
            pull = derivatives[inside] * np.sqrt(spectra.weight[inside])[:, None]
            slowest = float(np.min(-modes[0][level].real)) * float(spectra.duration[level])
            if slowest > INDEPENDENT:
                score += pull.T @ pull
            else:
                alike = spectra.correlation_of_bins(level, *modes, self.expected)
                score += pull.T @ alike @ pull
        return np.asarray(inverse @ score @ inverse, dtype=np.float64)

    @property
    def misfit(self) -> float:
        """Mean square of the standardised residuals of groups of bins; 1 for the right law."""
        spectra, squares = self.spectra, []
        ratio = spectra.power / self.expected - 1.0
        for level in range(spectra.speed.size):
            inside = np.flatnonzero(spectra.level == level)
            for part in np.array_split(inside, max(inside.size // _GROUP, 1)):
                if part.size:
                    weight = spectra.weight[part]
                    squares.append(float((weight * ratio[part]).sum() ** 2 / weight.sum()))
        return float(np.mean(squares)) if squares else 0.0

    def critical_speed(self, fastest: float) -> Uncertain:
        """
        Return v_c with its 95 % interval, m/s.

        The interval is symmetric in ln(v_c / v' - 1) with v' = 0.9 times the highest speed
        seen, or v_c where that is lower: the further the extrapolation, the more it is open
        towards high speeds.
        """
        value = self.law.critical_speed(self.theta)
        if not math.isfinite(value):
            return Uncertain(value, math.inf, 0.0, math.inf)
        reference = 0.9 * min(fastest, value)
        moved = (_moved(self.theta, k, 1e-4) for k in range(self.theta.size))
        slope = np.array([math.log(self.law.critical_speed(one) / value) / 1e-4 for one in moved])
        variance = max(float(slope @ self.covariance @ slope), 0.0)
        spread = math.sqrt(variance * max(self.misfit, 1.0))
        beyond = value / reference - 1.0
        scaled = spread * value / (reference * beyond)
        low, high = (
            reference * (1.0 + beyond * math.exp(sign * min(NORMAL_95 * scaled, 30.0)))
            for sign in (-1.0, 1.0)
        )
        return Uncertain(value, spread * value, low, high)


def _moved(theta: _F, k: int, step: float) -> _F:
    """Return parameters of which one is another."""
    moved: _F = theta.copy()
    moved[k] += step
    return moved


def best_fit(law: ResponseLaw, spectra: Spectra, before: _F | None = None) -> Fit | None:
    """
    Return the fit of largest likelihood, without the bins that show leakage; None: there is none.

    From all starts of the law, and from the parameters `before`.
    """
    starts = [*law.starts(spectra), *([] if before is None else [before])]
    fits = [Fit(law, spectra, start).best() for start in starts]
    best = min(fits, key=lambda fit: fit.cost, default=None)
    if best is None or math.isinf(best.cost):
        return None
    for _ in range(2):
        kept = Fit(law, spectra, best.theta).own_bins()
        if kept.sum() < FEWEST_BINS:
            break
        best = Fit(law, spectra.only(kept), best.theta).best()
    return best
