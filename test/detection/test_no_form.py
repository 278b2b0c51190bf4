"""No form known: what the amplitude does decides, on rigs of any frequency and size."""

from __future__ import annotations

import math

import numpy as np
import pytest
from made import PAPER, at_most, forced_mode, record_of, words

from hunt_ros.detection import DetectorConfig, HuntingDetector, State, detect
from hunt_ros.detection.regions import Level
from hunt_ros.detection.words import reasons
from hunt_ros.estimation.tracker_config import REFERENCE_HZ

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


# --- without a form: a limit cycle from the first sample is said soon, and noise is none -------

#: Hunting frequencies, Hz, and samples in a period.
FREQUENCIES, SAMPLED = (0.6, 2.84, 7.0), 70
#: Spacing of the samples in seconds of a rig of the reference frequency.
STEP = 1.0 / (SAMPLED * REFERENCE_HZ)
#: Yaw over lateral phasor.
YAW = 6.0 * np.exp(1.2j)


def wandering(count: int, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Return noise of unit variance in each of its two components that forgets at this rate."""
    return forced_mode(rng, count, STEP, rate, 1.0)


def said(
    phasor: np.ndarray, hz: float, noise: float, yaw: bool, rng: np.random.Generator
) -> float:
    """Return when `limit_cycle` is said of a phasor (1e-4 m), s of the reference rig, or never."""
    t = (np.arange(phasor.size) + 1) / (SAMPLED * hz)
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
        found.append(
            said(size * np.exp(1j * turn), FREQUENCIES[seed % 3], noise, bool(seed % 2), rng)
        )
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
    for seed in range(30):
        rng = np.random.default_rng([2, seed])
        motion = wandering(round(15.0 / STEP), damping, rng)
        noise = math.exp(rng.uniform(math.log(0.01), math.log(3.0)))
        assert math.isinf(said(motion, FREQUENCIES[seed % 3], noise, bool(seed % 2), rng)), seed


# --- a motion that the filter does not follow is never OK, wherever its frequency lies ---------

RATE, AMPLITUDE, YAW_RATIO = 100.0, 2e-3, 4.0
CONFIG = DetectorConfig(
    channels=('lateral', 'yaw', 'speed'),
    critical_speed_mps=50.0,
    nonlinear_critical_speed_mps=45.0,
    lines=(),
)


def rows_of(lateral: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Run the detector over both signals at a constant speed far below hunting."""
    record = record_of((np.arange(lateral.size) + 1) / RATE, lateral=lateral, yaw=yaw, speed=5.0)
    return detect(HuntingDetector(CONFIG), record).estimates


@pytest.mark.parametrize('hz', [1.0, 1.5, 2.84, 5.0, 5.5])
@pytest.mark.parametrize('noise', [6e-6, 50e-6])
def test_a_limit_cycle_is_never_ok(hz: float, noise: float) -> None:
    rng = np.random.default_rng(round(10 * hz))
    t = np.arange(round(50.0 * RATE)) / RATE
    # Quiet for 15 s, then grown to its full size in the time of ten turns.
    size = AMPLITUDE * np.exp(np.minimum((t - 15.0) * hz / 2.0 - 5.0, 0.0)) * (t > 15.0)
    turn = size * np.exp(2j * np.pi * hz * t)
    lateral = turn.real + noise * rng.normal(size=t.size)
    yaw = (YAW_RATIO * turn).imag + 5.0 * noise * rng.normal(size=t.size)
    rows = rows_of(lateral, yaw)
    full = rows['stamp_ns'] * 1e-9 > 15.0 + 10.0 / hz + 8.0
    assert (rows['level'][full] != Level.OK).all()
    lost = full & (rows['lateral_amplitude'] < 0.5 * AMPLITUDE) & (rows['level'] == Level.WARN)
    if lost.any():
        told = reasons.outside_words(rows[np.flatnonzero(lost)[-1]])
        assert 'set hunting_frequency_hz' in told
        assert rows['outside_hz'][lost][-1] == pytest.approx(hz, rel=0.1)


def test_what_only_rings_on_after_a_blow_is_no_motion() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(round(60.0 * RATE)) / RATE
    lateral, yaw = 6e-6 * rng.normal(size=(2, t.size))
    blow = (t > 20.0) & (t < 24.0)
    lateral[blow] += 20e-3 * rng.normal(size=blow.sum())
    rows = rows_of(lateral, yaw)
    seconds = rows['stamp_ns'] * 1e-9
    late = seconds > 34.0
    assert (rows['level'][late] == Level.OK).mean() > 0.95
