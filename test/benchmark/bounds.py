"""
What no estimator can do better: Cramer-Rao bounds for the hunting signal.

The signal is A e^{s t} cos(2 pi f t + phi), with white noise, on a background of
roughness lines, bias and a decaying second mode. The closed forms neglect the
background; `amplitude_std_bound` computes the Fisher information with all of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.errors import ConfigError


def sign_time_bound(
    growth_rate: float,
    amplitude: float,
    noise: float,
    step_s: float,
    sigmas: float = 3.0,
) -> float:
    """
    Least time to know the sign of a growth rate, s: where the bound meets |s| / sigmas.

    For |s| T << 1, amplitude and phase unknown: var(s) >= 24 sigma^2 dt / (A^2 T^3); Kay,
    Statistical Signal Processing: Estimation Theory, 1993, ch. 3.

    Parameters
    ----------
    growth_rate : float
        1/s, not zero.
    amplitude, noise : float
        A, and standard deviation of the white noise of a sample, in one unit.
    step_s : float
        Spacing of the samples, s.
    sigmas : float
        Standard deviations asked for.
    """
    return float(
        (24.0 * sigmas**2 * noise**2 * step_s / (amplitude**2 * growth_rate**2)) ** (1.0 / 3.0)
    )


@dataclass(frozen=True)
class SignalModel:
    """
    What is in the signal while its amplitude is being learnt; everything in it is unknown.

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
    roughness_hz : float, optional
        Frequency of the roller, known; its line and second harmonic have unknown phasors in
        each sensor. None: no roller.
    known_background : bool
        True where roughness and bias are known from before: the case of a kick.
    second_mode : tuple (frequency_hz, decay), optional
        A mode of unknown phasor in each sensor that decays from the start of the window.
    """

    amplitude: float
    frequency_hz: float
    growth_rate: float
    lateral_noise: float
    rate_hz: float
    yaw_noise: float | None = None
    yaw_ratio: complex = 0j
    roughness_hz: float | None = None
    known_background: bool = False
    second_mode: tuple[float, float] | None = None


def amplitude_std_bound(model: SignalModel, window_s: float, phases: int = 8) -> float:
    """
    Least standard deviation of the amplitude at the end of a window, m.

    Unknown are amplitude, phase, frequency and growth rate, and the background.

    Parameters
    ----------
    model : SignalModel
        The signal, and what of it is unknown.
    window_s : float
        s, at least two samples long.
    phases : int
        The mean square over this many phases of the hunting motion is taken.

    Returns
    -------
    float
        m; inf where the window does not determine the amplitude.

    Raises
    ------
    ConfigError
        For a window shorter than two samples.
    """
    return _bound(model, window_s, phases, _AMPLITUDE)


def amplitude_window(model: SignalModel, relative_std: float = 0.05) -> float:
    """
    Shortest window that gives the amplitude at its end to `relative_std`, s.

    Found by bisection between four samples and 20 s; inf where 20 s are not enough.
    """
    return _shortest(model, _AMPLITUDE, relative_std * model.amplitude)


def growth_window(model: SignalModel, std: float) -> float:
    """
    Shortest window that gives the growth rate to `std` (1/s), s.

    Found by bisection between four samples and 20 s; inf where 20 s are not enough.
    """
    return _shortest(model, _GROWTH, std)


_AMPLITUDE, _GROWTH = 0, 3


def _bound(model: SignalModel, window_s: float, phases: int, place: int) -> float:
    count = round(window_s * model.rate_hz)
    if count < 2:
        raise ConfigError(f'bound: a window of {window_s} s holds fewer than two samples')
    times = (np.arange(count) + 1.0 - count) / model.rate_hz  # 0 at the end
    total = 0.0
    for phase in 2.0 * math.pi * (np.arange(phases) + 0.5) / phases:
        information = _information(model, times, float(phase))
        scale = np.sqrt(np.diag(information))
        scaled = information / np.outer(scale, scale)
        if np.linalg.cond(scaled) > 1e13:
            return math.inf
        total += float(np.linalg.inv(scaled)[place, place]) / float(scale[place]) ** 2
    return math.sqrt(total / phases)


def _shortest(model: SignalModel, place: int, goal: float) -> float:
    low, high = 4.0 / model.rate_hz, 20.0
    if _bound(model, high, 8, place) > goal:
        return math.inf
    while high - low > 0.5 / model.rate_hz:
        middle = 0.5 * (low + high)
        if _bound(model, middle, 8, place) > goal:
            low = middle
        else:
            high = middle
    return high


def _information(model: SignalModel, times: NDArray[Any], phase: float) -> NDArray[np.float64]:
    """Fisher information of (A, phi, omega, s, background), times ending at 0."""
    channels = [(1.0 + 0j, model.lateral_noise)]
    if model.yaw_noise is not None:
        channels.append((complex(model.yaw_ratio), model.yaw_noise))
    decay = model.growth_rate + 2j * math.pi * model.frequency_hz
    blocks = []
    for ratio, noise in channels:
        phasor = ratio * model.amplitude * np.exp(decay * times + 1j * phase)
        columns = [
            (phasor / model.amplitude).real,
            (1j * phasor).real,
            (1j * times * phasor).real,
            (times * phasor).real,
        ]
        blocks.append((np.stack(columns, axis=1) / noise, _background(model, times) / noise))
    shared = sum((hunting.T @ hunting for hunting, _ in blocks), np.zeros((4, 4)))
    size = 4 + sum(back.shape[1] for _, back in blocks)
    information = np.zeros((size, size))
    information[:4, :4] = shared
    at = 4
    for hunting, back in blocks:
        end = at + back.shape[1]
        information[:4, at:end] = hunting.T @ back
        information[at:end, :4] = back.T @ hunting
        information[at:end, at:end] = back.T @ back
        at = end
    return information


def _background(model: SignalModel, times: NDArray[Any]) -> NDArray[np.float64]:
    """Columns of the unknown background of one sensor, shape (n, m)."""
    columns: list[NDArray[np.float64]] = []
    if not model.known_background:
        columns.append(np.ones_like(times))
        if model.roughness_hz is not None:
            for harmonic in (1, 2):
                turn = 2.0 * math.pi * harmonic * model.roughness_hz * times
                columns += [np.cos(turn), np.sin(turn)]
    if model.second_mode is not None:
        frequency, decay = model.second_mode
        shape = np.exp((-decay + 2j * math.pi * frequency) * (times - times[0]))
        columns += [shape.real, shape.imag]
    return np.stack(columns, axis=1) if columns else np.zeros((times.size, 0))
