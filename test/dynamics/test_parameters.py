"""Table 1, Eq. (4), the file, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.dynamics.parameters import CUBIC_KEYS, QUINTIC_KEYS, RigParameters, paper_rig
from hunt_ros.errors import ConfigError

CONFIG = Path(__file__).parents[2] / 'config' / 'wheelset.yaml'

_NUMBERS = st.floats(-1e7, 1e7, allow_nan=False)
_TERMS = st.dictionaries(st.sampled_from(CUBIC_KEYS + QUINTIC_KEYS), _NUMBERS)


def test_the_dimensionless_coefficients_are_those_of_equation_4() -> None:
    rig = RigParameters()
    omega2 = 25.91**2
    assert rig.d11 == pytest.approx(2 * rig.creep_lateral_n / (2.175 * 0.0485 * omega2))
    assert rig.d22 == pytest.approx(rig.creep_longitudinal_n * 0.0485 / (200 * 0.085**2))
    assert rig.k11 == pytest.approx(8.754**2 / omega2)
    assert rig.k12 == -rig.d11
    assert rig.k21 == pytest.approx(
        0.0485**2 * rig.creep_longitudinal_n * 0.04 / (200 * 0.085**2 * 0.036)
    )
    assert rig.k22 == 1.0
    assert rig.speed_scale == pytest.approx(0.0485 * 25.91)


def test_table_1_is_consistent_with_its_springs() -> None:
    lateral, yaw = RigParameters().frequencies_from_springs()
    assert lateral == pytest.approx(8.754, abs=5e-4)
    assert yaw == pytest.approx(25.91, rel=1e-3)


@given(alpha=_TERMS, beta=_TERMS, mass=st.floats(2.15, 2.2))
def test_yaml_gives_back_the_same_rig(
    alpha: dict[str, float], beta: dict[str, float], mass: float
) -> None:
    rig = RigParameters(alpha=alpha, beta=beta, mass_kg=mass, name='b: "é"')
    assert RigParameters.from_yaml(rig.to_yaml()) == rig


def test_the_file_in_config_is_the_default_rig() -> None:
    assert RigParameters.from_yaml(CONFIG.read_text(encoding='utf-8')) == paper_rig()


def test_a_frequency_left_out_follows_from_springs_that_are_given() -> None:
    rig = RigParameters.from_yaml('mass_kg: 4.0\nspring_stiffness_n_per_m: 300')
    expected = rig.frequencies_from_springs()
    assert (rig.lateral_frequency_rad_per_s, rig.yaw_frequency_rad_per_s) == expected
    assert expected[0] == pytest.approx(math.sqrt(2 * 300 * (1 - 0.035 / 0.06) / 4.0))


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('mass_kg: -2', r'rig\.yaml: mass_kg must be positive, got -2'),
        ('mass_kg: heavy', "mass_kg must be a number, got 'heavy'"),
        ('mass_kg: .nan', 'mass_kg must be positive, got nan'),
        ('weight: 2', "unknown key 'weight'"),
        ("beta: {'31': 1.0}", "beta: unknown key '31'"),
        ("alpha: {'30': .inf}", 'alpha 30 must be finite, got inf'),
        ('alpha: 3', 'alpha must map keys'),
        ('[1, 2]', 'expected a mapping'),
        ('a: [', 'not YAML'),
        ('yaw_frequency_rad_per_s: 30', r'yaw_frequency_rad_per_s is 30.*25\.9'),
        ('spring_length_m: 0.03', 'spring_length_m is 0.03, expected more than'),
    ],
)
def test_a_bad_file_is_answered_in_one_line_that_names_the_value(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        RigParameters.from_yaml(text, 'rig.yaml')
    assert str(caught.value).startswith('rig.yaml: ')
    assert '\n' not in str(caught.value)


def test_unquoted_keys_that_yaml_reads_as_numbers_are_understood() -> None:
    rig = RigParameters.from_yaml('beta: {30: 1.0, 03: 2.0, 50: 3.0}')
    assert rig.beta == {'30': 1.0, '03': 2.0, '50': 3.0}


def test_an_exponent_without_a_point_is_a_number() -> None:
    rig = RigParameters.from_yaml("tread_angle: 4e-2\nbeta: {'50': -2e6}", 'rig.yaml')
    assert rig.tread_angle == 0.04
    assert rig.beta['50'] == -2e6
