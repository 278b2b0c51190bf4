from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.estimation.kalman import HuntingTracker
from hunt_ros.estimation.tracker_config import ModePoint, TrackerConfig


def test_modes_are_interpolated_over_speed_and_held_at_the_ends(hunting_signal):
    config = TrackerConfig(
        modes=(
            ModePoint(6.0, 2.0, 4.0 + 0j),
            ModePoint(8.0, 3.0, 4.0j),
        )
    )
    signal = hunting_signal(0, duration=1.0, amplitude=0.0, roughness=0.0)
    for speed, frequency in ((5.0, 2.0), (7.0, 2.5), (9.0, 3.0)):
        signal.speed = np.full(signal.stamps.size, speed)
        rows, _ = signal.track(HuntingTracker(config), sensors=(0,))
        # With nothing to learn from, the frequency is the nominal one of that speed.
        assert rows['frequency_hz'][16] == pytest.approx(frequency)


def test_a_given_ratio_is_used_from_the_start(hunting_signal):
    ratio = 4.6 * np.exp(2.6j)
    signal = hunting_signal(0, duration=1.0, ratio=ratio)
    rows, _ = signal.track(HuntingTracker(TrackerConfig(modes=(ModePoint(0.0, 2.84, ratio),))))
    assert rows['yaw_ratio'][20] == pytest.approx(4.6)
    assert rows['yaw_lag'][20] == pytest.approx(2.6)
