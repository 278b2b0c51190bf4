"""Soon after the start, or after a change of the speed: kicks, and noise that changes."""

from __future__ import annotations

import numpy as np
import pytest
from decided import QUIET, ROWS, decided, noise
from made import at_most

from hunt_ros.detection import State
from hunt_ros.detection.decision import decisions

#: When the speed has changed, s, and the speed before, m/s.
CHANGED_S, SPEED = 20.0, 5.0
SEEDS = 24


def said(seed: int, ratio: float, after_s: float, kick: float, damping: float, power: float):
    """Return rows that hunt, by the second since a kick so long after a change of the speed."""
    t = np.arange(round((CHANGED_S + after_s + 20.0) * ROWS)) / ROWS
    speed = SPEED * np.interp(t, [CHANGED_S - 1.0, CHANGED_S], [1.0, ratio])
    since = t - CHANGED_S - after_s
    jump = np.where(since < 0.0, 0.0, kick * QUIET * np.exp(-damping * np.maximum(since, 0.0)))
    driven = noise(t.size / ROWS, 0.4, seed=seed, lag_s=0.15)
    driven = driven * (speed / SPEED) ** (0.5 * power)
    rows = decided(np.abs(driven + jump), speed=speed)
    return since[np.isin(rows['state'], (State.ESCAPING, State.LIMIT_CYCLE))]


@pytest.mark.parametrize(('seconds', 'within_s'), [(2.0, 8.0), (4.0, 3.0), (8.0, 3.0)])
def test_a_kick_onto_the_limit_cycle_soon_after_the_start(seconds, within_s) -> None:
    """Before the noise is known no kick is told from it: it is said as a cycle is."""
    late = 0
    for seed in range(SEEDS):
        path = noise(seconds + 20.0, 0.4, seed=seed, lag_s=0.15)
        path[round(seconds * ROWS) :] += 40.0 * QUIET
        hunts = np.isin(decided(np.abs(path))['state'], (State.ESCAPING, State.LIMIT_CYCLE))
        late += not hunts[: round((seconds + within_s) * ROWS)].any()
    assert late <= at_most(0.1, SEEDS)


@pytest.mark.parametrize('ratio', [0.5, 0.88, 1.12, 1.3, 2.0])
@pytest.mark.parametrize('power', [0.0, 2.0, 4.0])
def test_a_noise_that_changes_with_the_speed_is_no_hunting(ratio, power) -> None:
    false = sum(said(seed, ratio, 5.0, 0.0, 0.0, power).size > 0 for seed in range(SEEDS))
    assert false <= at_most(0.01, SEEDS)


@pytest.mark.parametrize('ratio', [0.88, 1.3])
def test_a_kick_that_dies_out_soon_after_a_change_of_speed_is_none(ratio) -> None:
    false = sum(said(seed, ratio, 4.0, 40.0, 0.3, 2.0).size > 0 for seed in range(SEEDS))
    assert false <= at_most(0.05, SEEDS)


@pytest.mark.parametrize('after_s', [1.0, 2.0, 3.0, 6.0])
def test_a_kick_soon_after_a_change_of_speed_is_said_soon(after_s) -> None:
    late = 0
    for ratio in (0.88, 1.3):
        for seed in range(SEEDS):
            hunts = said(seed, ratio, after_s, 40.0, 0.0, 2.0)
            late += not np.any((hunts > 0.0) & (hunts < 3.0))
    assert late <= at_most(0.05, 2 * SEEDS)


def test_readings_of_one_speed_that_are_noisy_tell_as_much_as_exact_ones() -> None:
    path = np.abs(noise(30.0, 0.4, lag_s=0.15))
    readings = SPEED * (1.0 + 0.1 * np.random.default_rng(1).normal(size=path.size))
    rows = []
    for speed in (SPEED, readings):
        memory = decisions.fresh_memory()
        decided(path, memory=memory, speed=speed)
        rows.append(memory['motion']['off'][0])
    assert rows[0] == 0.0
    assert rows[1] < 0.05


@pytest.mark.parametrize('known_s', [8.0, 20.0])
def test_a_kick_when_the_speed_is_just_known_is_said_soon(known_s) -> None:
    """What came before the first reading is taken to have been at its speed."""
    late = 0
    for after_s in (0.5, 2.0):
        for seed in range(SEEDS):
            path = noise(known_s + after_s + 5.0, 0.4, seed=seed, lag_s=0.15)
            begin = round((known_s + after_s) * ROWS)
            path[begin:] += 40.0 * QUIET
            speed = np.where(np.arange(path.size) < known_s * ROWS, np.nan, 5.0)
            state = decided(np.abs(path), speed=speed)['state']
            hunts = np.isin(state, (State.ESCAPING, State.LIMIT_CYCLE))
            late += not hunts[begin : begin + round(3.0 * ROWS)].any()
    assert late <= at_most(0.05, 2 * SEEDS)
