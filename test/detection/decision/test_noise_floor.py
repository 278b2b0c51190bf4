"""The noise floor: what it learns, how fast, and what it does not take for quiet."""

from __future__ import annotations

import math

import numpy as np
import pytest
from decided import ROWS, decided, noise

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.decision import decisions
from hunt_ros.detection.decision.form import form_numbers
from hunt_ros.detection.decision.outlook import OutlookTable
from hunt_ros.detection.decision.rules import rules_of
from hunt_ros.detection.regions import State
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM

RULES = rules_of(DetectorConfig(), math.nan, math.nan)


def quiet(seconds: float, rms: float, seed: int = 1) -> np.ndarray:
    return np.abs(noise(seconds, rms=rms, seed=seed))


class Floor:
    """The decisions without a form: what they take for the noise floor after each amplitude."""

    def __init__(self) -> None:
        self.memory = decisions.fresh_memory()

    def feed(self, amplitude: np.ndarray) -> float:
        return float(decided(amplitude, RULES, memory=self.memory)['noise_floor'][-1])


@pytest.mark.parametrize('rms', [8e-6, 80e-6])
def test_the_floor_is_the_rms_of_the_quiet_amplitude(rms: float) -> None:
    floors = [Floor().feed(quiet(60.0, rms, seed)) for seed in range(5)]
    assert np.mean(floors) == pytest.approx(rms, rel=0.3)


def test_a_disturbance_raises_the_floor_little_and_its_end_brings_it_back() -> None:
    floor = Floor()
    before = floor.feed(quiet(40.0, 8e-6))
    during = floor.feed(np.full(200, 200e-6))
    assert during < 2.0 * before
    assert floor.feed(quiet(60.0, 8e-6, 2)) < 1.6 * before


def test_the_floor_follows_at_once_where_the_motion_dies_down() -> None:
    floor = Floor()
    before = floor.feed(quiet(40.0, 80e-6))
    # By its time constant of 20 s alone it would be at 0.69 of it.
    assert floor.feed(quiet(15.0, 4e-6, 2)) < 0.55 * before


@pytest.mark.parametrize('rate', [0.0, 0.02, 0.1])
def test_hunting_that_holds_or_grows_from_the_start_is_not_taken_forquiet(rate: float) -> None:
    floor = Floor()
    path = 60e-6 * np.exp(rate * np.arange(2500) / ROWS)
    assert not floor.feed(path) > 6e-6


def test_what_hunts_just_when_the_noise_is_known_is_not_where_the_floor_begins() -> None:
    for waits in np.arange(3.0, 6.0, 0.25):
        floor = Floor()
        floor.feed(quiet(waits, 8e-6))
        assert not floor.feed(np.full(100, 400e-6)) > 40e-6


def test_where_the_form_has_no_quiet_state_nothing_is_learnt() -> None:
    memory = decisions.fresh_memory()
    form = form_numbers(IdentifiedNormalForm(PAPER_NORMAL_FORM))

    def learn(amplitude: np.ndarray, quiet_share: float) -> float:
        memory['outlook']['quiet'] = quiet_share
        decided(amplitude, memory=memory, form=form, speed=7.0)
        return math.sqrt(memory['floor']['square'][0])

    assert math.isnan(learn(quiet(8.0, 80e-6), 0.0))
    before = learn(quiet(20.0, 8e-6, 2), 1.0)
    assert learn(quiet(20.0, 25e-6, 3), 0.0) == before
    assert learn(quiet(20.0, 25e-6, 3), 1.0) > 1.3 * before


def test_what_as_likely_as_not_reaches_the_cycle_does_not_begin_the_floor() -> None:
    form = IdentifiedNormalForm(PAPER_NORMAL_FORM)
    memory = decisions.fresh_memory()
    memory['outlook'] = OutlookTable(form).at(7.2, math.nan, 0.0, math.nan, 0.0)
    # A start in the limit cycle, while little of its amplitude is known.
    path = 4e-4 + quiet(10.0, 8e-6)
    rows = decided(path, memory=memory, form=form_numbers(form), speed=7.2, std=2.5e-4)
    assert 0.5 < rows['escape_probability'][-1] < 0.95
    assert np.isnan(memory['floor']['square'])


def test_what_dies_out_at_another_speed_is_not_the_quiet_motion_there() -> None:
    memory = decisions.fresh_memory()
    before = decided(quiet(20.0, 8e-6), RULES, memory=memory, speed=7.0)['noise_floor'][-1]
    memory['state']['hunting']['word'], memory['state']['reference'] = (
        State.DECAYING,
        1e-3,
    )
    dying = np.geomspace(80.0, 4.0, int(2.0 * ROWS)) * before
    assert decided(dying, RULES, memory=memory, speed=6.0)['noise_floor'][-1] < 1.6 * before


def test_what_was_kicked_and_dies_out_is_no_noise() -> None:
    floor = Floor()
    before = floor.feed(quiet(20.0, 8e-6))
    for seed in range(8):
        kicked = 400e-6 * np.exp(-np.arange(10 * ROWS) / ROWS)
        floor.feed(quiet(10.0, 8e-6, seed) + kicked)
    assert floor.feed(quiet(1.0, 8e-6)) < 1.7 * before


def test_neither_a_kick_nor_the_error_of_the_filter_behind_it_tells_of_the_intensity() -> None:
    form = IdentifiedNormalForm(PAPER_NORMAL_FORM)
    memory = decisions.fresh_memory()
    memory['outlook'] = OutlookTable(form).at(7.2, math.nan, 0.0, math.nan, 0.0)
    memory['outlook']['quiet'] = 1.0
    kicked = 80e-6 * np.exp(-0.5 * np.arange(2 * ROWS) / ROWS)
    known = np.full(20 * ROWS + kicked.size, 1e-6)
    known[20 * ROWS : 20 * ROWS + 40] = 40e-6
    path = np.concatenate([quiet(20.0, 8e-6), kicked])
    rows = decided(path, memory=memory, form=form_numbers(form), speed=7.2, std=known)
    before = rows['noise_intensity'][20 * ROWS - 1]
    assert rows['noise_intensity'][20 * ROWS :] == pytest.approx(before, rel=0.1)


def test_noise_that_rises_is_followed_though_it_jumps_like_kicks() -> None:
    floor = Floor()
    floor.feed(quiet(40.0, 8e-6))
    assert floor.feed(quiet(80.0, 80e-6, 3)) > 0.5 * 80e-6
