from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.forecast import CriticalSpeedForecast
from hunt_ros.forecast.levels import MOST_LEVELS, QuietLevels

RATE = 200.0


def collect(values: np.ndarray, speeds: np.ndarray, angles: np.ndarray | None = None):
    """Levels of a record that begins at stamp 0, and ends with a gap."""
    stamps = np.round(np.arange(values.size) / RATE * 1e9).astype(np.int64)
    levels = QuietLevels((0.8, 8.0))
    angles = np.full(values.size, np.nan) if angles is None else angles
    for part in (slice(None), slice(-1, None)):
        later = stamps[part] + (part.start is not None) * 10**10
        for _ in levels.update(later, values[part], speeds[part], angles[part]):
            pass
    return levels.levels


def noise(duration: float, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, 5e-6, round(duration * RATE))


def test_a_level_is_a_stretch_of_one_speed():
    speeds = np.repeat([4.0, 4.5, 4.0], round(40 * RATE))
    levels = collect(noise(120.0), speeds)
    assert [level.speed for level in levels] == pytest.approx([4.0, 4.5])
    assert [level.weight.max() for level in levels] == [2.0, 1.0]


def test_the_level_in_which_hunting_grew_is_dropped():
    levels = QuietLevels((0.8, 8.0))
    for begin in (0, 8000):
        stamps = np.round(np.arange(begin, begin + 4000) / RATE * 1e9).astype(np.int64)
        nothing = np.full(stamps.size, np.nan)
        speeds = np.full(stamps.size, 5.0 + begin / 8000)
        for _ in levels.update(stamps, noise(20.0, begin), speeds, nothing):
            pass
    assert levels.open_level().speed == 6.0
    levels.mark_disturbed()
    assert levels.open_level() is None
    assert [level.speed for level in levels.levels] == [5.0]


def test_a_long_hold_is_cut_and_averaged():
    levels = collect(noise(200.0), np.full(round(200 * RATE), 5.0))
    assert levels[0].weight.max() == 3.0
    assert levels[0].duration_s == pytest.approx(60.0, abs=1.1)


def test_a_ramp_gives_no_level():
    assert collect(noise(60.0), np.linspace(4.0, 7.0, round(60 * RATE))) == []


def test_white_noise_gives_its_level_in_every_bin():
    level = collect(noise(200.0), np.full(round(200 * RATE), 5.0))[0]
    density = 5e-6**2 / RATE
    kept = level.weight > 0.0
    assert level.periodogram[kept].mean() == pytest.approx(density, rel=0.1)
    assert level.floor == pytest.approx(density, rel=0.2)


def test_roughness_goes_with_the_encoder_angle():
    count = round(60 * RATE)
    angle = np.cumsum(np.full(count, 2 * 5.0 / 0.3 / RATE)) + 0.05 * np.sin(np.arange(count) / 99)
    rough = 100e-6 * np.cos(angle + 0.3) + 40e-6 * np.sin(2 * angle)
    plain = collect(noise(60.0), np.full(count, 5.0), angle)[0]
    level = collect(noise(60.0) + rough, np.full(count, 5.0), angle)[0]
    kept = level.weight > 0.0
    assert level.periodogram[kept] == pytest.approx(plain.periodogram[kept], rel=0.05, abs=1e-15)


def test_a_blow_is_cut_out():
    count = round(58 * RATE)
    time = np.arange(count) / RATE
    ringing = 1e-3 * np.exp(-np.maximum(time - 40.0, 0.0)) * np.sin(18.0 * time) * (time > 40.0)
    level = collect(noise(58.0) + ringing, np.full(count, 5.0))[0]
    assert 35.0 < level.duration_s < 40.0
    assert level.periodogram.max() < 100.0 * level.floor


def test_the_number_of_levels_is_bounded() -> None:
    rate, hold_s = 50.0, 9.0
    forecast = CriticalSpeedForecast(live=False)
    count = round(hold_s * rate)
    rng = np.random.default_rng(0)
    for number, speed in enumerate(np.geomspace(2.0, 12.0, MOST_LEVELS + 15)):
        stamps = np.round((np.arange(count) + 1 + number * count) / rate * 1e9).astype(np.int64)
        forecast.update(stamps, 1e-5 * rng.standard_normal(count), float(speed))
    speeds = sorted(level.speed for level in forecast.levels)
    assert MOST_LEVELS // 2 < len(speeds) <= MOST_LEVELS + 1  # and the one that is open
    assert speeds[0] < 2.3
    assert speeds[-1] > 11.0
