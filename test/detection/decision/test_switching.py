"""A limit cycle in strong noise: it holds because it returns, and is told by that."""

from __future__ import annotations

import math

import numpy as np
import pytest
from decided import ROWS, decided, noise

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.decision import decisions, switching
from hunt_ros.detection.decision.rules import rules_of
from hunt_ros.detection.regions import State

#: Without a form.
RULES = rules_of(DetectorConfig(), math.nan, math.nan)
#: Amplitude of the cycle, m; its quiet motion has a twelfth.
CYCLE, QUIET = 2.4e-3, 0.2e-3


def amplitude(seconds: float, cycles_from: float, seed: int) -> np.ndarray:
    """Return that of a motion damped by 1/s, and from then on in a cycle, under one noise."""
    rng, step = np.random.default_rng(seed), 1.0 / ROWS
    shocks = QUIET * math.sqrt(step) * (rng.normal(size=(round(seconds * ROWS), 2)) @ [1.0, 1j])
    z, path = 0j, []
    for k, shock in enumerate(shocks):
        growth = 1.0 - (abs(z) / CYCLE) ** 2 if k * step >= cycles_from else -1.0
        z = z * math.exp(growth * step) + shock
        path.append(abs(z))
    return np.array(path)


def test_a_cycle_a_dozen_times_as_large_as_the_noise_is_said() -> None:
    """It stayed "not decided" for as long as it lasted: noise damped by 0.05 1/s may be large."""
    said = 0
    for seed in range(4):
        rows = decided(amplitude(60.0, 30.0, seed), RULES, std=20e-6)
        hunts = np.isin(rows['state'], (State.ESCAPING, State.LIMIT_CYCLE))
        assert not hunts[: 30 * ROWS].any()
        said += bool(hunts[50 * ROWS :].all())
    assert said >= 3


def test_noise_alone_is_no_cycle_however_strong() -> None:
    hunts = 0
    for seed in range(4):
        rows = decided(amplitude(90.0, math.inf, seed), RULES, std=20e-6)
        hunts += int(np.isin(rows['state'], (State.ESCAPING, State.LIMIT_CYCLE)).any())
    assert hunts == 0


def test_each_row_says_how_likely_it_hunts() -> None:
    rows = decided(amplitude(60.0, 30.0, 0), RULES, std=20e-6)
    hunts = np.isin(rows['state'], (State.ESCAPING, State.LIMIT_CYCLE))
    chance = rows['hunting_probability']
    assert chance[hunts][0] > 0.98 > chance[~hunts][-1]
    assert np.nanmedian(chance[: 25 * ROWS]) < 1e-3


def test_what_begins_to_hunt_is_as_rare_as_false_alarms_are_to_be() -> None:
    hazards = [
        rules_of(DetectorConfig(false_alarms_per_week=rate), math.nan, math.nan).hazard
        for rate in (1.0, 0.1)
    ]
    assert hazards[0] == 10.0 * hazards[1]


@pytest.mark.parametrize('std', [1.0, 3.0])
def test_an_estimate_of_nothing_that_moves_smoothly_is_no_cycle(std: float) -> None:
    """A filter at rest: an amplitude within its own error, which hardly changes."""
    t = np.arange(120 * ROWS) / ROWS
    path = 0.7e-6 * (1.0 + 0.02 * np.sin(0.1 * t))
    rows = decided(np.asarray(path), RULES, std=std * 1e-6, speed=0.0)
    assert not np.isin(rows['state'], (State.ESCAPING, State.LIMIT_CYCLE)).any()


def test_what_is_damped_by_less_than_the_least_damping_is_a_cycle_to_the_model_too() -> None:
    t = np.arange(16 * ROWS) / ROWS
    kicked = np.where(t < 10.0, 0.0, 800e-6 * np.exp(-0.1 * (t - 10.0)))
    path = np.abs(noise(16.0, 0.4) + kicked)
    for least, hunts in ((0.05, False), (0.5, True)):
        rules = rules_of(DetectorConfig(least_damping_per_s=least), math.nan, math.nan)
        memory = decisions.fresh_memory()
        decided(path, rules, memory=memory)
        assert (switching.hunts(memory[0]['motion']) > 0.99) == hunts


def test_a_cycle_that_is_kicked_again_and_again_goes_on() -> None:
    """Hands kick it to three times its amplitude, to which it returns: it was said to die out."""
    t = np.arange(90 * ROWS) / ROWS
    since = np.where(t < 40.0, np.inf, np.mod(t - 40.0, 4.0))
    path = np.where(t < 20.0, 0.0, CYCLE * (1.0 + 2.0 * np.exp(-4.0 * since)))
    hunting = 0
    for seed in range(4):
        rows = decided(np.abs(noise(90.0, 1.0, QUIET / 4.0, seed) + path), RULES, std=20e-6)
        hunts = np.isin(rows['state'], (State.ESCAPING, State.LIMIT_CYCLE))
        hunting += bool(hunts[40 * ROWS :].mean() > 0.98)
    assert hunting >= 3
