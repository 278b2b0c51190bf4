"""Motion outside the range that is tracked is named; noise, drift and hunting are not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.estimation.line_search import LineSearch

RATE = 100.0
TIME = np.arange(3000) / RATE


def found(frequency: float, noise: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    signal = np.cos(2.0 * np.pi * frequency * TIME + 0.7) + noise * rng.normal(size=TIME.size)
    return LineSearch(RATE, 1.0, 6.0).update(1e-4 * (signal + 3.0))


@settings(max_examples=40, deadline=None)
@given(st.floats(0.45, 0.8) | st.floats(7.2, 16.0), st.floats(0.0, 0.25), st.integers(0, 99))
def test_a_motion_beside_the_range_is_found_with_its_amplitude(frequency, noise, seed) -> None:
    line, amplitude = found(frequency, noise, seed)
    assert np.isfinite(line[1500:]).mean() > 0.6
    assert np.nanmedian(line) == pytest.approx(frequency, rel=0.08)
    assert np.nanmedian(amplitude[2000:]) == pytest.approx(1e-4, rel=0.1)


@settings(max_examples=25, deadline=None)
@given(st.floats(1.0, 6.0), st.floats(0.0, 2.0), st.integers(0, 99))
def test_a_motion_inside_the_range_is_none_of_its_business(frequency, noise, seed) -> None:
    assert np.isnan(found(frequency, noise, seed)[0]).all()


def test_neither_white_noise_nor_drift_is_a_motion() -> None:
    rng = np.random.default_rng(3)
    white = rng.normal(size=360_000)
    for signal in (white, 0.003 * np.cumsum(white) + 0.1 * rng.normal(size=white.size)):
        assert np.isnan(LineSearch(RATE, 1.0, 6.0).update(signal)[0]).mean() > 0.9999


def test_blocks_and_gaps_change_nothing() -> None:
    rng = np.random.default_rng(4)
    signal = np.cos(2.0 * np.pi * 8.0 * TIME) + 0.1 * rng.normal(size=TIME.size)
    signal[1000:1040] = np.nan
    whole = LineSearch(RATE, 1.0, 6.0).update(signal)
    search = LineSearch(RATE, 1.0, 6.0)
    cuts = np.sort(rng.integers(0, TIME.size, 40))
    parts = np.concatenate([search.update(part) for part in np.split(signal, cuts)], axis=1)
    assert whole.tobytes() == parts.tobytes()
    assert np.isfinite(whole[0, -500:]).mean() > 0.8


@pytest.mark.parametrize('harmonic', [1.0, 2.0])
def test_a_line_that_is_known_is_passed_over_but_hides_no_other(harmonic) -> None:
    turning = 7.6
    line = np.cos(2.0 * np.pi * harmonic * turning * TIME)
    assert np.isfinite(LineSearch(RATE, 1.0, 6.0).update(line)[0, 1500:]).all()
    assert np.isnan(LineSearch(RATE, 1.0, 6.0).update(line, 1.02 * turning)[0]).all()
    slow = LineSearch(RATE, 1.0, 6.0).update(
        line + 0.8 * np.cos(2.0 * np.pi * 0.6 * TIME), turning
    )[0]
    assert np.median(slow[1500:]) == pytest.approx(0.6, rel=0.05)


def test_a_motion_at_the_limit_of_being_seen_does_not_chatter() -> None:
    rng = np.random.default_rng(5)
    time = np.arange(60_000) / RATE
    hunting = 0.5 * np.cos(2.0 * np.pi * 3.0 * time)  # as strong as may be beside the other
    swell = 1.0 + 0.1 * np.sin(2.0 * np.pi * 0.05 * time)
    signal = swell * np.cos(2.0 * np.pi * 9.0 * time) + hunting + 0.02 * rng.normal(size=time.size)
    seen = np.isfinite(LineSearch(RATE, 1.0, 6.0).update(signal)[0])
    assert np.count_nonzero(np.diff(seen)) <= 2
