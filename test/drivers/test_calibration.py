"""What a reading means: gain and offset, and the line through known displacements."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.drivers.calibration import Calibration, fit_line
from hunt_ros.errors import ConfigError


def test_gain_offset_and_range() -> None:
    calibration = Calibration(-0.002, 0.001, (-10.0, 10.0))
    values = calibration.apply([0.0, 5.0, 10.0, -10.0, 11.0, math.nan])
    assert values[:2] == pytest.approx([0.001, -0.009])
    assert np.isnan(values[2:]).all()
    assert calibration.saturated([9.99, 10.0, math.nan]).tolist() == [False, True, False]


def test_without_one_readings_are_si() -> None:
    assert Calibration().apply([1e9, -2.0]).tolist() == [1e9, -2.0]


def test_the_range_of_the_device_counts_too() -> None:
    both = Calibration(range=(-8.0, 20.0)).within(-10.0, 10.0)
    assert both.range == (-8.0, 10.0)
    assert Calibration().within(-10.0, 10.0).range == (-10.0, 10.0)


@pytest.mark.parametrize(
    ('given', 'words'),
    [
        ({'gain': 0.0}, 'gain: 0.0'),
        ({'gain': math.inf}, 'gain: inf'),
        ({'offset': math.inf}, 'offset: inf'),
        ({'range': (3.0, 3.0)}, r'range: \(3.0, 3.0\)'),
        ({'range': (3.0,)}, 'range: .*, expected a lower'),
        ({'range': (math.nan, 1.0)}, 'range: .*, expected a lower'),
    ],
)
def test_what_is_no_calibration_is_one_line(given, words) -> None:
    with pytest.raises(ConfigError, match=words):
        Calibration(**given)


@given(
    gain=st.floats(1e-6, 1e3),
    offset=st.floats(-10.0, 10.0),
    raw=st.lists(st.integers(-500, 500), min_size=2, max_size=20, unique=True),
)
def test_points_on_a_line_give_the_line(gain, offset, raw) -> None:
    fit = fit_line([(x / 50, gain * x / 50 + offset) for x in raw])
    assert fit.gain.value == pytest.approx(gain, rel=1e-4, abs=1e-9)
    assert max(map(abs, fit.residuals)) < 1e-9 * (1.0 + gain * 10.0 + abs(offset))


def test_the_deviations_are_those_of_repeated_calibrations() -> None:
    """The 95 % intervals of 5 points hold the truth in 95 % of 1000 calibrations."""
    raw = np.linspace(-8.0, 8.0, 5)
    rng = np.random.default_rng(0)
    inside = 0
    for _ in range(1000):
        fit = fit_line(list(zip(raw, 2e-3 * raw + rng.normal(0.0, 1e-5, 5), strict=True)))
        inside += fit.gain.low < 2e-3 < fit.gain.high
    assert abs(inside / 1000 - 0.95) < 4.0 * math.sqrt(0.95 * 0.05 / 1000)


def test_a_point_that_is_no_number_is_refused() -> None:
    with pytest.raises(ConfigError, match='a number is not finite'):
        fit_line([(0.0, math.nan), (1.0, 1.0)])
