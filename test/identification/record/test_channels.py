"""Channels on the time of the lateral samples: the speed behind coarse readings."""

from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.identification.record.channels import between_steps, speed_step
from hunt_ros.samples import Series

STEP = 0.1
TIME = np.arange(0.0, 300.0, 0.02)


def read(speed: np.ndarray, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    wandering = noise * np.random.default_rng(seed).standard_normal(TIME.size)
    return STEP * np.round((speed + wandering) / STEP)


@pytest.mark.parametrize('noise', [0.0, 0.01])
def test_a_ramp_is_seen_through_the_steps_of_its_readings(noise):
    true = np.interp(TIME, [0.0, 150.0, 300.0], [6.0, 9.0, 6.0])
    error = between_steps(TIME, read(true, noise), STEP) - true
    inside = (np.abs(TIME - 150.0) > 15.0) & (TIME > 15.0) & (TIME < 285.0)
    assert np.abs(error[inside]).max() < 0.2 * STEP


def test_a_hold_between_two_ramps_keeps_its_reading():
    true = np.interp(TIME, [0.0, 50.0, 100.0, 200.0, 250.0, 300.0], [6.0, 6.0, 7.0, 7.0, 8.0, 8.0])
    found = between_steps(TIME, read(true + 0.03), STEP)
    held = (TIME > 105.0) & (TIME < 195.0)
    np.testing.assert_allclose(found[held], 7.0)


@pytest.mark.parametrize(
    ('speed', 'step'),
    [
        (np.linspace(6.0, 9.0, 5000), 0.0),  # as fine as it is
        (np.round(np.linspace(6.0, 9.0, 5000), 1), 0.1),
        (np.repeat([6.0, 6.5, 7.0], 2000), 0.0),  # levels that somebody told
    ],
)
def test_steps_of_a_reading_are_told_from_levels(speed, step):
    stamps = np.arange(speed.size, dtype=np.int64) * 20_000_000
    assert speed_step(Series(stamps, speed)) == pytest.approx(step)


def test_a_coarse_speed_that_is_read_seldom_stays_as_it_is():
    speed = np.array([6.0, 6.1, 6.2, 6.3, 6.2, 6.1])
    np.testing.assert_allclose(between_steps(np.arange(6.0), speed, STEP), speed)
