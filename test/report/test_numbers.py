"""Numbers are rounded to their uncertainty, and what is printed is within it."""

from __future__ import annotations

import math
import re
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.report.numbers import interval, rounded, shown
from hunt_ros.samples import Uncertain, Unknown

values = st.floats(-1e9, 1e9).filter(lambda x: x == 0.0 or abs(x) > 1e-9)
deviations = st.floats(1e-9, 1e9)


def read(text: str) -> list[Decimal]:
    """Return the numbers of what is printed, each times the power of ten behind them."""
    text, _, power = text.replace('−', '-').partition(' × 10<sup>')
    exponent = int(power.removesuffix('</sup>') or 0)
    return [Decimal(x).scaleb(exponent) for x in re.findall(r'-?\d+(?:\.\d+)?', text)]


@pytest.mark.parametrize(
    ('value', 'std', 'text'),
    [
        (8.0134, 0.0421, '8.013 ± 0.042'),
        (6.4059, 0.0071, '6.4059 ± 0.0071'),
        (-4.2e7, 1.3e6, '(−4.20 ± 0.13) × 10<sup>7</sup>'),
        (2030.4, 140.2, '2030 ± 140'),
        (2030.4, 1400.2, '2000 ± 1400'),
        (0.0996, 0.0996, '0.10 ± 0.10'),  # rounding up takes a digit with it
        (-0.001, 0.5, '0.00 ± 0.50'),  # no minus before a zero
        (-0.1, 12.0, '0 ± 12'),
        (0.5, 1.0e6, '(0.0 ± 1.0) × 10<sup>6</sup>'),
        (3.2e-6, 1e-8, '(3.200 ± 0.010) × 10<sup>−6</sup>'),
        (0.125, 0.10, '0.12 ± 0.10'),  # half to even, as decimals
        (1.23456789, None, '1.235'),
        (1.23456789, 0.0, '1.235'),
        (8.0, None, '8.000'),
        (0.0, None, '0.0'),
        (0.5, 4e-56, f'0.5{"0" * 56} ± 0.{"0" * 55}40'),
    ],
)
def test_known_roundings(value: float, std: float | None, text: str) -> None:
    assert rounded(value if std is None else Uncertain(value, std))[0] == text


@given(values, deviations)
def test_what_is_printed_is_the_number_to_within_its_uncertainty(value: float, std: float) -> None:
    text, ends = rounded(Uncertain(value, std, value - 2 * std, value + 2 * std))
    printed, spread = read(text)
    # Two significant digits: within 5 % of itself, and never more digits than that.
    assert abs(float(spread) / std - 1.0) <= 0.0501
    assert len(spread.normalize().as_tuple().digits) <= 2
    for digits, exact in zip(
        [printed, *read(ends)], (value, value - 2 * std, value + 2 * std), strict=True
    ):
        assert abs(float(digits) - exact) <= 0.0501 * std + 1e-12 * abs(exact)
    assert '-' not in text  # a true minus sign, not a hyphen
    decimals = [len(x.partition('.')[2]) for x in re.findall(r'[\d.]+', text)[:2]]
    assert decimals[0] == decimals[1]


@given(values, st.integers(1, 12))
def test_a_number_without_uncertainty_keeps_so_many_digits(value: float, digits: int) -> None:
    (printed,) = read(rounded(value, digits=digits)[0])
    assert float(printed) == pytest.approx(value, rel=0.51 * 10.0 ** (1 - digits))


@given(values, deviations, st.floats(1e-3, 1e3))
def test_a_unit_scales_value_deviation_and_interval_alike(
    value: float, std: float, scale: float
) -> None:
    one = Uncertain(value, std, value - std, value + std)
    scaled = Uncertain(scale * value, scale * std, scale * one.low, scale * one.high)
    text, ends = rounded(scaled)
    assert shown(one, scale) == f'<data value="{value!r}">{text}</data>'
    assert interval(one, scale) == ends


@pytest.mark.parametrize(
    ('value', 'std', 'ends', 'text'),
    [
        (0.07, 0.029, (-0.26, 0.39), '0.070, −0.260 … 0.390'),  # far wider than its deviation
        (8.0, 0.10, (7.95, 8.30), '8.00, 7.95 … 8.30'),  # to one side
        (8.0, 0.10, (7.8, 8.25), '8.00 ± 0.10'),
        (1.0, 0.1, (-1e40, 2.0), f'1.00, −1{"0" * 40}.00 … 2.00'),  # draws that ran away
        (3.2e-6, 1e-8, (3.1e-6, 3.3e-6), '(3.200, 3.100 … 3.300) × 10<sup>−6</sup>'),
    ],
)
def test_a_skewed_interval_is_printed_and_not_its_deviation(value, std, ends, text) -> None:
    assert rounded(Uncertain(value, std, *ends))[0] == text


def test_what_is_not_known_says_why_or_that() -> None:
    assert 'not known: a &lt; b' in shown(Unknown('a < b'))
    for nothing in (None, math.nan, Uncertain(math.nan, 1.0)):
        assert shown(nothing) == '<span class="unknown">not known</span>'
    assert 'not known' in interval(Unknown('why'))
    assert shown(Uncertain(1.5, math.nan)).startswith('<data value="1.5">1.500</data> <span')
    assert shown(31) == '<data value="31.0">31</data>'
