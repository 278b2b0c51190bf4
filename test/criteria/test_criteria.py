from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.criteria import CRITERIA, CriteriaPanel, make_criterion
from hunt_ros.errors import ConfigError

RATE = 500.0
STEP = 2_000_000


def sine(amplitude: float, frequency: float, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Stamps, ns, and a displacement, m, that starts softly."""
    time = np.arange(round(duration * RATE)) / RATE
    ramp = np.minimum(time / 2.0, 1.0)
    stamps = np.round(time * 1e9).astype(np.int64) + 17
    return stamps, amplitude * ramp * np.sin(2 * np.pi * frequency * time)


def small(name: str, **thresholds: float):
    """Build the criterion with windows short enough for a test."""
    if name == 'uic_518':
        thresholds.setdefault('window_m', 20.0)
    return make_criterion(name, RATE, **thresholds)


@pytest.mark.parametrize('name', sorted(CRITERIA))
def test_the_index_of_a_steady_oscillation_is_its_acceleration(name):
    amplitude, frequency = 0.7e-3, 4.0
    stamps, lateral = sine(amplitude, frequency, 16.0)
    criterion = small(name, **({'centre_hz': 4.0} if name == 'uic_518' else {}))
    rows = criterion.update(stamps, lateral, 7.0)
    peak = amplitude * (2 * np.pi * frequency) ** 2
    expected = peak if 'peaks' in name else peak / np.sqrt(2.0)
    assert rows['index'][-1] == pytest.approx(expected, rel=0.02)
    assert criterion.index == rows['index'][-1]


@pytest.mark.parametrize('name', sorted(CRITERIA))
def test_the_limit_decides_and_can_be_scaled(name):
    stamps, lateral = sine(0.7e-3, 3.5, 16.0)
    full = small(name)
    assert not full.update(stamps, lateral, 7.0)['exceeded'].any()
    scaled = small(name, scale=0.2 / full.settings.limit)
    rows = scaled.update(stamps, lateral, 7.0)
    assert scaled.limit == pytest.approx(0.2)
    assert rows['exceeded'][-1]
    assert scaled.exceeded
    assert np.array_equal(rows['exceeded'], rows['index'] > 0.2)


@pytest.mark.parametrize('name', sorted(CRITERIA))
@settings(max_examples=15, deadline=None)
@given(cuts=st.lists(st.integers(0, 6000), max_size=6), seed=st.integers(0, 2**32 - 1))
def test_blocks_give_the_numbers_of_the_whole(name, cuts, seed):
    generator = np.random.default_rng(seed)
    stamps, lateral = sine(0.5e-3, 2.8, 12.0)
    stamps = stamps + generator.integers(-STEP // 3, STEP // 3, stamps.size)
    stamps[3000:] += 200_000_000  # a hole
    lateral = lateral + generator.normal(0.0, 5e-6, lateral.size)
    lateral[generator.random(lateral.size) < 0.05] = np.nan
    whole = small(name, window_m=4.0) if name == 'uic_518' else small(name)
    rows = whole.update(stamps, lateral, 7.0)
    split = small(name, window_m=4.0) if name == 'uic_518' else small(name)
    edges = [0, *sorted(cuts), stamps.size]
    parts = [split.update(stamps[a:b], lateral[a:b], 7.0) for a, b in pairwise(edges)]
    assert np.concatenate(parts).tobytes() == rows.tobytes()
    assert (split.missing, split.dropped) == (whole.missing, whole.dropped)
    split.reset()
    assert split.update(stamps, lateral, 7.0).tobytes() == rows.tobytes()


@pytest.mark.parametrize('name', sorted(CRITERIA))
def test_single_samples_give_the_numbers_of_the_whole(name):
    stamps, lateral = sine(0.5e-3, 2.8, 5.0)
    thresholds = {'window_m': 4.0} if name == 'uic_518' else {}
    rows = small(name, **thresholds).update(stamps, lateral, 7.0)
    single = small(name, **thresholds)
    parts = [single.update(s, y, 7.0) for s, y in zip(stamps, lateral, strict=True)]
    assert np.concatenate(parts).tobytes() == rows.tobytes()


@pytest.mark.parametrize('name', sorted(CRITERIA))
def test_missing_samples_hardly_change_the_index(name):
    stamps, lateral = sine(0.5e-3, 3.5, 16.0)
    rows = small(name).update(stamps, lateral, 7.0)
    holes = lateral.copy()
    holes[np.random.default_rng(1).random(holes.size) < 0.05] = np.nan
    criterion = small(name)
    with_holes = criterion.update(stamps, holes, 7.0)
    assert criterion.missing == np.isnan(holes).sum()
    assert with_holes['index'][-1] == pytest.approx(rows['index'][-1], rel=0.02)


@pytest.mark.parametrize('name', sorted(CRITERIA))
def test_a_long_gap_starts_the_window_anew(name):
    stamps, lateral = sine(0.5e-3, 3.5, 16.0)
    criterion = small(name)
    criterion.update(stamps[:7000], lateral[:7000], 7.0)
    after = criterion.update(stamps[7000:7100] + 10**9, lateral[7000:7100], 7.0)
    before = after['index'][~np.isnan(after['index'])]
    assert after.size == 100
    assert not (before > 0.05).any()  # 0.2 s hold no full window and no six peaks


def test_backward_stamps_are_dropped_and_a_set_clock_restarts():
    stamps, lateral = sine(0.5e-3, 3.5, 8.0)
    reference = small('cfr_213_333').update(stamps, lateral)
    criterion = small('cfr_213_333')
    criterion.update(stamps[:2000], lateral[:2000])
    assert criterion.update(stamps[1900:2000], np.full(100, 1.0)).size == 0
    assert criterion.dropped == 100
    rest = criterion.update(stamps[2000:], lateral[2000:])
    assert rest.tobytes() == reference[2000:].tobytes()
    again = criterion.update(stamps - 10**10, lateral)
    assert np.array_equal(again['index'], reference['index'], equal_nan=True)


def test_without_a_speed_a_window_in_metres_stays_undefined():
    stamps, lateral = sine(0.5e-3, 3.5, 16.0)
    criterion = small('uic_518')
    assert np.isnan(criterion.update(stamps, lateral)['index']).all()
    assert not criterion.exceeded


def test_the_window_in_metres_takes_its_time_from_the_speed():
    stamps, lateral = sine(0.5e-3, 3.0, 16.0)
    for speed in (4.0, 8.0):
        index = small('uic_518').update(stamps, lateral, speed)['index']
        assert np.flatnonzero(np.isfinite(index))[0] / RATE == pytest.approx(
            20.0 / speed, abs=2.0 / RATE
        )


def test_the_trend_is_removed_inside_the_window():
    # The sums of the ring against numpy, over more than one turn.
    from hunt_ros.criteria.sliding_rms import _trend_free_rms

    values = np.random.default_rng(3).normal(size=500).cumsum()
    for linear, degree in ((True, 1), (False, 0)):
        out = np.empty(values.size)
        _trend_free_rms(
            values, np.zeros(100), np.zeros(2, dtype=np.int64), np.zeros(3), linear, out
        )
        for k in (99, 100, 257, 499):
            window = values[k - 99 : k + 1]
            fit = np.polyval(np.polyfit(np.arange(100), window, degree), np.arange(100))
            assert out[k] == pytest.approx(np.sqrt(np.mean((window - fit) ** 2)), rel=1e-9)


def test_six_peaks_need_six():
    # 2.5 half cycles above the limit are not six peaks in a row.
    time = np.arange(4000) / RATE
    stamps = np.round(time * 1e9).astype(np.int64)
    burst = 1e-3 * np.exp(-(((time - 4.0) / 0.12) ** 2)) * np.sin(2 * np.pi * 4.0 * time)
    criterion = make_criterion('six_peaks', RATE, limit=0.25)
    assert not criterion.update(stamps, burst)['exceeded'].any()
    assert (
        make_criterion('six_peaks', RATE, limit=0.25, peaks=2)
        .update(stamps, burst)['exceeded']
        .any()
    )


@pytest.mark.parametrize(
    ('name', 'thresholds'),
    [
        ('cfr', {}),
        ('cfr_213_333', {'peaks': 3}),
        ('six_peaks', {'limit': -1.0}),
        ('six_peaks', {'limit': float('nan')}),
        ('ten_peaks', {'high_hz': 300.0}),
    ],
)
def test_bad_settings_are_named(name, thresholds):
    with pytest.raises(ConfigError):
        make_criterion(name, RATE, **thresholds)


@settings(max_examples=10, deadline=None)
@given(cut=st.integers(1, 9999))
def test_a_panel_says_when_each_criterion_begins_and_ceases(cut):
    stamps, lateral = sine(0.5e-3, 3.5, 20.0)
    lateral[5000:] *= np.exp(-(stamps[5000:] - stamps[5000]) * 1e-9)
    thresholds = {name: {'scale': 0.03} for name in ('cfr_213_333', 'six_peaks')}
    panel = CriteriaPanel(['cfr_213_333', 'six_peaks'], RATE, thresholds)
    parts = [panel.update(stamps[:cut], lateral[:cut]), panel.update(stamps[cut:], lateral[cut:])]
    verdicts = [verdict for part in parts for verdict in part]
    for name in panel.criteria:
        own = [verdict.exceeded for verdict in verdicts if verdict.criterion == name]
        assert own == [True, False]
    assert panel.exceeded == ()
    whole = CriteriaPanel(['cfr_213_333', 'six_peaks'], RATE, thresholds)
    assert list(whole.update(stamps, lateral)) == verdicts
    panel.reset()
    assert list(panel.update(stamps, lateral)) == verdicts


def test_a_panel_may_be_empty_and_names_what_it_does_not_know():
    assert CriteriaPanel([], RATE).update([0], [0.0]) == ()
    with pytest.raises(ConfigError, match='cfr_213_333'):
        CriteriaPanel(['cfr'], RATE)
