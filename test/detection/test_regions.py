"""Regions: where the boundaries are, and that nothing chatters."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.detection import DetectorConfig
from hunt_ros.detection.regions import Region, region_of
from hunt_ros.detection.rows import RowMaker
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM

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


def test_below_a_fold_that_is_not_known_no_speed_is_called_stable() -> None:
    sample = np.tile(IdentifiedNormalForm(PAPER_NORMAL_FORM).vector, (64, 1))
    for without, fold in ((0, 6.406), (26, 0.0)):
        sample[:without, 5] = 0.0
        rows = RowMaker(DetectorConfig())
        rows.set_normal_form(
            IdentifiedNormalForm(PAPER_NORMAL_FORM, np.diag([1e-4] * 6), sample=sample)
        )
        assert rows.boundaries == pytest.approx((fold, 8.0), abs=1e-3)
