"""What the decision is to reach."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, State, detect
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.samples import Record, Series

LATERAL = DetectorConfig(channels=('lateral', 'speed'))

FORM = PAPER_NORMAL_FORM
SPEEDS = (6.8, 7.2, 7.4, 7.6)
RATE, KICK_S, END_S = 200.0, 12.0, 24.0
#: Quiet amplitude (r.m.s.) at 7.2 m/s and noise of the sensor, m.
QUIET, NOISE = 11e-6, 5e-6
#: Sizes of the kicks: of the stable amplitude, and of the unstable one.
HUNTS, DECAYS = (0.8, 1.2), (0.4, 0.8)


def kicked(speed: float, size: float, rng: np.random.Generator) -> tuple[Record, float]:
    """Return a record, kicked to the amplitude `size` (m), and the true one at its end."""
    step = 1.0 / RATE
    diffusion = -0.5 * float(FORM.growth_rate(7.2)) * QUIET**2
    count = round(END_S * RATE)
    shocks = math.sqrt(2.0 * diffusion * step) * (rng.normal(size=(count, 2)) @ np.array([1, 1j]))
    path = np.empty(count, dtype=np.complex128)
    z = complex(shocks[0])
    for k in range(count):
        if k == round(KICK_S * RATE):
            z = size * np.exp(2j * np.pi * rng.random())
        z = z * (1.0 + float(FORM.growth_rate(speed, abs(z))) * step) + shocks[k]
        path[k] = z
    t = (np.arange(count) + 1) * step
    values = (path * np.exp(2j * np.pi * FORM.frequency_hz * t)).real
    stamps = np.round(t * 1e9).astype(np.int64)
    record = Record(
        {
            'lateral': Series(stamps, values + NOISE * rng.normal(size=count)),
            'speed': Series(stamps, np.full(count, speed)),
        }
    )
    return record, float(np.abs(path[-200:]).mean())


def delays(kicks: int, hunts: bool, seed: int = 0) -> list[float]:
    """Return the time from each kick to ERROR, s (infinite: never), for kicks at four speeds."""
    found = []
    for number in range(kicks):
        rng = np.random.default_rng([seed, number, int(hunts)])
        speed = SPEEDS[number % len(SPEEDS)]
        branch = FORM.stable_amplitude(speed) if hunts else FORM.unstable_amplitude(speed)
        record, end = kicked(
            speed, float(branch) * rng.uniform(*(HUNTS if hunts else DECAYS)), rng
        )
        if (end > 0.5 * float(FORM.stable_amplitude(speed))) != hunts:
            continue  # the noise has decided otherwise
        rows = detect(HuntingDetector(LATERAL), record).estimates
        error = rows['stamp_ns'][rows['level'] == Level.ERROR]
        error = error[error > KICK_S * 1e9]
        found.append(error[0] * 1e-9 - KICK_S if error.size else math.inf)
    return found


def steady(amplitude_m: float, frequency_hz: float, speed: float, seconds: float) -> Record:
    """Return a steady motion with the noise of a sensor."""
    t = (np.arange(round(seconds * 200.0)) + 1) / 200.0
    noise = 5e-6 * np.random.default_rng(0).standard_normal(t.size)
    stamps = np.round(t * 1e9).astype(np.int64)
    values = amplitude_m * np.cos(2.0 * np.pi * frequency_hz * t) + noise
    return Record(
        {'lateral': Series(stamps, values), 'speed': Series(stamps, np.full(t.size, speed))}
    )


def test_without_a_form_a_kick_onto_the_limit_cycle_is_an_error_soon() -> None:
    kicks = np.array(delays(16, hunts=True))
    assert kicks.size > 12
    assert not np.isfinite(delays(8, hunts=False)).any()
    # With 95 % a kick, fewer than all but three of 16 come in one run of a hundred.
    assert (kicks <= 2.3).sum() >= kicks.size - 3


def test_the_chance_of_escape_is_continuous_through_the_fold() -> None:
    form = PAPER_NORMAL_FORM
    spread = np.array([0.02, 0.002, 0.01, 0.05, 0.05, 0.01])
    scale = np.array([1.0, form.D1, form.D4, form.D7, form.D10, form.D15])
    known = IdentifiedNormalForm(form, np.diag((spread * scale) ** 2))
    fold = form.nonlinear_critical_speed
    assert fold is not None
    chance, width = [], []
    for speed in (fold + 0.001, fold - 0.001):
        detector = HuntingDetector(LATERAL, known)
        row = detect(detector, steady(450e-6, form.frequency_hz, speed, 3.0)).estimates[-1]
        chance.append(row['escape_probability'])
        width.append(row['margin_high'] - row['margin_low'])
    assert chance[0] == pytest.approx(chance[1], abs=0.05)
    assert width[1] >= width[0], 'where the spread is not known nothing is known better'


def test_a_steady_motion_at_another_frequency_than_the_form_gives_is_no_hunting() -> None:
    detector = HuntingDetector(LATERAL, IdentifiedNormalForm(PAPER_NORMAL_FORM))
    output = detect(detector, steady(0.12e-3, 4.6, 6.0, 60.0))
    assert not any(event.level is Level.ERROR for event in output.events)
    assert detector.status.state in (State.QUIET, State.DISTURBED)
    assert detector.status.level is Level.WARN, 'it is in doubt what it is'
    assert any(
        re.search(r'not the hunting.* 4\.[56]\d* .*Hz.* 2\.8\d* Hz', reason)
        for reason in detector.status.reasons
    )


@pytest.mark.parametrize('hertz', [2.1, 2.84, 3.8], ids='{} Hz'.format)
def test_a_steady_motion_that_may_be_the_hunting_of_worn_wheels_is_hunting(hertz: float) -> None:
    detector = HuntingDetector(LATERAL, IdentifiedNormalForm(PAPER_NORMAL_FORM))
    output = detect(detector, steady(0.4e-3, hertz, 6.0, 30.0))
    assert 'limit_cycle' in [event.event for event in output.events]


def test_a_steady_motion_smaller_than_any_limit_cycle_of_the_form_is_in_doubt() -> None:
    detector = HuntingDetector(LATERAL, IdentifiedNormalForm(PAPER_NORMAL_FORM))
    output = detect(detector, steady(0.12e-3, 2.84, 6.0, 30.0))
    assert not any(event.level is Level.ERROR for event in output.events)
    assert detector.status.level is Level.WARN


def test_a_rig_that_names_its_frequency_needs_none_of_the_form() -> None:
    config = replace(LATERAL, hunting_frequency_hz=5.0)
    detector = HuntingDetector(config, IdentifiedNormalForm(PAPER_NORMAL_FORM))
    output = detect(detector, steady(0.4e-3, 5.0, 6.0, 30.0))
    assert 'limit_cycle' in [event.event for event in output.events]


def test_hunting_that_goes_on_at_another_frequency_is_hunting() -> None:
    detector = HuntingDetector(LATERAL, IdentifiedNormalForm(PAPER_NORMAL_FORM))
    t = (np.arange(12000) + 1) / 200.0
    size = 0.4e-3 * np.exp(-0.6 * np.clip(t - 20.0, 0.0, None))
    turn = np.where(t < 21.3, np.cos(2.0 * np.pi * 2.84 * t), np.cos(2.0 * np.pi * 4.6 * t))
    values = np.where(t < 21.3, size, 0.3e-3) * turn
    values += 5e-6 * np.random.default_rng(0).standard_normal(t.size)
    stamps = np.round(t * 1e9).astype(np.int64)
    record = Record(
        {'lateral': Series(stamps, values), 'speed': Series(stamps, np.full(t.size, 6.0))}
    )
    detect(detector, record)
    assert detector.status.state is State.LIMIT_CYCLE
