from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.dynamics.mode_shape import ModeShape
from hunt_ros.estimation.kalman import HuntingTracker


def test_modes_are_interpolated_over_speed_and_held_at_the_ends(hunting_signal):
    none, ratio = np.zeros(1), np.array([[4.0], [4.0j]])
    shape = ModeShape(np.array([6.0, 8.0]), none, np.array([2.0, 3.0]), ratio, np.zeros((2, 1)))
    signal = hunting_signal(0, duration=1.0, amplitude=0.0, roughness=0.0)
    for speed, frequency in ((5.0, 2.0), (7.0, 2.5), (9.0, 3.0)):
        signal.speed = np.full(signal.stamps.size, speed)
        tracker = HuntingTracker()
        tracker.set_modes(shape)
        rows, _ = signal.track(tracker, sensors=(0,))
        # With nothing to learn from, the frequency is the nominal one of that speed.
        assert rows['frequency_hz'][16] == pytest.approx(frequency)
