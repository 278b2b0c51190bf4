"""
Hunting frequency against amplitude and speed: the coefficients of Eq. (25).

The phase of the normal form turns at a rate that changes with the amplitude; D4I is
how fast. It shows in the frequency of limit cycles at several speeds, and within one
transient through many amplitudes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from hunt_ros.analysis.uniform import checked
from hunt_ros.errors import IdentificationError
from hunt_ros.samples import Uncertain

#: Terms of Eq. (25) in the order in which they are taken up: powers of eps and of r^2.
TERMS: tuple[tuple[str, int, int], ...] = (
    ('omega', 0, 0),
    ('D4I', 0, 1),
    ('D1I', 1, 0),
    ('D15I', 0, 2),
    ('D10I', 1, 1),
    ('D7I', 2, 0),
)


@dataclass(frozen=True, eq=False)
class FrequencyLaw:
    """
    Coefficients of Eq. (25) that the data support.

    Parameters
    ----------
    coefficients : dict of str to Uncertain
        'omega', 'D4I', and of 'D1I', 'D15I', 'D10I', 'D7I' those that could be told apart;
        dimensionless (unit of time 1/omega_psi).
    residual_rms_hz : float
        What the law leaves unexplained, Hz.
    condition_number : float
        Of the scaled regression.
    time_scale, length_scale, critical_speed : float
        1/omega_psi (s), d0 (m), v_c (m/s) used.
    """

    coefficients: dict[str, Uncertain]
    residual_rms_hz: float
    condition_number: float
    time_scale: float
    length_scale: float
    critical_speed: float

    def frequency_hz(self, amplitude: ArrayLike, speed: ArrayLike) -> NDArray[np.float64]:
        """Return the hunting frequency, Hz, at amplitudes in m and speeds in m/s."""
        eps = np.asarray(speed, dtype=np.float64) / self.critical_speed - 1.0
        square = (np.asarray(amplitude, dtype=np.float64) / (2.0 * self.length_scale)) ** 2
        total = np.zeros(np.broadcast_shapes(eps.shape, square.shape))
        for name, power, half in TERMS:
            if name in self.coefficients:
                total = total + self.coefficients[name].value * eps**power * square**half
        return np.asarray(total / (2.0 * math.pi * self.time_scale), dtype=np.float64)


def amplitude_and_frequency(
    values: ArrayLike, rate_hz: float, band_hz: tuple[float, float], cycles: float = 4.0
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """
    Amplitude and frequency of the hunting component, window by window.

    The signal is band-passed without phase shift and made analytic; within each window
    the phase is fitted by a line, weighted by the squared amplitude.

    Parameters
    ----------
    values : array_like, shape (n,)
        Uniform samples of y, m, without the roughness line if that lies in the band.
    rate_hz : float
        Sample rate, Hz.
    band_hz : (float, float)
        Pass band around hunting, Hz.
    cycles : float
        Length of a window, hunting cycles.

    Returns
    -------
    times_s, amplitude, frequency_hz : ndarray, shape (m,)
        Middle of each window, s from the first sample; m; Hz.

    Raises
    ------
    IdentificationError
        For a record shorter than four windows.
    """
    array = checked(values, 64, 'frequency')
    low, high = band_hz
    sections = signal.butter(3, [low, high], 'bandpass', fs=rate_hz, output='sos')
    analytic = signal.hilbert(signal.sosfiltfilt(sections, array - array.mean()))
    size = max(round(cycles * rate_hz / math.sqrt(low * high)), 8)
    edge = round(1.5 * rate_hz / (high - low))  # where the filter still sees the ends
    count = (array.size - 2 * edge) // size
    if count < 4:
        raise IdentificationError(
            f'frequency: {array.size / rate_hz:.1f} s, expected at least'
            f' {(4 * size + 2 * edge) / rate_hz:.1f} s'
        )
    inside = analytic[edge : edge + count * size].reshape(count, size)
    power = np.abs(inside) ** 2
    phase = np.unwrap(np.angle(inside), axis=1)
    time = (np.arange(size) - 0.5 * (size - 1)) / rate_hz
    total = power.sum(axis=1)
    centre = (power @ time) / total
    away = time[None, :] - centre[:, None]
    slope = (power * away * phase).sum(axis=1) / (power * away**2).sum(axis=1)
    middle = np.asarray((edge + (np.arange(count) + 0.5) * size) / rate_hz, dtype=np.float64)
    frequency = np.asarray(slope / (2.0 * math.pi), dtype=np.float64)
    return middle, np.sqrt(total / size), frequency


def frequency_law(
    amplitude: ArrayLike,
    frequency_hz: ArrayLike,
    speed: ArrayLike,
    critical_speed: float,
    frequency_std: ArrayLike | None = None,
    length_scale: float = 0.0485,
    time_scale: float = 1.0 / 25.91,
) -> FrequencyLaw:
    """
    Regression of Eq. (25) on pairs of amplitude and frequency.

    Terms are taken up one by one while the data can tell them apart (condition number of
    the scaled regression below 30) and the Bayesian information criterion asks for them.

    Parameters
    ----------
    amplitude, frequency_hz, speed : array_like, shape (n,)
        m, Hz, m/s.
    critical_speed : float
        v_c, m/s, for eps.
    frequency_std : array_like, shape (n,), optional
        Standard deviation of each frequency, Hz; default: all alike.
    length_scale, time_scale : float
        d0 (m) and 1/omega_psi (s).

    Raises
    ------
    IdentificationError
        For fewer than four points, or amplitudes all alike: D4I cannot be known.

    References
    ----------
    The paper, Eq. (25).
    """
    size = checked(amplitude, 4, 'amplitude')
    rate = checked(frequency_hz, size.size, 'frequency') * 2.0 * math.pi * time_scale
    eps = checked(np.broadcast_to(speed, size.shape), size.size, 'speed') / critical_speed - 1.0
    weight = np.ones(size.size)
    if frequency_std is not None:
        weight = 1.0 / checked(frequency_std, size.size, 'frequency_std')
        weight /= math.sqrt(float(np.mean(weight**2)))
    square = (size / (2.0 * length_scale)) ** 2
    if float(np.ptp(square)) <= 0.05 * float(square.max()):
        raise IdentificationError(
            'frequency law: the amplitudes differ by less than 3 %, D4I cannot be known'
        )
    chosen: list[tuple[str, int, int]] = list(TERMS[:2])
    best = _regress(chosen, eps, square, rate, weight)
    for term in TERMS[2:]:
        trial = _regress([*chosen, term], eps, square, rate, weight)
        if trial[3] < 30.0 and trial[4] < best[4]:
            chosen, best = [*chosen, term], trial
    values, covariance, residual, condition, _ = best
    coefficients = {
        name: Uncertain(float(values[k]), math.sqrt(float(covariance[k, k])))
        for k, (name, _, _) in enumerate(chosen)
    }
    rms = float(np.sqrt(np.mean(residual**2))) / (2.0 * math.pi * time_scale)
    return FrequencyLaw(coefficients, rms, condition, time_scale, length_scale, critical_speed)


def _regress(
    terms: Sequence[tuple[str, int, int]],
    eps: NDArray[np.float64],
    square: NDArray[np.float64],
    rate: NDArray[np.float64],
    weight: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float, float]:
    """Values, covariance, residuals, condition number and information criterion."""
    count = rate.size
    columns = np.stack([eps**power * square**half for _, power, half in terms], axis=1)
    scaled = columns * weight[:, None]
    norms = np.linalg.norm(scaled, axis=0)
    if count <= len(terms) or np.any(norms == 0.0):
        return np.zeros(len(terms)), np.zeros((len(terms),) * 2), rate, math.inf, math.inf
    condition = float(np.linalg.cond(scaled / norms))
    values = np.linalg.lstsq(scaled / norms, rate * weight, rcond=None)[0] / norms
    residual = rate - columns @ values
    squares = max(float(np.sum((weight * residual) ** 2)), 1e-300)
    inverse = np.linalg.pinv(scaled.T @ scaled / np.outer(norms, norms)) / np.outer(norms, norms)
    criterion = count * math.log(squares / count) + len(terms) * math.log(count)
    return values, inverse * squares / (count - len(terms)), residual, condition, criterion
