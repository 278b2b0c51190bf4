"""What has happened: wrong samples, a kick, or a step of a level; told by what follows."""

from __future__ import annotations

import numpy as np
import pytest
from signals_made import hunting_signal

from hunt_ros.estimation.kalman import HuntingTracker

AT_S, PERIOD_S, NOISE = 6.0, 1.0 / 2.84, 5e-6
SEEDS = 20
QUIET = {'amplitude': 2.0 * NOISE, 'noise': NOISE, 'roughness': 0.0}


def tracked(signal, sensors):
    """Return seconds, the rows, and the true amplitude at them."""
    rows, phasor = signal.track(HuntingTracker(), sensors)
    return rows['stamp_ns'] * 1e-9, rows, np.abs(phasor)


@pytest.mark.parametrize('size', [20.0, 400.0], ids='{} times the noise'.format)
@pytest.mark.parametrize('sensors', [(0,), (0, 1)], ids=['lateral', 'both'])
@pytest.mark.parametrize('rate', [100.0, 1000.0], ids='{} Hz'.format)
def test_a_kick_is_followed_and_a_step_of_the_level_is_not(size, sensors, rate) -> None:
    followed, stays = [], []
    for seed in range(SEEDS):
        quiet = {**QUIET, 'duration': 7.5, 'rate': rate}
        kick = hunting_signal(seed, kick_at=AT_S, kick=size * NOISE, second=size * NOISE, **quiet)
        seconds, rows, true = tracked(kick, sensors)
        later = (seconds > AT_S + PERIOD_S) & (seconds < AT_S + 2.0 * PERIOD_S)
        error = np.abs(rows['lateral_amplitude'] - true)[later]
        followed.append(np.median(error / rows['lateral_amplitude_std'][later]))

        step = hunting_signal(seed, **quiet)
        step.lateral[step.stamps * 1e-9 >= AT_S] += size * NOISE
        seconds, rows, true = tracked(step, sensors)
        later = (seconds > AT_S + 0.5 * PERIOD_S) & (seconds < AT_S + 2.0 * PERIOD_S)
        error = np.abs(rows['lateral_amplitude'] - true)[later]
        stays.append(np.max(error) / (size * NOISE))
    assert np.mean(np.array(followed) < 3.0) >= 0.9
    assert np.mean(np.array(stays) < 0.2) >= 0.9


def test_while_it_is_open_what_has_happened_the_deviation_says_so() -> None:
    """The first sample after a kick may be a wrong one: the deviation grows with it already."""
    grown, back = [], []
    for seed in range(SEEDS):
        signal = hunting_signal(seed, duration=7.0, rate=100.0, noise=NOISE, roughness=0.0)
        signal.lateral[599] += 1e-3
        seconds, rows, _ = tracked(signal, (0,))
        std = rows['lateral_amplitude_std']
        before, then, after = (std[np.searchsorted(seconds, s)] for s in (5.99, 6.0, 6.2))
        grown.append(then / before)
        back.append(after / before)
    assert np.median(grown) > 2.0
    assert np.median(back) < 1.2


def test_a_sensor_that_starts_disturbs_no_other() -> None:
    for seed in range(SEEDS // 4):
        kick = {'kick_at': AT_S, 'kick': 400.0 * NOISE, 'second': 400.0 * NOISE}
        signal = hunting_signal(seed, duration=6.1, rate=200.0, **kick, **QUIET)
        _, alone, _ = tracked(signal, (0,))
        signal.yaw[signal.stamps * 1e-9 < AT_S - 0.04] = np.nan  # it has not started at the end
        _, rows, _ = tracked(signal, (0, 1))
        for name in ('lateral_amplitude', 'lateral_amplitude_std'):
            np.testing.assert_allclose(rows[name], alone[name], rtol=1e-9)


def test_a_short_gap_and_two_absurd_samples_start_no_sensor_anew() -> None:
    for gap_s in (0.03, 0.1, 0.5):
        signal = hunting_signal(0, duration=8.0, rate=200.0, noise=NOISE, roughness=0.0)
        seconds = signal.stamps * 1e-9
        signal.lateral[(seconds > AT_S) & (seconds <= AT_S + gap_s)] = np.nan
        behind = np.flatnonzero(seconds > AT_S + gap_s)[:2]
        signal.lateral[behind] += 1.0
        rows, _ = signal.track(HuntingTracker(), (0,))
        assert np.isfinite(rows['lateral_amplitude'][100:]).all()


def test_kicks_that_come_each_half_second_are_followed() -> None:
    """Each is a kick, and no noise: what comes again is no reason to believe the sensors less."""
    sure = []
    for seed in range(SEEDS // 2):
        rng = np.random.default_rng(seed)
        signal = hunting_signal(seed, duration=11.0, rate=500.0, amplitude=2e-5, noise=NOISE)
        seconds = signal.stamps * 1e-9
        for begin in AT_S + 0.5 * np.arange(8):
            jump = 1.5e-4 * np.exp(2j * np.pi * (rng.random() + seconds / PERIOD_S))
            more = np.where(seconds >= begin, jump * np.exp(0.5 * (begin - seconds)), 0.0)
            signal.phasor = signal.phasor + more
            signal.lateral = signal.lateral + more.real
            signal.yaw = signal.yaw + (signal.ratio * more).real
        seconds, rows, true = tracked(signal, (0, 1))
        error = (rows['lateral_amplitude'] / true - 1.0)[(seconds > 8.0) & (seconds < 10.0)]
        sure.append(np.sqrt(np.mean(error**2)))
    assert np.median(sure) < 0.14


@pytest.mark.parametrize('rate', [200.0, 1000.0], ids='{} Hz'.format)
def test_motion_that_stops_cut_off_has_its_amplitude(rate) -> None:
    """Each flank of a wave that has grown into the stops is no kick: it is its shape."""
    rng = np.random.default_rng(0)
    seconds = np.arange(1, round(36.0 * rate)) / rate
    size = 4.0 * np.exp(np.minimum(0.5 * (seconds - 12.0), 0.0))
    wave = 6e-4 * np.clip(size * np.sin(2.0 * np.pi * seconds / PERIOD_S), -1.0, 1.0)
    stamps = np.round(seconds * 1e9).astype(np.int64)
    values = wave + 1e-6 * rng.standard_normal(seconds.size)
    rows_ns = np.arange(1, 3500) * 10_000_000
    rows = HuntingTracker().update(stamps, 0, values, np.nan, 7.0, rows_ns)
    full = seconds > 12.0
    turns = np.exp(2j * np.pi * seconds / PERIOD_S)
    fundamental = 2.0 * abs(np.mean((wave * turns)[full]))
    assert rows['lateral_amplitude'][2000:] == pytest.approx(fundamental, rel=0.05)
