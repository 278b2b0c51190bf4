"""What the decision is to reach."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from made import PAPER, record_of, words

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, State, detect
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.samples import Record, Series

LATERAL = DetectorConfig(channels=('lateral', 'speed'))


def steady(amplitude_m: float, frequency_hz: float, speed: float, seconds: float) -> Record:
    """Return a steady motion with the noise of a sensor."""
    t = (np.arange(round(seconds * 200.0)) + 1) / 200.0
    noise = 5e-6 * np.random.default_rng(0).standard_normal(t.size)
    values = amplitude_m * np.cos(2.0 * np.pi * frequency_hz * t) + noise
    return record_of(t, lateral=values, speed=speed)


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
    detector = HuntingDetector(LATERAL, PAPER)
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
    detector = HuntingDetector(LATERAL, PAPER)
    assert 'limit_cycle' in words(detect(detector, steady(0.4e-3, hertz, 6.0, 30.0)))


def test_a_steady_motion_smaller_than_any_limit_cycle_of_the_form_is_in_doubt() -> None:
    detector = HuntingDetector(LATERAL, PAPER)
    output = detect(detector, steady(0.12e-3, 2.84, 6.0, 30.0))
    assert not any(event.level is Level.ERROR for event in output.events)
    assert detector.status.level is Level.WARN


def test_a_motion_that_is_not_the_hunting_is_not_it_where_the_speed_is_silent_either() -> None:
    wrong = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        record = steady(rng.uniform(0.03e-3, 0.2e-3), rng.uniform(1.5, 4.6), rng.uniform(3, 6), 20)
        t = (record['speed'].stamps_ns - record.start_ns) * 1e-9
        silent = (t > rng.uniform(2.0, 10.0)) & (t < 15.0)
        speed = Series(record['speed'].stamps_ns[~silent], record['speed'].values[~silent])
        events = detect(HuntingDetector(LATERAL, PAPER), Record({**record, 'speed': speed})).events
        wrong += [(seed, event) for event in events if event.level is Level.ERROR][:1]
    assert not wrong


def test_a_rig_that_names_its_frequency_needs_none_of_the_form() -> None:
    detector = HuntingDetector(replace(LATERAL, hunting_frequency_hz=5.0), PAPER)
    assert 'limit_cycle' in words(detect(detector, steady(0.4e-3, 5.0, 6.0, 30.0)))


def test_hunting_that_goes_on_at_another_frequency_is_hunting() -> None:
    detector = HuntingDetector(LATERAL, PAPER)
    t = (np.arange(12000) + 1) / 200.0
    size = 0.4e-3 * np.exp(-0.6 * np.clip(t - 20.0, 0.0, None))
    turn = np.where(t < 21.3, np.cos(2.0 * np.pi * 2.84 * t), np.cos(2.0 * np.pi * 4.6 * t))
    values = np.where(t < 21.3, size, 0.3e-3) * turn
    values += 5e-6 * np.random.default_rng(0).standard_normal(t.size)
    detect(detector, record_of(t, lateral=values, speed=6.0))
    assert detector.status.state is State.LIMIT_CYCLE
