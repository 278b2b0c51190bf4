"""Clearance: which speeds are cleared, over seeds; and that no doubt ever is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hunt_ros.detection import DetectorConfig, HuntingDetector, doubts, health
from hunt_ros.detection.output import blank_rows
from hunt_ros.detection.regions import Region, State
from hunt_ros.detection.replay import watch
from hunt_ros.detection.words.clearance import Clearance, Clearances
from hunt_ros.dynamics.profile import Hold, Profile

S = 1_000_000_000
SEEDS = range(4)


def rows_of(seconds: float, speed: float = 7.4, **columns: object) -> np.ndarray:
    """Return quiet rows between v_n and v_c, 10 a second."""
    rows = blank_rows(100 * S + np.arange(round(10 * seconds), dtype=np.int64) * (S // 10))
    quiet = {'region': Region.HYSTERESIS, 'doubts': doubts.HYSTERESIS, 'margin': 6.0,
             'margin_low': 4.2, 'outlook': 1e-4, 'speed': speed}  # fmt: skip
    for name, value in (quiet | columns).items():
        rows[name] = value
    return rows


def verdict(rows: np.ndarray, doubt: str = '', forecast_mps: float = math.nan) -> Clearance:
    clearances = Clearances(DetectorConfig())
    clearances.update(rows)
    return clearances.now(doubt, forecast_mps)


def spoilt(at_s: float, **columns: object) -> np.ndarray:
    """Return 40 s of quiet rows of which one is another."""
    rows = rows_of(40.0)
    for name, value in columns.items():
        rows[name][round(10 * at_s)] = value
    return rows


def test_a_speed_that_is_held_and_quiet_is_cleared_in_one_sentence() -> None:
    found = verdict(rows_of(40.0))
    assert found.words == (
        '7.40 m/s is cleared: margin 4.2 (95 %), no escape expected in 10 minutes'
    )
    assert found.escape_chance == pytest.approx(1e-3, rel=1e-2)
    below = verdict(rows_of(40.0, region=Region.STABLE, doubts=0, margin=math.nan,
                            margin_low=math.nan, outlook=0.0))  # fmt: skip
    assert below.words.startswith('7.40 m/s is cleared: every motion dies out')


@pytest.mark.parametrize(
    ('rows', 'words'),
    [
        pytest.param(rows_of(19.0), 'held for 18 s of 20 s', id='too short'),
        pytest.param(rows_of(40.0, speed=np.linspace(7.2, 7.8, 400)), 'held', id='it changes'),
        pytest.param(rows_of(40.0, margin_low=1.9), 'margin 1.9 (95 %)', id='low margin'),
        pytest.param(rows_of(40.0, outlook=0.01), 'minutes 10 %', id='an escape is likely'),
        pytest.param(spoilt(30.0, margin_low=math.nan), 'not known', id='margin unknown'),
        pytest.param(spoilt(30.0, outlook=math.nan), 'not known', id='chance unknown'),
        pytest.param(rows_of(40.0, region=Region.STABLE, margin=math.nan, margin_low=math.nan,
                             outlook=math.nan), 'not known', id='boundaries alone are no form'),
        pytest.param(spoilt(30.0, speed=math.nan), 'held for', id='speed unknown'),
        pytest.param(spoilt(30.0, doubts=doubts.DISAGREE), 'disagree', id='WARN'),
        pytest.param(rows_of(40.0, doubts=doubts.UNSTABLE), 'above the linear', id='above v_c'),
        pytest.param(spoilt(30.0, lateral_wrong=health.SILENT), 'lateral', id='STALE'),
        pytest.param(spoilt(30.0, limits=1), 'limit', id='a limit of the lab'),
        pytest.param(spoilt(30.0, state=State.ESCAPING), 'escaping', id='it escaped'),
        pytest.param(np.delete(rows_of(40.0), range(250, 270)), 'held for', id='nothing heard'),
        pytest.param(rows_of(0.0), 'no estimates', id='no rows'),
    ],
)  # fmt: skip
def test_what_is_short_low_or_in_doubt_is_not_cleared_and_says_why(rows, words) -> None:
    found = verdict(rows)
    assert not found.cleared
    assert words in found.reason


def test_a_silent_detector_and_a_forecast_below_are_doubts() -> None:
    silent = verdict(rows_of(40.0), 'lateral: silent')
    assert (silent.words, math.isnan(silent.margin)) == ('not cleared: lateral: silent', True)
    below = verdict(rows_of(40.0), forecast_mps=7.3)
    assert 'forecast' in below.reason
    assert math.isnan(below.margin), 'no profile climbs by a form that the forecast contradicts'
    assert math.isnan(below.escape_chance)
    assert verdict(rows_of(40.0), forecast_mps=7.5).cleared


def test_a_doubt_is_over_once_it_has_left_the_last_seconds_and_hunting_is_margin_zero() -> None:
    assert verdict(spoilt(15.0, doubts=doubts.DISAGREE)).cleared
    now = verdict(rows_of(5.0, state=State.LIMIT_CYCLE))
    assert (now.margin, now.escape_chance) == (0.0, 1.0)


def test_a_speed_whose_readings_scatter_is_held() -> None:
    rng = np.random.default_rng(1)
    for seconds in (40.0, 40.3, 40.9):
        count = round(100 * seconds)
        rows = np.repeat(rows_of(seconds), 10)
        rows['stamp_ns'] = 100 * S + np.arange(count, dtype=np.int64) * (S // 100)
        rows['speed'] *= 1.0 + 0.01 * rng.standard_normal(count)
        assert verdict(rows).cleared


def test_the_verdict_is_the_same_in_any_blocks() -> None:
    rng = np.random.default_rng(1)
    rows = rows_of(150.0, speed=np.repeat([6.8, 7.4, 7.45, 7.6, 7.7], 300),
                   margin_low=rng.uniform(1.5, 6.0, 1500))  # fmt: skip
    whole = Clearances(DetectorConfig())
    whole.update(rows)
    assert [round(one.held_s) for one in whole.all()] == [30, 60, 30, 29]
    for _ in range(20):
        parts = Clearances(DetectorConfig())
        for block in np.split(rows, np.sort(rng.integers(0, rows.size, 40))):
            parts.update(block)
        assert repr(parts.all()) == repr(whole.all())
        assert repr(parts.now()) == repr(whole.now())


def test_another_form_begins_anew(recorded, true_form) -> None:
    detector = HuntingDetector(DetectorConfig(), true_form)
    for _ in watch(recorded(6.0, 30.0), detector):
        pass
    assert detector.clearances.now().cleared
    detector.set_normal_form(None)
    assert not detector.clearances.now().cleared


@pytest.mark.slow
def test_over_seeds_quiet_speeds_are_cleared_and_those_with_little_margin_never(
    recorded, true_form
) -> None:
    """Strong noise: at 7.6 m/s it would escape within minutes, and does so in some seeds."""
    profile = Profile(tuple(Hold(float(v), 32.0, 0.5) for v in (5.6, 6.2, 6.6, 7.6, 8.2)))
    found: dict[float, list[bool]] = {}
    for seed in SEEDS:
        detector = HuntingDetector(DetectorConfig(), true_form)
        record = recorded(profile, profile.duration_s, seed=seed, broadband=3e-5)
        for _ in watch(record, detector):
            pass
        for one in detector.clearances.all():
            found.setdefault(round(one.speed_mps, 1), []).append(one.cleared)
    assert all(len(verdicts) == len(SEEDS) for verdicts in found.values()), found
    assert not any(found[7.6] + found[8.2])
    assert all(found[5.6] + found[6.2])
    assert sum(found[6.6]) >= len(SEEDS) - 1
