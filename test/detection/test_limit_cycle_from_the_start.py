"""Without a form: a limit cycle from the first sample is said soon, and noise is none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from made import forced_mode, record_of

from hunt_ros.detection import DetectorConfig, HuntingDetector, detect
from hunt_ros.estimation.tracker_config import REFERENCE_HZ

#: Hunting frequencies, Hz, and samples in a period.
RIGS, SAMPLES = (0.6, 2.84, 7.0), 70
#: Spacing of the samples in seconds of a rig of the reference frequency.
STEP = 1.0 / (SAMPLES * REFERENCE_HZ)
#: Yaw over lateral phasor.
YAW = 6.0 * np.exp(1.2j)


def wandering(count: int, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Return noise of unit variance in each of its two components that forgets at this rate."""
    return forced_mode(rng, count, STEP, rate, 1.0)


def said(
    phasor: np.ndarray, hz: float, noise: float, yaw: bool, rng: np.random.Generator
) -> float:
    """Return when `limit_cycle` is said of a phasor (1e-4 m), s of the reference rig, or never."""
    t = (np.arange(phasor.size) + 1) / (SAMPLES * hz)
    stamps = np.round(t * 1e9).astype(np.int64)
    turning = phasor * np.exp(2j * np.pi * hz * rng.uniform(0.9, 1.1) * t)
    parts = {'lateral': 1.0 + 0j, 'yaw': YAW} if yaw else {'lateral': 1.0 + 0j}
    channels = {
        name: 1e-4 * ((part * turning).real + noise * abs(part) * rng.normal(size=t.size))
        for name, part in parts.items()
    }
    config = DetectorConfig(
        channels=tuple(channels),
        hunting_frequency_hz=hz,
    )
    events = detect(HuntingDetector(config), record_of(t, **channels)).events
    found = (e.stamp_ns for e in events if e.event == 'limit_cycle')
    return (next(found, math.inf) - stamps[0]) * 1e-9 * hz / REFERENCE_HZ


def cycles(clear: tuple[float, ...], wander: float, number: int) -> np.ndarray:
    """Return when cycles are said that stand so clear of the sensor's noise and wander so much."""
    found = []
    for seed in range(number):
        rng = np.random.default_rng([1, seed])
        count = round(12.0 / STEP)
        size = 1.0 + wander * wandering(count, rng.uniform(0.3, 3.0), rng).real
        turn = 2.0 * np.pi * rng.random() + np.cumsum(
            0.02 * math.sqrt(STEP) * rng.normal(size=count)
        )
        noise = 1.0 / clear[seed % len(clear)]
        found.append(said(size * np.exp(1j * turn), RIGS[seed % 3], noise, bool(seed % 2), rng))
    return np.array(found)


def test_a_limit_cycle_that_runs_from_the_first_sample_is_said_within_3_s() -> None:
    found = cycles((30.0, 100.0, 300.0, 100.0), 0.005, 96)
    assert found.min() > 0.5
    assert np.median(found) < 3.0
    assert np.quantile(found, 0.9) < 4.5
    assert np.isfinite(found).all()


def test_what_wanders_or_drowns_in_noise_takes_longer_and_is_said() -> None:
    found = cycles((10.0, 30.0), 0.01, 48)
    assert np.median(found) < 5.0
    assert np.isfinite(found).mean() > 0.9


@pytest.mark.parametrize('damping', [0.05, 0.1, 0.3, 1.0, 5.0])
def test_noise_of_no_bandwidth_is_a_limit_cycle_in_its_first_seconds(damping: float) -> None:
    for seed in range(60):
        rng = np.random.default_rng([2, seed])
        motion = wandering(round(15.0 / STEP), damping, rng)
        noise = math.exp(rng.uniform(math.log(0.01), math.log(3.0)))
        assert math.isinf(said(motion, RIGS[seed % 3], noise, bool(seed % 2), rng)), seed
