"""A level that steps and samples that are wrong are no motion: the amplitude stays what it is."""

from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.detection import DetectorConfig, HuntingDetector, detect
from hunt_ros.samples import Record, Series

RATE, END_S, STEP_S = 200.0, 13.0, 8.0
AMPLITUDE, NOISE = 0.2e-3, 5e-6
#: Yaw over lateral phasor, rad/m.
RATIO = -3.94 + 2.37j
CONFIG = DetectorConfig(channels=('lateral', 'yaw', 'speed'))


def signals(seed: int) -> tuple[np.ndarray, dict[str, np.ndarray], np.random.Generator]:
    """Return seconds, and what both sensors read of a steady motion."""
    rng = np.random.default_rng(seed)
    t = (np.arange(round(END_S * RATE)) + 1) / RATE
    turn = AMPLITUDE * np.exp(2j * np.pi * (2.84 * t + rng.random()))
    lateral = turn.real + NOISE * rng.normal(size=t.size)
    yaw = (RATIO * turn).real + 5.0 * NOISE * rng.normal(size=t.size)
    return t, {'lateral': lateral, 'yaw': yaw}, rng


def errors(t: np.ndarray, values: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return seconds of the rows, and the relative error of the lateral amplitude."""
    stamps = np.round(t * 1e9).astype(np.int64)
    channels = {**values, 'speed': np.full(t.size, 7.2)}
    record = Record({name: Series(stamps, channels[name]) for name in CONFIG.channels})
    rows = detect(HuntingDetector(CONFIG), record).estimates
    return rows['stamp_ns'] * 1e-9, rows['lateral_amplitude'] / AMPLITUDE - 1.0


@pytest.mark.xfail(
    strict=True,
    reason='a step of a level is taken for a kick until the mean of the innovations shows it:'
    ' the amplitude is wrong for 0.5 to 1.6 s, by up to 75 times',
)
@pytest.mark.parametrize('step_m', [0.2e-3, 10e-3])
@pytest.mark.parametrize('sensors', [('lateral',), ('yaw',), ('lateral', 'yaw')], ids='+'.join)
def test_a_level_that_steps_is_no_motion(sensors: tuple[str, ...], step_m: float) -> None:
    for seed in range(2):
        t, values, rng = signals(seed)
        for name in sensors:
            scale = 1.0 if name == 'lateral' else abs(RATIO)
            values[name][t > STEP_S + 0.35 * rng.random()] += scale * step_m
        seconds, error = errors(t, values)
        late = (seconds > 5.0) & (seconds < STEP_S) | (seconds > STEP_S + 0.65)
        assert np.abs(error[late]).max() < 0.05


_FOLLOWING = pytest.mark.xfail(
    strict=True, reason='two wrong samples that follow each other are taken for a kick'
)


@pytest.mark.parametrize('share', [0.01, pytest.param(0.05, marks=_FOLLOWING)])
@pytest.mark.parametrize('size_m', [AMPLITUDE, 5e-3])
def test_samples_that_are_wrong_are_left_out(share: float, size_m: float) -> None:
    found = []
    for seed in range(4):
        t, values, rng = signals(seed)
        for name, scale in (('lateral', 1.0), ('yaw', abs(RATIO))):
            wrong = rng.random(t.size) < share
            values[name][wrong] += scale * size_m * rng.normal(size=wrong.sum())
        seconds, error = errors(t, values)
        found.append(error[seconds > 5.0])
    assert np.mean(np.abs(found) > 0.05) < 0.002
