"""The mode shape: from theory, through scattered values, and in the parameter file."""

from __future__ import annotations

import numpy as np
import pytest
from mode_shapes import cycle_ratio, ratio_at, shape_of

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.limit_cycle import limit_cycles
from hunt_ros.dynamics.linear_stability import hunting_mode
from hunt_ros.dynamics.mode_shape import ModeShape, fitted_shape
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.errors import ConfigError


@pytest.fixture(scope='module')
def branch():
    return limit_cycles(paper_rig())


@pytest.fixture(scope='module')
def shape(branch) -> ModeShape:
    return shape_of(paper_rig(), branch)


def test_the_table_holds_linear_theory_and_the_limit_cycles(shape, branch) -> None:
    rig = paper_rig()
    for speed in (6.0, 7.0, 8.0, 9.0):
        theory = hunting_mode(rig, speed).shape[2] / rig.length_scale
        assert abs(ratio_at(shape, speed, 0.0) / theory - 1.0) < 0.012
    inside = np.flatnonzero((branch.speed > 6.0) & (branch.speed < 9.0))
    for k in inside[::10]:
        found = ratio_at(shape, float(branch.speed[k]), float(branch.amplitude[k]))
        assert abs(found / cycle_ratio(branch, int(k)) - 1.0) < 0.012


def test_a_parameter_file_gives_the_same_form_and_shape_exactly(shape) -> None:
    form = IdentifiedNormalForm(PAPER_NORMAL_FORM, mode_shape=shape)
    text = form.to_yaml()
    read = IdentifiedNormalForm.from_yaml(text)
    assert read.to_yaml() == text
    assert read.mode_shape is not None
    for name in ModeShape.__dataclass_fields__:
        assert np.array_equal(getattr(read.mode_shape, name), getattr(shape, name)), name


@pytest.mark.parametrize(
    ('key', 'value', 'words'),
    [
        ('mode_speed', None, 'differ in length: mode_speed 0'),
        ('mode_speed', [8.0] * 7, 'must increase'),
        ('mode_ratio_std', [-0.1] * 70, 'negative'),
        ('mode_ratio_std', [0.1] * 7, 'mode_ratio_std 7'),
        ('mode_ratio_imag', 'much', 'list of numbers'),
        ('mode_ratio_imag', [float('nan')] * 70, 'finite'),
    ],
)
def test_an_impossible_shape_is_refused_with_its_key(shape, key, value, words) -> None:
    form = IdentifiedNormalForm(PAPER_NORMAL_FORM, mode_shape=shape)
    group = {'v_c': 8.0, 'D1': 0.1, 'D4': 1.0, 'D7': 0.0, 'D10': 0.0, 'D15': -1.0}
    group |= form.mode_shape.to_parameters()
    group[key] = value
    if value is None:
        del group[key]
    with pytest.raises(ConfigError, match=words):
        IdentifiedNormalForm.from_parameters(group, 'file')


def test_the_table_knows_little_where_there_were_no_values() -> None:
    rng = np.random.default_rng(0)
    size = 200
    speed, amplitude = np.full(size, 7.2), np.full(size, 6e-4)
    noise = 0.01 * (rng.normal(size=size) + 1j * rng.normal(size=size))
    ratio = (-4.3 + 2.3j) * (1.0 + noise)
    table = fitted_shape(speed, amplitude, ratio, np.full(size, 0.01), np.full(size, 2.84))
    assert table is not None
    here = np.argmin(np.abs(table.speeds - 7.2)), np.argmin(np.abs(table.amplitudes - 6e-4))
    assert table.ratio_std[here] < 0.02
    assert table.ratio_std[0, here[1]] > 0.1  # another speed
    assert table.ratio_std[here[0], 0] > 0.1  # another amplitude
    assert abs(ratio_at(table, 7.2, 6e-4) / (-4.3 + 2.3j) - 1.0) < 0.01


def test_a_few_wrong_values_do_not_bend_the_table() -> None:
    rng = np.random.default_rng(1)
    size = 300
    speed, amplitude = rng.uniform(6.0, 9.0, size), rng.uniform(0.0, 7e-4, size)
    true = (-4.0 + 2.4j) * (1.0 + 0.15 * (speed / 7.5 - 1.0) + 0.04 * (amplitude / 7e-4) ** 2)
    ratio = true * (1.0 + 0.02 * (rng.normal(size=size) + 1j * rng.normal(size=size)))
    ratio[::20] *= -3.0
    table = fitted_shape(speed, amplitude, ratio, np.full(size, 0.02), np.full(size, 2.84))
    assert table is not None
    for v, a in ((6.2, 1e-4), (7.5, 6e-4), (8.8, 3e-4)):
        expected = (-4.0 + 2.4j) * (1.0 + 0.15 * (v / 7.5 - 1.0) + 0.04 * (a / 7e-4) ** 2)
        assert abs(ratio_at(table, v, a) / expected - 1.0) < 0.02


def test_too_few_values_give_no_table() -> None:
    assert fitted_shape([7.0], [1e-4], [1.0], [0.1], [2.8]) is None
    nothing = np.full(5, np.nan)
    assert fitted_shape(nothing, nothing, nothing, nothing, nothing) is None
