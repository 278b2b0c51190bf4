"""
What no estimator can do better: Cramer-Rao bounds for the hunting signal after a kick.

The signal is A e^{s t} cos(2 pi f t + phi) with white noise; amplitude, phase, frequency and
growth rate are unknown, and so is the phasor of a decaying second mode in each sensor. What was
there before the kick, roughness and bias, is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Places of what is unknown.
AMPLITUDE, GROWTH = 0, 3
#: A window is sought up to so long, s.
_LONGEST_S = 20.0


@dataclass(frozen=True)
class SignalModel:
    """
    What is in the signal.

    Parameters
    ----------
    amplitude : float
        Of the lateral hunting motion, m.
    frequency_hz, growth_rate : float
        Hz, 1/s.
    lateral_noise : float
        Standard deviation of a sample, m.
    rate_hz : float
        Of both sensors, Hz.
    yaw_noise : float, optional
        rad; None: lateral only.
    yaw_ratio : complex
        Yaw over lateral phasor, rad/m, known.
    second_mode : tuple (frequency_hz, decay), optional
        Hz, 1/s: a mode that decays from the start of the window.
    """

    amplitude: float
    frequency_hz: float
    growth_rate: float
    lateral_noise: float
    rate_hz: float
    yaw_noise: float | None = None
    yaw_ratio: complex = 0j
    second_mode: tuple[float, float] | None = None


def std_bound(model: SignalModel, window_s: float, of: int = AMPLITUDE) -> float:
    """
    Least standard deviation at the end of a window, of the amplitude (m) or the growth rate (1/s).

    The mean square over eight phases of the motion; inf where the window does not determine it.
    """
    count = round(window_s * model.rate_hz)
    times = (np.arange(count) + 1.0 - count) / model.rate_hz  # 0 at the end
    total = 0.0
    for phase in 2.0 * math.pi * (np.arange(8) + 0.5) / 8:
        information = _information(model, times, float(phase))
        scale = np.sqrt(np.diag(information))
        scaled = information / np.outer(scale, scale)
        if np.linalg.cond(scaled) > 1e13:
            return math.inf
        total += float(np.linalg.inv(scaled)[of, of]) / float(scale[of]) ** 2
    return math.sqrt(total / 8)


def shortest_window(model: SignalModel, of: int, std: float) -> float:
    """Return the shortest window, s, that gives it to `std`; inf where 20 s are not enough."""
    low, high = 4.0 / model.rate_hz, _LONGEST_S
    if std_bound(model, high, of) > std:
        return math.inf
    while high - low > 0.5 / model.rate_hz:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if std_bound(model, middle, of) > std else (low, middle)
    return high


def _information(model: SignalModel, times: NDArray[Any], phase: float) -> NDArray[np.float64]:
    """Fisher information of (A, phi, omega, s, second mode of each sensor), times ending at 0."""
    channels = [(1.0 + 0j, model.lateral_noise)]
    if model.yaw_noise is not None:
        channels.append((complex(model.yaw_ratio), model.yaw_noise))
    pole = model.growth_rate + 2j * math.pi * model.frequency_hz
    beside = np.zeros((times.size, 0))
    if model.second_mode is not None:
        frequency, decay = model.second_mode
        shape = np.exp((-decay + 2j * math.pi * frequency) * (times - times[0]))
        beside = np.stack([shape.real, shape.imag], axis=1)
    slopes = []
    for k, (ratio, noise) in enumerate(channels):
        phasor = ratio * model.amplitude * np.exp(pole * times + 1j * phase)
        hunting = [phasor / model.amplitude, 1j * phasor, 1j * times * phasor, times * phasor]
        others = [beside if k == j else 0.0 * beside for j in range(len(channels))]
        slopes.append(np.concatenate([np.real(hunting).T, *others], axis=1) / noise)
    columns = np.concatenate(slopes)
    return columns.T @ columns
