"""A reading that repeats says something only where the motion exceeds the steps of the sensor."""

from __future__ import annotations

import numpy as np
import pytest
from made import record_of

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, detect, health

RATE, STEP = 200.0, 1e-6
CONFIG = DetectorConfig(channels=('lateral', 'speed'))


def stuck(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return seconds and True where the lateral sensor is said to be stuck, at the rows."""
    record = record_of((np.arange(values.size) + 1) / RATE, lateral=values, speed=6.0)
    rows = detect(HuntingDetector(CONFIG), record).estimates
    wrong = (rows['lateral_wrong'] & health.STUCK) != 0
    assert (rows['level'][wrong] == Level.STALE).all()
    return rows['stamp_ns'] * 1e-9, wrong


def read(motion: np.ndarray, seed: int = 0, noise: float = 0.1 * STEP) -> np.ndarray:
    """Return what a sensor with steps reads of a motion, m."""
    noisy = motion + noise * np.random.default_rng(seed).standard_normal(motion.size)
    return STEP * np.round(noisy / STEP)


@pytest.mark.parametrize('offset', [0.1, 0.25, 0.4, 0.5])
@pytest.mark.parametrize('amplitude', [0.0, 0.3, 0.6])
def test_a_sensor_with_coarse_steps_at_rest_is_not_stuck(offset: float, amplitude: float) -> None:
    t = np.arange(round(20.0 * RATE)) / RATE
    # It moved before it came to rest: what its steps are is known from that.
    motion = STEP * (offset + 30.0 * np.exp(-2.0 * t) * np.cos(17.8 * t))
    values = read(motion + amplitude * STEP * np.cos(17.8 * t))
    seconds, wrong = stuck(values)
    assert not wrong[seconds > 1.0].any()


@pytest.mark.parametrize('noise', [0.1, 1.5])
def test_a_sensor_that_stops_in_the_middle_of_a_motion_is_stuck(noise: float) -> None:
    t = np.arange(round(10.0 * RATE)) / RATE
    values = read(20.0 * STEP * np.cos(17.8 * t), noise=noise * STEP)
    values[t > 6.0] = values[np.flatnonzero(t > 6.0)[0]]
    seconds, wrong = stuck(values)
    assert not wrong[seconds < 6.0].any()
    assert wrong[seconds > 6.3].all()


def test_a_sensor_that_never_moved_is_not_believed() -> None:
    seconds, wrong = stuck(np.zeros(round(5.0 * RATE)))
    assert wrong[seconds > 0.3].all()
