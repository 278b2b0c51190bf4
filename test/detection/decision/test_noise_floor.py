"""The noise floor: what it learns, how fast, and what it does not take for quiet."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.decision import decisions, likelihood
from hunt_ros.detection.decision.rules import rules_of

PERIOD = 0.01
STD = 1e-6


def _quiet(seconds: float, rms: float, seed: int = 1, damping: float = 0.35) -> np.ndarray:
    """Amplitude of narrow-band noise, m."""
    rng = np.random.default_rng(seed)
    keep = math.exp(-damping * PERIOD)
    z = rms / math.sqrt(2.0) * (rng.standard_normal() + 1j * rng.standard_normal())
    found = []
    for _ in range(round(seconds / PERIOD)):
        step = rng.standard_normal() + 1j * rng.standard_normal()
        z = keep * z + rms * math.sqrt(0.5 * (1.0 - keep**2)) * step
        found.append(abs(z))
    return np.array(found)


class Floor:
    """The noise floor alone, fed with amplitudes."""

    def __init__(self, **changes: float) -> None:
        self.rules = rules_of(DetectorConfig(**changes), 6.4, 8.0)  # type: ignore[arg-type]
        self.memory = decisions.fresh_memory()

    def feed(self, amplitudes: np.ndarray, basin: bool = True) -> float:
        memory = self.memory[0]
        for a in amplitudes:
            likelihood.watch(self.rules, memory['ratios'], a, STD, math.nan)
            likelihood.observe(self.rules, memory['floor'], a)
            likelihood.learn(self.rules, memory['floor'], memory['ratios'], a, basin)
        return float(likelihood.floor_of(memory['floor'], memory['ratios'], STD))


@pytest.mark.parametrize('rms', [8e-6, 80e-6])
def test_the_floor_is_the_rms_of_the_quiet_amplitude(rms: float) -> None:
    floors = [Floor().feed(_quiet(60.0, rms, seed)) for seed in range(5)]
    assert np.mean(floors) == pytest.approx(rms, rel=0.3)


def test_a_disturbance_raises_the_floor_little_and_its_end_brings_it_back() -> None:
    floor = Floor()
    before = floor.feed(_quiet(40.0, 8e-6))
    during = floor.feed(np.full(200, 200e-6))
    assert during < 2.0 * before
    assert floor.feed(_quiet(60.0, 8e-6, 2)) < 1.6 * before


def test_where_the_form_knows_no_quiet_motion_the_floor_does_not_rise_but_falls() -> None:
    floor = Floor()
    before = floor.feed(_quiet(40.0, 8e-6))
    louder = _quiet(60.0, 25e-6, 3)
    assert floor.feed(louder, basin=False) <= before
    assert floor.feed(_quiet(30.0, 2e-6, 2), basin=False) < 0.6 * before
    assert floor.feed(louder) > 1.5 * before


def test_the_floor_follows_at_once_where_the_motion_dies_down() -> None:
    floor = Floor()
    before = floor.feed(_quiet(40.0, 80e-6))
    # By its time constant of 20 s alone it would be at 0.69 of it.
    assert floor.feed(_quiet(15.0, 4e-6, 2)) < 0.55 * before


@pytest.mark.parametrize('rate', [0.0, 0.02, 0.1])
def test_hunting_that_holds_or_grows_from_the_start_is_not_taken_for_quiet(rate: float) -> None:
    floor = Floor()
    path = 60e-6 * np.exp(rate * PERIOD * np.arange(2500))
    assert not floor.feed(path) > 6e-6


def test_what_hunts_just_when_the_noise_is_known_is_not_where_the_floor_begins() -> None:
    for waits in np.arange(3.0, 6.0, 0.25):
        floor = Floor()
        floor.feed(_quiet(waits, 8e-6))
        assert floor.feed(np.full(100, 400e-6)) < 40e-6


def test_the_floor_does_not_begin_on_what_escapes_by_the_form() -> None:
    floor = Floor()
    floor.feed(_quiet(20.0, 80e-6), basin=False)
    assert math.isnan(floor.memory['floor']['square'][0])
    assert floor.feed(_quiet(20.0, 80e-6, 2)) > 20e-6
