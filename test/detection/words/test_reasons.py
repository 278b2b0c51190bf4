"""A reason is true of the numbers that stand beside it."""

from __future__ import annotations

import re

import numpy as np
import pytest

from hunt_ros.detection import DetectorConfig, HuntingDetector, doubts
from hunt_ros.detection.decision import states
from hunt_ros.detection.output import blank_rows, joined_rows
from hunt_ros.detection.regions import Region, State
from hunt_ros.detection.replay import watch
from hunt_ros.detection.words.reasons import Basis, margin_cause, reasons_of, state_cause
from hunt_ros.dynamics.profile import Corners, Profile

BASIS = Basis(DetectorConfig(), 6.4, 8.0)


def low_margin(margin: float, state: State, region: Region) -> np.void:
    row = blank_rows(np.zeros(1, dtype=np.int64))[0]
    row['doubts'], row['state'], row['region'] = doubts.MARGIN, state, region
    row['margin'] = row['margin_low'] = margin
    return row


def test_a_margin_above_its_limit_is_called_low_only_with_the_time_that_it_has_to_last() -> None:
    above = margin_cause(low_margin(119.0, State.QUIET, Region.HYSTERESIS), BASIS)
    assert 'is 119' in above
    assert 'limit 2 to be kept for 20 s after it was lower' in above
    below = margin_cause(low_margin(1.9, State.QUIET, Region.HYSTERESIS), BASIS)
    assert 'limit 2;' in below
    slow = Basis(DetectorConfig(hunting_frequency_hz=1.42), 6.4, 8.0)
    assert 'kept for 40 s' in margin_cause(low_margin(119.0, State.QUIET, Region.HYSTERESIS), slow)


def test_below_the_fold_the_margin_names_the_laws_that_it_is_of() -> None:
    told = margin_cause(low_margin(1.36, State.LIMIT_CYCLE, Region.STABLE), BASIS)
    assert 'unknown' not in told.split('unstable amplitude')[-1].split(',')[0]
    assert 'those of the laws that have one at this speed' in told


def test_the_amplitude_that_is_told_is_the_one_that_was_judged() -> None:
    row = blank_rows(np.zeros(1, dtype=np.int64))[0]
    row['state_cause'], row['noise_floor'] = states.STEADY, 5.4e-4
    row['lateral_amplitude'], row['lateral_amplitude_std'] = 6.7e-6, 1e-6
    row['judged'], row['judged_std'] = 1.2e-3, 1e-4
    told = state_cause(row, BASIS)[1]
    assert 'the amplitude 1.20 +/- 0.10 mm by yaw (lateral shows 0.0067 +/- 0.0010 mm)' in told
    row['judged'], row['judged_std'] = row['lateral_amplitude'], row['lateral_amplitude_std']
    assert 'the amplitude 0.0067 +/- 0.0010 mm stays' in state_cause(row, BASIS)[1]


@pytest.mark.parametrize('mean_m', [3e-9, 1e-7, 1e-4, 0.3, 90.0])
def test_an_amplitude_of_any_size_is_told_without_an_exponent(mean_m: float) -> None:
    told, rng = [], np.random.default_rng(1)
    for cause in (states.BEYOND, states.ARRIVED, states.STEADY, states.FALLS, states.OVER):
        for size in mean_m * rng.lognormal(size=20):
            row = blank_rows(np.zeros(1, dtype=np.int64))[0]
            row['state_cause'], row['lateral_amplitude'] = cause, size
            row['lateral_amplitude_std'] = size * rng.uniform(0.003, 1.0)
            row['noise_floor'] = row['unstable_amplitude'] = row['stable_amplitude'] = 0.5 * size
            told.append(state_cause(row, BASIS)[1])
    assert not [words for words in told if re.search(r'\de[+-]\d', words)]


def test_no_row_that_is_quiet_says_that_it_is_not_quiet_yet(recorded, true_form) -> None:
    profile = Profile((Corners((0.0, 12.0, 27.0, 45.0), (7.2, 7.2, 5.7, 5.7)),))
    record = recorded(profile, 45.0, kicks=[(5.0, 0.6e-3)])
    outputs = watch(record, HuntingDetector(DetectorConfig(), true_form))
    rows = joined_rows([one.estimates for one in outputs])
    basis = Basis(DetectorConfig(), 6.4, 8.0, true_form)
    low = rows[(rows['doubts'] & doubts.MARGIN != 0) & np.isnan(rows['margin'])]
    told = {(int(row['state']), ' '.join(reasons_of(row, basis))) for row in low}
    assert {state for state, _ in told} >= {State.LIMIT_CYCLE, State.DECAYING, State.QUIET}
    assert not any('has not yet' in words for state, words in told if state == State.QUIET)
