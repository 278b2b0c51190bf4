"""Series, Record and Uncertain: what they accept, what they refuse, what they keep."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from hunt_ros.errors import HuntError
from hunt_ros.samples import CHANNELS, NANOSECONDS, Record, Series, Uncertain, counted, different

finite = st.floats(-1e12, 1e12, allow_nan=False)
stamps = npst.arrays(np.int64, st.integers(0, 40), elements=st.integers(0, 2 * 10**18))


@st.composite
def series(draw: st.DrawFn) -> Series:
    times = draw(stamps)
    values = draw(npst.arrays(np.float64, times.size, elements=st.floats(width=64)))
    return Series(times, values)


@given(series(), st.integers(0, 2 * 10**18), st.integers(0, 2 * 10**18))
def test_cutting_a_series_in_two_loses_and_doubles_nothing(
    one: Series, first: int, second: int
) -> None:
    end = 2 * 10**18 + 1
    low, high = sorted((first, second))
    parts = [one.between(0, low), one.between(low, high), one.between(high, end)]
    assert sum(map(len, parts)) == len(one)
    assert all((part.stamps_ns >= low).all() for part in parts[1:])
    assert all((part.stamps_ns < high).all() for part in parts[:2])


def test_between_keeps_the_order_of_recording() -> None:
    out_of_order = Series(np.array([5, 3, 9, 4]), np.array([1.0, 2.0, 3.0, 4.0]))
    np.testing.assert_array_equal(out_of_order.between(3, 6).values, [1.0, 2.0, 4.0])


@given(stamps)
def test_a_series_needs_one_stamp_a_value(times: np.ndarray) -> None:
    with pytest.raises(HuntError, match='one stamp a value'):
        Series(times, np.zeros(times.size + 1))


@given(st.integers(0, 2**62), st.integers(2, 50), st.integers(1, 10**9))
def test_seconds_and_rate_do_not_lose_nanoseconds_to_the_epoch(
    start: int, count: int, step: int
) -> None:
    # At 1.7e18 ns after the epoch a float64 holds 256 ns: the difference comes first.
    even = Series(start + step * np.arange(count), np.zeros(count))
    np.testing.assert_array_equal(even.seconds(), step * np.arange(count) / NANOSECONDS)
    assert even.rate_hz == pytest.approx(NANOSECONDS / step, rel=1e-12)


@pytest.mark.parametrize('times', [[], [7], [7, 7, 7]])
def test_a_rate_that_cannot_be_known_is_nan(times: list[int]) -> None:
    assert math.isnan(Series(np.array(times), np.zeros(len(times))).rate_hz)


@given(st.dictionaries(st.sampled_from(CHANNELS), series()))
def test_a_record_spans_all_its_samples(channels: dict[str, Series]) -> None:
    record = Record(channels, 'somewhere', {'rig': 'A'})
    filled = [one for one in channels.values() if len(one)]
    assert dict(record) == channels
    assert len(record) == len(channels)
    if filled:
        everything = np.concatenate([one.stamps_ns for one in filled])
        assert record.start_ns == everything.min()
        assert record.end_ns == everything.max()
        whole = record.between(record.start_ns, record.end_ns + 1)
        assert sum(map(len, whole.values())) == everything.size
        assert (whole.source, whole.notes) == ('somewhere', {'rig': 'A'})
    else:
        assert record.duration_s == 0.0


@given(st.text().filter(lambda name: name not in CHANNELS))
def test_a_record_refuses_a_channel_it_does_not_know(name: str) -> None:
    one = Series(np.array([0]), np.array([0.0]))
    with pytest.raises(HuntError) as caught:
        Record({name: one}, 'run.mcap')
    assert 'run.mcap' in str(caught.value)
    assert repr(name) in str(caught.value)


@given(finite, st.floats(0.0, 1e12))
def test_an_interval_that_is_not_given_is_the_normal_one(value: float, std: float) -> None:
    number = Uncertain(value, std)
    assert number.low <= value <= number.high
    assert number.high - number.low == pytest.approx(2 * 1.959964 * std, rel=1e-9, abs=1e-3)


@given(st.floats(), st.floats(0.0), st.floats(), st.floats())
def test_json_of_a_number_never_holds_nan(
    value: float, std: float, low: float, high: float
) -> None:
    entry = Uncertain(value, std, low, high).to_json()
    json.dumps(entry, allow_nan=False)
    assert (entry is None) == (not math.isfinite(value))
    if entry is not None:
        assert entry['value'] == value
        assert set(entry) == {'value', 'std', 'ci95'}


def test_samples_are_put_in_order_and_those_that_are_none_left_out() -> None:
    series = Series([3, 1, 2, 1], [0.3, 0.1, np.nan, 9.0])
    assert series.in_order().stamps_ns.tolist() == [1, 2, 3]
    assert series.in_order().values[[0, 2]].tolist() == [0.1, 0.3]
    assert series.in_order().finite().values.tolist() == [0.1, 0.3]
    tidy = Series([1, 2], [0.1, 0.2])
    assert tidy.in_order() is tidy
    assert tidy.finite() is tidy
    assert len(Series([], []).in_order().finite()) == 0


@pytest.mark.parametrize(
    ('value', 'std', 'text'),
    [
        (8.0128, 0.0421, '8.013 ± 0.042'),
        (2671.6, 204.0, '2670 ± 200'),
        (-5.4251e7, 3.9e6, '(-5.43 ± 0.39)e+07'),
        (1.5e-9, 2e-10, '(1.50 ± 0.20)e-09'),
        (0.0, 1e-3, '0.0000 ± 0.0010'),
        (0.0996, 0.0996, '0.10 ± 0.10'),  # as the report has it
        (-0.001, 0.5, '0.00 ± 0.50'),
        (8.0128, math.nan, '8.0128'),
    ],
)
def test_a_value_ends_with_the_second_digit_of_its_deviation(value, std, text) -> None:
    assert str(Uncertain(value, std)) == text


@pytest.mark.parametrize(
    ('number', 'text'),
    [
        (Uncertain(8.0128, 0.0421, 7.9312, 8.0951), '8.013 m/s (95 %: 7.931 to 8.095)'),
        (Uncertain(8.0128, math.nan), '8.0128 m/s (95 %: nan to nan)'),
        (Uncertain(1.5e-9, 2e-10, 1e-9, 2e-9), '1.50e-09 m/s (95 %: 1.00e-09 to 2.00e-09)'),
    ],
)
def test_an_interval_is_printed_to_two_digits_of_the_deviation(number, text) -> None:
    assert number.with_interval('m/s') == text


def test_one_thing_is_no_things() -> None:
    assert [counted(n, 'run') for n in (0, 1, 2)] == ['0 runs', '1 run', '2 runs']


@given(st.lists(st.integers(0, 5)))
def test_times_are_counted_in_any_order(stamps) -> None:
    assert different(np.array(stamps, dtype=np.int64)) == len(set(stamps))
