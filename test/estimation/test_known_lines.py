"""Known lines in the tracker: any orders, and an angle that is known only by a speed."""

from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.estimation.kalman import HuntingTracker
from hunt_ros.estimation.tracker_config import Shaft, TrackerConfig

NOISE, LINE = 5e-6, 2e-4


def _track(tracker, orders, scale=1.0, seconds=30.0, rate=200.0, hunting=0.0, seed=0):
    """Run a tracker over lines of `orders` at 6.4 Hz, the angle told wrong by `scale`."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate)) / rate
    angle = 40.0 * time
    value = hunting * np.cos(2.0 * np.pi * 2.84 * time) + NOISE * rng.standard_normal(time.size)
    for order in orders:
        value += LINE * np.cos(order * angle + order)
    stamps = 1 + np.round(time * 1e9).astype(np.int64)
    sensor = np.zeros(time.size, dtype=np.int8)
    output = np.arange(10_000_000, int(stamps[-1]), 10_000_000)
    speed = np.full(time.size, 6.0)
    return tracker.update(stamps, sensor, value, scale * angle, speed, output)


@pytest.mark.parametrize('scale', [1.0, 1.005, 0.993])
@pytest.mark.parametrize('hunting', [0.0, 3e-4])
def test_the_phase_of_a_line_is_tracked_where_only_the_speed_is_known(scale, hunting) -> None:
    tracker = HuntingTracker(TrackerConfig(shafts=(Shaft((1.0, 2.0), 0.01),)))
    rows = _track(tracker, (1.0, 2.0), scale, hunting=hunting)[500:]
    assert abs(rows['lateral_amplitude'] - hunting).max() < 4.0 * NOISE
    np.testing.assert_allclose(rows['lateral_roughness'], LINE, rtol=0.1)


def test_a_third_line_is_an_entry_of_the_list() -> None:
    orders = (1.0, 1.7, 4.42)
    known = HuntingTracker(TrackerConfig(shafts=(Shaft(orders),)))
    assert _track(known, orders)['lateral_amplitude'][500:].max() < 4.0 * NOISE
    partly = HuntingTracker(TrackerConfig(shafts=(Shaft(orders[:1]),)))
    assert _track(partly, orders)['lateral_amplitude'][500:].max() > 8.0 * NOISE
