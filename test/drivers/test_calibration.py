"""What a reading means: gain and offset, and the line through known displacements."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.drivers.calibration import Calibration, fit_line
from hunt_ros.errors import ConfigError


def _read(text: str, tmp_path, channel: str = 'lateral') -> Calibration:
    path = tmp_path / 'lateral.yaml'
    path.write_text(text)
    return Calibration.read(str(path), channel)


def test_gain_offset_and_range(tmp_path) -> None:
    calibration = _read(
        'calibration: {channel: lateral, unit: m, gain: -0.002, offset: 0.001, polarity: 1,'
        ' range: [-10, 10]}',
        tmp_path,
    )
    values = calibration.apply([0.0, 5.0, 10.0, -10.0, 11.0, math.nan])
    assert values[:2] == pytest.approx([0.001, -0.009])
    assert np.isnan(values[2:]).all()
    assert calibration.saturated([9.99, 10.0, math.nan]).tolist() == [False, True, False]


def test_no_file_means_readings_in_si() -> None:
    assert Calibration.read('', 'yaw').apply([1e9, -2.0]).tolist() == [1e9, -2.0]


def test_the_range_of_the_device_counts_too() -> None:
    both = Calibration(range=(-8.0, 20.0)).within(-10.0, 10.0)
    assert both.range == (-8.0, 10.0)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('calibration: {gain: 0}', 'gain: 0.0'),
        ('calibration: {gain: big}', "gain: 'big' is not a number"),
        ('calibration: {offset: 1}', 'expected a gain'),
        ('calibration: {gain: 1, polarity: -1}', 'polarity: -1, expected 1'),
        ('calibration: {gain: 1, range: [3, 3]}', r'range: \(3, 3\)'),
        ('calibration: {gain: 1, range: 3}', 'range: 3 is not a list'),
        ('calibration: {gain: 1, range: [a, b]}', 'range: .*, expected a lower'),
        ('calibration: {gain: 1, channel: yaw}', 'channel: yaw, expected lateral'),
        ('calibration: {gain: 1, channel: lateral, unit: mm}', 'unit: mm, expected m'),
        ('gain: 1', 'under the key calibration'),
        ('{', 'while parsing'),
    ],
)
def test_what_is_no_calibration_is_one_line_with_the_file(tmp_path, text, words) -> None:
    with pytest.raises(ConfigError, match=words) as caught:
        _read(text, tmp_path)
    assert 'lateral.yaml' in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_file_that_is_not_there_is_one_line() -> None:
    with pytest.raises(ConfigError, match='calibration /nowhere: No such file'):
        Calibration.read('/nowhere', 'yaw')


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


def test_two_points_have_no_deviation() -> None:
    fit = fit_line([(0.0, 0.0), (1.0, 2.0)])
    assert (fit.gain.value, fit.offset.value) == (2.0, 0.0)
    assert math.isnan(fit.gain.std)


def test_a_point_that_is_no_number_is_refused() -> None:
    with pytest.raises(ConfigError, match='a number is not finite'):
        fit_line([(0.0, math.nan), (1.0, 1.0)])
