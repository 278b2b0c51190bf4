"""No form known: what the amplitude does decides, on rigs of any frequency and size."""

from __future__ import annotations

import math

import numpy as np
import pytest
from made import PAPER, at_most, record_of, words

from hunt_ros.detection import DetectorConfig, HuntingDetector, State, detect

#: Frequency (Hz), unstable amplitude (m), damping in a period.
RIGS = [(0.6, 3e-2, 0.06), (2.84, 2e-4, 0.12), (11.0, 2e-5, 0.2)]
PERIODS, SAMPLES = 160, 60


def trial(rig, seed: int, hit: float, noise: float = 0.03, forcing: float = 0.05):
    """
    Amplitude equation with a subcritical law; amplitudes in units of the unstable one.

    `hit` is added to the phasor after 60 periods; return detector, output and the true amplitude
    at the end.
    """
    frequency, unstable, damping = rig
    rng = np.random.default_rng(seed)
    step = 1.0 / SAMPLES
    steps = rng.normal(size=(PERIODS * SAMPLES, 2)) @ np.array([1.0, 1j])
    z = 0.05 * np.exp(2j * np.pi * rng.random())
    path = np.empty(steps.size, dtype=np.complex128)
    turn = np.exp(2j * np.pi * step)
    for k, shock in enumerate(steps):
        if k == 60 * SAMPLES:
            z += hit * np.exp(2j * np.pi * rng.random())
        power = abs(z) ** 2
        growth = -damping * (1.0 - power) * (1.0 - power / 7.0)
        z = z * turn * math.exp(max(growth * step, -0.5)) + forcing * shock * math.sqrt(
            damping * step
        )
        path[k] = z
    values = unstable * (path.real + noise * rng.normal(size=path.size) + 3.0)
    record = record_of((np.arange(path.size) + 1) * step / frequency, lateral=values)
    nominal = 1.1 * frequency
    config = DetectorConfig(
        channels=('lateral',),
        hunting_frequency_hz=nominal,
        output_rate_hz=max(100.0, round(3.5 * nominal) * 10.0),
    )
    detector = HuntingDetector(config)
    return detector, detect(detector, record), float(np.abs(path[-SAMPLES:]).mean())


@pytest.mark.parametrize('form', [PAPER, None])
@pytest.mark.parametrize('rate_hz', [100.0, 500.0])
def test_the_noise_of_sensors_on_a_rig_that_stands_still_is_no_hunting(form, rate_hz) -> None:
    t = np.arange(30.0 * rate_hz) / rate_hz
    for seed in range(8):
        lateral, yaw = 1e-5 * np.random.default_rng(seed).standard_normal((2, t.size))
        record = record_of(t, lateral=lateral, yaw=yaw, speed=6.0)
        config = DetectorConfig(channels=tuple(record))
        found = detect(HuntingDetector(config, form), record).estimates['state']
        assert np.isin(found, (State.QUIET, State.DISTURBED)).all(), seed


def alarm_period(output, frequency: float) -> float:
    """Period in which the first alarm came; NaN without one."""
    hunts = (e.stamp_ns for e in output.events if e.event in ('escaping', 'limit_cycle'))
    return next(hunts, math.nan) * 1e-9 * frequency


def test_a_hit_that_grows_is_an_alarm_soon_after_it_hunts() -> None:
    wrong = []
    trials = [(rig, seed) for rig in RIGS for seed in range(3, 6)]
    for rig, seed in trials:
        detector, output, end = trial(rig, seed, 1.5)
        at = alarm_period(output, rig[0])
        found = detector.status.alarm and detector.status.state is State.LIMIT_CYCLE
        if end > 2.0 and not (found and 60.0 < at < 110.0):
            wrong.append((rig, seed, detector.status.state, at))
    assert len(wrong) <= at_most(0.02, len(trials)), wrong


def test_the_same_motion_slower_and_smaller_is_judged_alike() -> None:
    said = []
    for frequency, unstable in ((2.84, 2e-4), (0.71, 5e-2), (1.42, 1e-6)):
        rig = frequency, unstable, 0.12
        _, output, _ = trial(rig, 6, 1.5)
        said.append(words(output))
    assert said[0] == said[1] == said[2]
    assert said[0][:1] == ['escaping']
