from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.criteria import CRITERIA, CriteriaPanel, make_criterion
from hunt_ros.criteria.acceleration import LateralAcceleration
from hunt_ros.errors import ConfigError

RATE = 500.0
#: So fast that the window of 100 m takes 2.5 s.
SPEED = 40.0

each = pytest.mark.parametrize('name', sorted(CRITERIA))


def sine(amplitude: float, frequency: float, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Stamps, ns, and a displacement, m, that starts softly."""
    time = np.arange(round(duration * RATE)) / RATE
    ramp = np.minimum(time / 2.0, 1.0)
    stamps = np.round(time * 1e9).astype(np.int64) + 17
    return stamps, amplitude * ramp * np.sin(2 * np.pi * frequency * time)


@each
def test_the_index_of_a_steady_oscillation_is_its_acceleration_and_a_scaled_limit_decides(name):
    amplitude, frequency = 0.7e-3, 3.0 if name == 'uic_518' else 4.0
    stamps, lateral = sine(amplitude, frequency, 10.0)
    criterion = make_criterion(name, RATE)
    rows = criterion.update(stamps, lateral, SPEED)
    peak = amplitude * (2 * np.pi * frequency) ** 2
    expected = peak if 'peaks' in name else peak / np.sqrt(2.0)
    assert rows['index'][-1] == pytest.approx(expected, rel=0.02)
    assert criterion.index == rows['index'][-1]
    assert not rows['exceeded'].any()
    scaled = make_criterion(name, RATE, 0.13 / criterion.limit)
    rows = scaled.update(stamps, lateral, SPEED)
    assert scaled.limit == pytest.approx(0.13)
    assert rows['exceeded'][-1]
    assert scaled.exceeded
    assert np.array_equal(rows['exceeded'], rows['index'] > scaled.limit)


@each
def test_missing_samples_hardly_change_the_index(name):
    stamps, lateral = sine(0.5e-3, 3.5, 10.0)
    rows = make_criterion(name, RATE).update(stamps, lateral, SPEED)
    lateral[np.random.default_rng(1).random(lateral.size) < 0.05] = np.nan
    with_holes = make_criterion(name, RATE).update(stamps, lateral, SPEED)
    assert with_holes['index'][-1] == pytest.approx(rows['index'][-1], rel=0.02)


@each
@pytest.mark.parametrize('shift_ns', [10**9, -(10**10)])
def test_a_long_gap_and_a_set_clock_start_the_window_anew(name, shift_ns):
    stamps, lateral = sine(0.5e-3, 3.5, 10.0)
    criterion = make_criterion(name, RATE)
    criterion.update(stamps[:4000], lateral[:4000], SPEED)
    after = criterion.update(stamps[4000:4100] + shift_ns, lateral[4000:4100], SPEED)
    before = after['index'][~np.isnan(after['index'])]
    assert after.size == 100
    assert not (before > 0.05).any()  # 0.2 s hold no full window and no six peaks


def test_the_window_in_metres_takes_its_time_from_the_speed_and_without_one_is_undefined():
    stamps, lateral = sine(0.5e-3, 3.0, 11.0)
    for speed in (10.0, 20.0):
        index = make_criterion('uic_518', RATE).update(stamps, lateral, speed)['index']
        assert np.flatnonzero(np.isfinite(index))[0] / RATE == pytest.approx(
            100.0 / speed, abs=2.0 / RATE
        )
    criterion = make_criterion('uic_518', RATE)
    assert np.isnan(criterion.update(stamps, lateral)['index']).all()
    assert not criterion.exceeded


def test_the_trend_is_removed_inside_the_window():
    # The sums of the ring, which holds 2 s, against numpy, over more than one turn.
    stamps, lateral = sine(0.5e-3, 3.0, 10.0)
    lateral += 1e-5 * np.random.default_rng(3).normal(size=lateral.size).cumsum()
    criterion = make_criterion('cfr_213_333', RATE)
    index = criterion.update(stamps, lateral, SPEED)['index']
    ((_, _, values, _),) = LateralAcceleration(RATE, *criterion.band).update(
        stamps, lateral, SPEED
    )
    assert np.isnan(index[998])
    for k in (999, 1000, 2570, 4990):
        window = values[k - 999 : k + 1]
        fit = np.polyval(np.polyfit(np.arange(1000), window, 1), np.arange(1000))
        assert index[k] == pytest.approx(np.sqrt(np.mean((window - fit) ** 2)), rel=1e-9)


@pytest.mark.parametrize(('length_s', 'exceeded'), [(0.12, False), (0.6, True)])
def test_six_peaks_need_six(length_s, exceeded):
    # Three half cycles above the limit are not six peaks in a row.
    time = np.arange(4000) / RATE
    stamps = np.round(time * 1e9).astype(np.int64)
    burst = np.exp(-(((time - 4.0) / length_s) ** 2)) * np.sin(2 * np.pi * 4.0 * time)
    rows = make_criterion('six_peaks', RATE, scale=0.03).update(stamps, 1e-3 * burst)
    assert rows['exceeded'].any() == exceeded


@pytest.mark.parametrize(('name', 'rate'), [('cfr', RATE), ('ten_peaks', 15.0)])
def test_bad_settings_are_named(name, rate):
    with pytest.raises(ConfigError):
        make_criterion(name, rate)


def test_a_panel_says_when_each_criterion_begins_and_ceases():
    names = ['cfr_213_333', 'six_peaks']
    stamps, lateral = sine(0.5e-3, 3.5, 20.0)
    lateral[5000:] *= np.exp(-(stamps[5000:] - stamps[5000]) * 1e-9)
    verdicts = CriteriaPanel(names, RATE, 0.03).update(stamps, lateral)
    for name in names:
        own = [verdict.exceeded for verdict in verdicts if verdict.criterion == name]
        assert own == [True, False]


def test_a_panel_may_be_empty_and_names_what_it_does_not_know():
    assert CriteriaPanel([], RATE).update([0], [0.0]) == ()
    with pytest.raises(ConfigError, match='cfr_213_333'):
        CriteriaPanel(['cfr'], RATE)
