from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.analysis.day_spread import (
    DayAmplitude,
    Hit,
    branch_by_day,
    hits_by_speed,
    spread_of,
)


def days_of(rng, count, day_std, noise=0.0):
    """A curved branch on several days, each shifted as a whole, at speeds of its own."""
    shifts = day_std * rng.standard_normal(count)
    states = []
    for day, shift in enumerate(shifts):
        for speed in np.sort(rng.uniform(6.6, 8.8, 25)):
            amplitude = (
                5e-4 + 1e-4 * math.sqrt(speed - 6.4) + shift + noise * rng.standard_normal()
            )
            states.append(DayAmplitude(float(speed), amplitude, f'day {day}'))
    return states, shifts


def test_the_shifts_of_the_days_come_back():
    states, shifts = days_of(np.random.default_rng(1), 5, 2e-5)
    branches = branch_by_day(states)
    found = np.array([branches.shifts()[f'day {k}'] for k in range(5)])
    np.testing.assert_allclose(found, shifts - shifts.mean(), atol=2e-6)
    assert branches.day_std() == pytest.approx(np.std(shifts, ddof=1), rel=0.1)


def test_the_mean_over_days_is_covered_as_often_as_promised():
    inside = []
    for seed in range(300):
        values = np.random.default_rng(seed).normal(3.0, 1.0, 4)
        spread = spread_of(7.0, values, seed)
        inside.append(spread.mean.low <= 3.0 <= spread.mean.high)
    assert 0.92 <= np.mean(inside) <= 0.98


def test_a_day_says_nothing_beyond_what_it_has_measured():
    states = [
        *(DayAmplitude(v, 1e-3, 'a') for v in (6.0, 6.3, 6.6)),
        *(DayAmplitude(v, 2e-3, 'b') for v in (6.6, 6.9, 7.2)),
        *(DayAmplitude(v, 3e-3, 'c') for v in (6.0, 8.0)),  # too far apart to be joined
    ]
    spreads = branch_by_day(states).spreads()
    assert {round(one.speed, 6) for one in spreads} == {6.0, 6.6}
    assert next(one for one in spreads if one.speed > 6.5).mean.value == pytest.approx(1.5e-3)


@pytest.mark.parametrize(
    'states', [[], [DayAmplitude(7.0, 1e-3, 'a'), DayAmplitude(8.0, 1e-3, 'a')]]
)
def test_one_day_or_none_has_no_spread(states):
    branches = branch_by_day(states)
    assert branches.spreads() == []
    assert math.isnan(branches.day_std())


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 1000), st.floats(0.1, 10.0))
def test_the_spread_scales_with_the_amplitudes(seed, factor):
    states, _ = days_of(np.random.default_rng(seed), 3, 2e-5, 1e-6)
    larger = [DayAmplitude(s.speed, factor * s.amplitude, s.day) for s in states]
    ratio = branch_by_day(larger).day_std() / branch_by_day(states).day_std()
    assert ratio == pytest.approx(factor, rel=1e-6)


def test_growth_rates_are_compared_at_one_speed_and_between_days_only():
    hits = [
        Hit(7.2, 'a', '1', 1e-4, 6e-4, 0.3, 0.01),
        Hit(7.2, 'a', '2', 1e-4, 6e-4, 0.5, 0.01),
        Hit(7.22, 'b', '3', 1e-4, 1e-5, -0.4, 0.01),
        Hit(7.2, 'b', '4', 1e-4, 1e-5),  # no rate could be read
        Hit(8.0, 'a', '5', 1e-4, 6e-4, 0.1, 0.01),
    ]
    (spread,) = hits_by_speed(hits)
    assert spread.days == 2
    assert spread.mean.value == pytest.approx(0.0)
    assert spread.day_std == pytest.approx(0.8 / math.sqrt(2.0))
    assert [hit.grew for hit in hits] == [True, True, False, False, True]
    assert hits[3].to_json()['growth_rate_per_s'] is None


def test_the_same_seed_gives_the_same_interval():
    values = np.array([1.0, 2.0, 4.0])
    assert spread_of(7.0, values, 3) == spread_of(7.0, values, 3)
