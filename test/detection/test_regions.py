"""Regions: where the boundaries are, and that nothing chatters."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.detection.regions import Region, region_of

V_N, V_C, BAND = 6.4, 8.0, 0.05


@settings(deadline=None)
@given(st.sampled_from(list(Region)), st.floats(0.0, 20.0))
def test_the_region_is_that_of_the_boundaries_that_are_known(before: Region, speed: float) -> None:
    expected = (speed >= V_N) + (speed >= V_C) + 1
    assert region_of(Region.UNKNOWN, speed, V_N, V_C, BAND) == expected
    assert region_of(before, speed, math.nan, V_C, BAND) != Region.HYSTERESIS, 'no fold'
    assert region_of(before, math.nan, V_N, V_C, BAND) == Region.UNKNOWN
    assert region_of(before, speed, V_N, math.nan, BAND) == Region.UNKNOWN


@settings(deadline=None)
@given(st.lists(st.floats(-0.9 * BAND, 0.9 * BAND), min_size=3, max_size=50))
def test_noise_within_the_band_changes_the_region_at_most_once(noise: list[float]) -> None:
    for boundary in (V_N, V_C):
        region = int(region_of(Region.UNKNOWN, boundary - 0.2, V_N, V_C, BAND))
        seen = [region]
        for step in noise:
            region = region_of(region, boundary + step, V_N, V_C, BAND)
            seen.append(region)
        assert np.count_nonzero(np.diff(seen)) <= 1
