"""Motion outside the range that is tracked is named; noise, drift and hunting are not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.errors import ConfigError
from hunt_ros.estimation.line_search import LineSearch

RATE = 100.0
TIME = np.arange(3000) / RATE


def found(frequency: float, noise: float, seed: int = 0, scale: float = 1e-4) -> np.ndarray:
    rng = np.random.default_rng(seed)
    signal = np.cos(2.0 * np.pi * frequency * TIME + 0.7) + noise * rng.normal(size=TIME.size)
    return LineSearch(RATE, 1.0, 6.0).update(scale * (signal + 3.0))


@settings(max_examples=25, deadline=None)
@given(st.floats(0.45, 0.8), st.floats(0.0, 0.5), st.integers(0, 99))
def test_a_motion_below_the_range_is_found(frequency, noise, seed) -> None:
    line = found(frequency, noise, seed)
    assert np.isfinite(line[1500:]).mean() > 0.9
    assert np.nanmedian(line) == pytest.approx(frequency, rel=0.08)


@settings(max_examples=25, deadline=None)
@given(st.floats(7.2, 16.0), st.floats(0.0, 0.25), st.integers(0, 99))
def test_a_motion_above_the_range_is_found(frequency, noise, seed) -> None:
    line = found(frequency, noise, seed)
    assert np.isfinite(line[1500:]).mean() > 0.6
    assert np.nanmedian(line) == pytest.approx(frequency, rel=0.08)


@settings(max_examples=25, deadline=None)
@given(st.floats(1.0, 6.0), st.floats(0.0, 2.0), st.integers(0, 99))
def test_a_motion_inside_the_range_is_none_of_its_business(frequency, noise, seed) -> None:
    assert np.isnan(found(frequency, noise, seed)).all()


def test_neither_white_noise_nor_drift_is_a_motion() -> None:
    rng = np.random.default_rng(3)
    white = rng.normal(size=360_000)
    for signal in (white, 0.003 * np.cumsum(white) + 0.1 * rng.normal(size=white.size)):
        assert np.isnan(LineSearch(RATE, 1.0, 6.0).update(signal)).mean() > 0.9999


def test_blocks_gaps_and_reset_change_nothing() -> None:
    rng = np.random.default_rng(4)
    signal = np.cos(2.0 * np.pi * 8.0 * TIME) + 0.1 * rng.normal(size=TIME.size)
    signal[1000:1040] = np.nan
    search = LineSearch(RATE, 1.0, 6.0)
    whole = search.update(signal)
    search.reset()
    cuts = np.sort(rng.integers(0, TIME.size, 40))
    parts = np.concatenate([search.update(part) for part in np.split(signal, cuts)])
    assert whole.tobytes() == parts.tobytes()
    assert np.isfinite(whole[-500:]).mean() > 0.8


def test_a_range_beyond_the_rate_is_refused() -> None:
    with pytest.raises(ConfigError, match='inside'):
        LineSearch(10.0, 1.0, 6.0)
