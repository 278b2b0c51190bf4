"""Regions and comparisons: where the boundaries are, and that nothing chatters."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.detection.regions import HELD, Region, hold, region_of, switched

V_N, V_C, BAND = 6.4, 8.0, 0.05


@settings(deadline=None)
@given(st.floats(0.0, 20.0))
def test_from_unknown_the_region_is_that_of_the_boundaries(speed: float) -> None:
    expected = (
        Region.UNSTABLE if speed >= V_C else Region.HYSTERESIS if speed >= V_N else Region.STABLE
    )
    assert region_of(Region.UNKNOWN, speed, V_N, V_C, BAND) == expected


@settings(deadline=None)
@given(st.sampled_from(list(Region)), st.floats(0.0, 20.0))
def test_without_a_fold_there_is_no_hysteresis_region(before: Region, speed: float) -> None:
    assert region_of(before, speed, math.nan, V_C, BAND) != Region.HYSTERESIS


def test_without_speed_or_critical_speed_the_region_is_unknown() -> None:
    assert region_of(Region.STABLE, math.nan, V_N, V_C, BAND) == Region.UNKNOWN
    assert region_of(Region.STABLE, 7.0, V_N, math.nan, BAND) == Region.UNKNOWN


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


def test_a_comparison_with_hysteresis_keeps_its_word_between_the_thresholds() -> None:
    assert switched(False, 3.1, 3.0, 2.0)
    assert switched(True, 2.5, 3.0, 2.0)
    assert not switched(False, 2.5, 3.0, 2.0)
    assert not switched(True, 1.9, 3.0, 2.0)
    assert switched(True, math.nan, 3.0, 2.0)


@settings(deadline=None)
@given(st.lists(st.sampled_from([0, 1]), max_size=60), st.integers(0, 8))
def test_a_word_is_taken_only_after_its_hold_time(wanted: list[int], rows: int) -> None:
    memory = np.zeros(1, dtype=HELD)[0]
    current, since = 0, 0
    for k, want in enumerate(wanted):
        if want == current:
            since = k + 1
        changed = hold(memory, want, rows, k)
        assert changed == (want != current and k - since >= rows)
        if changed:
            assert memory['since_ns'] == since
            current, since = want, k + 1
        assert memory['word'] == current
