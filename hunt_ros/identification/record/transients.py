"""Free motion between the quiet state and the limit cycle, and how fast it grows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.analysis.steady_state import hunting_threshold
from hunt_ros.identification.record.envelope import Envelope
from hunt_ros.identification.record.segments import runs


def mean_growth(envelope: Envelope, start: int, end: int) -> tuple[float, float]:
    """Slope of ln A over the small part of a transient, and its deviation, 1/s."""
    amplitude, time = envelope.amplitude[start:end], envelope.time[start:end]
    small = amplitude < 0.5 * float(amplitude.max())
    if small.sum() < 5:
        return math.nan, math.nan
    line, covariance = np.polyfit(time[small], np.log(amplitude[small]), 1, cov=True)
    return float(line[0]), math.sqrt(float(covariance[0, 0]))


def find_transients(envelope: Envelope, kicked: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Stretches in which the amplitude is on its way from one state to another."""
    amplitude = envelope.amplitude
    threshold = hunting_threshold(amplitude)
    if threshold is None:
        return []
    logs = np.log(np.where(amplitude > 0.0, amplitude, np.nan))
    span = 6
    moving = np.zeros(amplitude.size, dtype=bool)
    for k in range(amplitude.size - span):
        piece = logs[k : k + span + 1]
        if np.isfinite(piece).all() and not kicked[k : k + span + 1].any():
            steps = np.diff(piece)
            drift = piece[-1] - piece[0]
            # A drift against the scatter of its own steps, and not a small one.
            if abs(drift) > 0.3 and abs(drift) > 2.0 * float(np.std(steps)) * math.sqrt(span):
                moving[k : k + span + 1] = True
    return [(a, b) for a, b in runs(moving) if np.nanmax(amplitude[a:b]) > 0.5 * threshold]
