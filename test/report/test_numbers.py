"""Numbers are rounded to their uncertainty, and what is printed is within it."""

from __future__ import annotations

import math
import re
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.report.numbers import measured, plain, rounded, rounded_json

values = st.floats(-1e9, 1e9).filter(lambda x: x == 0.0 or abs(x) > 1e-9)
deviations = st.floats(1e-9, 1e9)


def read(digits: str, exponent: int) -> Decimal:
    return Decimal(digits.replace('−', '-')).scaleb(exponent)


@pytest.mark.parametrize(
    ('value', 'std', 'text'),
    [
        (8.0134, 0.0421, '8.013 ± 0.042'),
        (6.4059, 0.0071, '6.4059 ± 0.0071'),
        (-4.2e7, 1.3e6, '(−4.20 ± 0.13) × 10^7'),
        (2030.4, 140.2, '2030 ± 140'),
        (2030.4, 1400.2, '2000 ± 1400'),
        (0.0996, 0.0996, '0.10 ± 0.10'),  # rounding up takes a digit with it
        (-0.001, 0.5, '0.00 ± 0.50'),  # no minus before a zero
        (-0.1, 12.0, '0 ± 12'),
        (0.5, 1.0e6, '(0.0 ± 1.0) × 10^6'),
        (3.2e-6, 1e-8, '(3.200 ± 0.010) × 10^-6'),
        (0.125, 0.10, '0.12 ± 0.10'),  # half to even, as decimals
        (1.23456789, None, '1.235'),
        (1.23456789, 0.0, '1.235'),
        (8.0, None, '8.000'),
        (0.0, None, '0.0'),
    ],
)
def test_known_roundings(value: float, std: float | None, text: str) -> None:
    assert rounded(value, std).text() == text


@given(values, deviations)
def test_the_uncertainty_keeps_two_digits_and_the_value_ends_with_it(
    value: float, std: float
) -> None:
    shown = rounded(value, std)
    exact = read(shown.std, shown.exponent)
    # Two significant digits: within 5 % of itself, and never more digits than that.
    assert abs(float(exact) / std - 1.0) <= 0.0501
    digits = exact.normalize().as_tuple().digits
    assert len(digits) <= 2
    decimals = [len(x.partition('.')[2]) for x in (shown.value, shown.std)]
    assert decimals[0] == decimals[1]


@given(values, deviations)
def test_what_is_printed_is_the_number_to_within_its_uncertainty(value: float, std: float) -> None:
    shown = rounded(value, std, (value - 2 * std, value + 2 * std))
    for digits, exact in (
        (shown.value, value),
        (shown.low, value - 2 * std),
        (shown.high, value + 2 * std),
    ):
        assert abs(float(read(digits, shown.exponent)) - exact) <= 0.0501 * std + 1e-12 * abs(
            exact
        )
    assert '-' not in shown.value  # a true minus sign, not a hyphen


@given(values, st.integers(1, 12))
def test_a_number_without_uncertainty_keeps_so_many_digits(value: float, digits: int) -> None:
    shown = rounded(value, digits=digits)
    assert float(read(shown.value, shown.exponent)) == pytest.approx(
        value, rel=0.51 * 10.0 ** (1 - digits)
    )


@given(values, deviations, st.floats(1e-3, 1e3))
def test_a_unit_scales_value_deviation_and_interval_alike(
    value: float, std: float, scale: float
) -> None:
    entry = {'value': value, 'std': std, 'ci95': [value - std, value + std]}
    assert rounded_json(entry, scale) == rounded(
        scale * value, scale * std, (scale * (value - std), scale * (value + std))
    )


@pytest.mark.parametrize(
    ('value', 'std', 'interval', 'text'),
    [
        (0.07, 0.029, (-0.26, 0.39), '0.070, −0.260 … 0.390'),  # far wider than its deviation
        (8.0, 0.10, (7.95, 8.30), '8.00, 7.95 … 8.30'),  # to one side
        (8.0, 0.10, (7.8, 8.25), '8.00 ± 0.10'),
    ],
)
def test_a_skewed_interval_is_printed_and_not_its_deviation(value, std, interval, text) -> None:
    assert rounded(value, std, interval).text() == text


def test_a_missing_deviation_or_interval_is_left_out() -> None:
    shown = rounded_json({'value': 1.5, 'std': None, 'ci95': None})
    assert shown.text() == '1.500'
    assert shown.interval_html() == ''


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_has_no_digits(bad: float) -> None:
    for arguments in ((bad,), (1.0, bad), (1.0, 1.0, (bad, 2.0))):
        with pytest.raises(ValueError, match='finite'):
            rounded(*arguments)


def test_html_sets_powers_of_ten_as_superscripts() -> None:
    assert rounded(-4.2e7, 1.3e6).html() == '(−4.20 ± 0.13) × 10<sup>7</sup>'
    shown = rounded(3.2e-6, 1e-8, (3.1e-6, 3.3e-6))
    assert shown.interval_html() == '(3.100 … 3.300) × 10<sup>−6</sup>'
    assert plain(3.2e-6, 2) == '3.2 × 10^-6'
    assert not re.search(r'10<sup>-', shown.html())


def test_a_deviation_that_is_not_finite_is_left_out_and_a_value_is_not_known() -> None:
    assert measured(1.5, 0.25) == '1.50 ± 0.25'
    assert measured(1.5, math.nan) == measured(1.5, math.inf) == '1.500'
    assert measured(math.nan, 1.0) == 'not known'
