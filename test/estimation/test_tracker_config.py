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
