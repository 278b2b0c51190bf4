from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.analysis.uniform import on_stamps, uniform
from hunt_ros.errors import IdentificationError
from hunt_ros.samples import Series

WALL = 1_700_000_000_000_000_000


def test_jitter_holes_and_repeats_are_interpolated():
    generator = np.random.default_rng(0)
    true = np.arange(2000) * 2_000_000
    stamps = WALL + true + generator.integers(-400_000, 400_000, 2000)
    values = np.sin((stamps - WALL) * 1e-9 * 17.0)
    values[generator.random(2000) < 0.05] = np.nan
    stamps[500] = stamps[499]
    stamps[700] = stamps[690]
    grid, found = uniform(Series(stamps, values))
    assert np.median(np.diff(grid)) == pytest.approx(2_000_000, rel=0.02)
    assert np.ptp(np.diff(grid)) <= 1
    assert found == pytest.approx(np.sin((grid - WALL) * 1e-9 * 17.0), abs=5e-3)


def test_a_slow_channel_is_brought_to_the_stamps_of_a_fast_one():
    slow = Series(WALL + np.arange(100) * 10_000_000, np.arange(100.0))
    fast = WALL + np.arange(900) * 1_000_000
    assert on_stamps(slow, fast) == pytest.approx(np.arange(900) / 10.0)
    assert np.isnan(on_stamps(Series(fast[:0], np.zeros(0)), fast)).all()


def test_too_little_or_too_full_of_holes_is_refused():
    stamps = np.arange(100) * 1_000_000
    with pytest.raises(IdentificationError, match='7 usable'):
        uniform(Series(stamps[:7], np.zeros(7)))
    holes = np.ones(100)
    holes[30:70] = np.nan
    with pytest.raises(IdentificationError, match='gaps'):
        uniform(Series(stamps, holes))
