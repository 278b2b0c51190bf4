"""Real input: a flutter rig with the same bifurcation, every file with one configuration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hunt_ros.estimation.kalman import HuntingTracker

FOLDER = Path(__file__).parents[3] / 'shared' / 'data' / 'flutter_rig'
pytestmark = pytest.mark.skipif(
    not FOLDER.exists(), reason=f'the flutter recordings are not at {FOLDER}'
)
MILLIMETRES = 470.0


def track(name):
    from scipy.io import loadmat

    data = loadmat(FOLDER / name)['data']
    count = data.shape[1]
    stamps = np.arange(1, count + 1) * 4_000_000
    values = np.stack([data[1] * MILLIMETRES, data[0]], axis=1).ravel()
    none = np.full(2 * count, np.nan)
    rows = HuntingTracker().update(
        np.repeat(stamps, 2),
        np.tile(np.array([0, 1], dtype=np.int8), count),
        values,
        none,
        none,
        np.arange(10_000_000, int(stamps[-1]) + 1, 10_000_000),
    )
    return rows, data[1] * MILLIMETRES


def names(pattern):
    return sorted(path.name for path in FOLDER.glob(pattern)) if FOLDER.exists() else []


@pytest.mark.parametrize('name', names('*BackFromHB.mat')[::3] + names('*TowardsHB.mat')[::6])
def test_amplitude_of_a_limit_cycle_is_the_fundamental_of_the_record(name):
    rows, heave = track(name)
    late = rows['lateral_amplitude'][500:]
    # The fundamental by least squares over the last 20 s, at the frequency that fits best.
    t = np.arange(heave.size)[-5000:] / 250.0
    part = heave[-5000:] - heave[-5000:].mean()

    def power(frequency):
        return np.abs(np.mean(part * np.exp(-2j * np.pi * frequency * t)))

    found = rows['frequency_hz'][-1000:].mean()
    truth = 2.0 * max(power(f) for f in found + np.linspace(-0.1, 0.1, 201))
    assert np.median(late) == pytest.approx(truth, rel=0.03)
    assert np.quantile(np.abs(late / truth - 1.0), 0.95) < 0.08
    assert np.median(np.abs(rows['growth_rate'][500:])) < 0.05
    assert np.median(rows['lateral_amplitude_std'][500:]) < 0.03 * truth


@pytest.mark.parametrize('name', names('*Hammer*.mat'))
def test_the_tracked_amplitude_follows_the_swing_of_the_record(name):
    rows, heave = track(name)
    # Half the span of the last 0.4 s is the amplitude to within noise and harmonics.
    ends = (rows['stamp_ns'] // 4_000_000).astype(int)
    use = np.arange(300, rows.size, 20)
    swing = np.array([np.ptp(heave[ends[i] - 100 : ends[i]]) / 2.0 for i in use])
    tracked = rows['lateral_amplitude'][use]
    large = swing > 5.0
    if large.sum() > 10:
        assert np.median(np.abs(tracked[large] / swing[large] - 1.0)) < 0.15
    if (~large).sum() > 10:
        assert np.median(tracked[~large] - swing[~large]) < 1.0


def test_growth_after_a_hit_has_the_sign_of_what_followed():
    for name, sign in (
        ('18092018_CBC_T248_P254_V207_Hammer.mat', -1),
        ('18092018_CBC_T248_P422_V270_Hammer.mat', 1),
    ):
        rows, _ = track(name)
        tracked = rows['lateral_amplitude']
        within = rows[150:500]
        sure = np.abs(within['growth_rate']) > 3.0 * within['growth_rate_std']
        assert np.sign(tracked[600] - tracked[150]) == sign
        assert np.sum(sure & (np.sign(within['growth_rate']) == sign)) > 5 * np.sum(
            sure & (np.sign(within['growth_rate']) == -sign)
        )
