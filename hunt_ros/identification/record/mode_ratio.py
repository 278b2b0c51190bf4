"""The hunting mode as both sensors see it together: yaw over lateral, in windows at one speed."""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from hunt_ros.identification.record.envelope import Envelope

#: Instants of the envelope in a window, twelve cycles of hunting, and independent ones among them
#: after smoothing.
_WINDOW, _INDEPENDENT = 8, 3.0
#: Neighbouring instants are averaged: the hunting is a narrow line, other motion is not.
_SMOOTH = np.array([0.25, 0.5, 0.25])
#: Known to this at least, relative, or the ratio is not clear of the noise, which biases it.
_CLEAR = 0.17
#: The speed of a window changes by less than this part, as in a slow sweep: the modes change by
#: as little.
_SAME_SPEED = 0.02
#: One window: mean speed, m/s; lateral amplitude, m; yaw over lateral phasor, rad/m; its relative
#: standard deviation; frequency, Hz.
RATIO = np.dtype(
    [
        ('speed', np.float64),
        ('amplitude', np.float64),
        ('ratio', np.complex128),
        ('relative_std', np.float64),
        ('frequency_hz', np.float64),
    ]
)


def measured_ratio(envelope: Envelope) -> NDArray[np.void]:
    """
    Yaw over lateral phasor of the hunting, whatever drives it, in windows that overlap by half.

    Returns
    -------
    ndarray of RATIO, shape (n,)
        Where both sensors show it clear of their noise; empty where one is missing or stands
        still.
    """
    if envelope.time.size < _WINDOW + 2:
        return np.zeros(0, dtype=RATIO)
    series = envelope.phasor, envelope.yaw, envelope.speed, envelope.frequency
    lateral, yaw, speed, frequency = (
        sliding_window_view(np.convolve(one, _SMOOTH, 'valid'), _WINDOW)[:: _WINDOW // 2]
        for one in series
    )
    measured = np.zeros(len(lateral), dtype=RATIO)
    power = np.square(np.abs(lateral)).sum(axis=1)
    cross = np.sum(yaw * lateral.conj(), axis=1)
    turned = np.sum(lateral[:, 1:] * lateral[:, :-1].conj(), axis=1)
    with np.errstate(all='ignore'):
        # What of yaw is not the lateral motion times one number is noise.
        noise = power * np.square(np.abs(yaw)).sum(axis=1) / np.square(np.abs(cross)) - 1.0
        measured['relative_std'] = np.sqrt(np.maximum(noise, 0.0) / (2.0 * (_INDEPENDENT - 1.0)))
        measured['ratio'] = cross / power
    measured['amplitude'] = np.sqrt(power / _WINDOW)
    measured['speed'] = speed.mean(axis=1)
    measured['frequency_hz'] = frequency.mean(axis=1) + np.angle(turned) / (
        2.0 * math.pi * envelope.step
    )
    steady = np.ptp(speed, axis=1) < _SAME_SPEED * measured['speed']
    clear: NDArray[np.void] = measured[steady & (measured['relative_std'] < _CLEAR)]
    return clear
