"""A motion that the filter does not follow is never OK, wherever its frequency lies."""

from __future__ import annotations

import numpy as np
import pytest
from made import record_of

from hunt_ros.detection import DetectorConfig, HuntingDetector, detect
from hunt_ros.detection.regions import Level
from hunt_ros.detection.words import reasons

RATE, AMPLITUDE, YAW_RATIO = 100.0, 2e-3, 4.0
CONFIG = DetectorConfig(
    channels=('lateral', 'yaw', 'speed'),
    critical_speed_mps=50.0,
    nonlinear_critical_speed_mps=45.0,
    lines=(),
)


def rows_of(lateral: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Run the detector over both signals at a constant speed far below hunting."""
    record = record_of((np.arange(lateral.size) + 1) / RATE, lateral=lateral, yaw=yaw, speed=5.0)
    return detect(HuntingDetector(CONFIG), record).estimates


@pytest.mark.parametrize('hz', [1.0, 1.5, 2.84, 5.0, 5.5])
@pytest.mark.parametrize('noise', [6e-6, 50e-6])
def test_a_limit_cycle_is_never_ok(hz: float, noise: float) -> None:
    rng = np.random.default_rng(round(10 * hz))
    t = np.arange(round(50.0 * RATE)) / RATE
    # Quiet for 15 s, then grown to its full size in the time of ten turns.
    size = AMPLITUDE * np.exp(np.minimum((t - 15.0) * hz / 2.0 - 5.0, 0.0)) * (t > 15.0)
    turn = size * np.exp(2j * np.pi * hz * t)
    lateral = turn.real + noise * rng.normal(size=t.size)
    yaw = (YAW_RATIO * turn).imag + 5.0 * noise * rng.normal(size=t.size)
    rows = rows_of(lateral, yaw)
    full = rows['stamp_ns'] * 1e-9 > 15.0 + 10.0 / hz + 8.0
    assert (rows['level'][full] != Level.OK).all()
    lost = full & (rows['lateral_amplitude'] < 0.5 * AMPLITUDE) & (rows['level'] == Level.WARN)
    if lost.any():
        told = reasons.outside_words(rows[np.flatnonzero(lost)[-1]])
        assert 'set hunting_frequency_hz' in told
        assert rows['outside_hz'][lost][-1] == pytest.approx(hz, rel=0.1)


def test_what_only_rings_on_after_a_blow_is_no_motion() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(round(60.0 * RATE)) / RATE
    lateral, yaw = 6e-6 * rng.normal(size=(2, t.size))
    blow = (t > 20.0) & (t < 24.0)
    lateral[blow] += 20e-3 * rng.normal(size=blow.sum())
    rows = rows_of(lateral, yaw)
    seconds = rows['stamp_ns'] * 1e-9
    late = seconds > 34.0
    assert (rows['level'][late] == Level.OK).mean() > 0.95
