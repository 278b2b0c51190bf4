"""Whether the roller does as it is told, and the wheelset stays in its limit, as measured."""

from __future__ import annotations

import itertools
import math
import re
import sys
import threading
from collections.abc import Callable

import numpy as np
import pytest

from hunt_ros.drivers.base import DriveBlock
from hunt_ros.drivers.readings import Displacement, RollerReadings

STEP_S = 0.01


def _ride(
    target: Callable[[float], float],
    speed: Callable[[float], float],
    seconds: float,
    ceiling: float = math.inf,
    turns: float = 1.0,
    noise: float = 0.0,
    foreign: float = math.nan,
) -> dict[str, float]:
    """Let time pass; return what was said, and when first, s."""
    rng = np.random.default_rng(1)
    readings = RollerReadings(0.3)
    angle, said = 0.0, {}
    for k in range(round(seconds / STEP_S)):
        now_s = 100.0 + k * STEP_S
        true = speed(k * STEP_S)
        angle += turns * true * STEP_S / 0.15
        shown = np.array([true + noise * rng.standard_normal()])
        stamps = np.array([round(1e9 * now_s)])
        readings.take(now_s, DriveBlock(stamps, np.array([angle]), shown, foreign))
        if k % 10 == 0 and (words := readings.fault(now_s, target(k * STEP_S), ceiling)):
            said.setdefault(re.sub(r'[-\d.]+', '#', words), k * STEP_S)
    return said


@pytest.mark.parametrize('lag_s', [0.1, 0.5, 1.5])
@pytest.mark.parametrize('noise', [0.0, 0.05])
def test_a_drive_with_lag_is_obedient(lag_s, noise) -> None:
    """Up at the drive's limit, a hold, a trip down, a stop at once; first-order lag."""

    def target(t: float) -> float:
        if t < 20.0:
            return min(8.0, t)
        return max(5.9, 8.0 - (t - 20.0)) if t < 40.0 else 0.0

    state = {'v': 0.0}

    def speed(t: float) -> float:
        rate = (target(t) - state['v']) / lag_s
        state['v'] += STEP_S * max(-1.0, min(1.0, rate))  # its own rate is no higher
        return state['v']

    assert _ride(target, speed, 60.0, ceiling=8.0, noise=noise) == {}


def test_a_roller_at_three_times_its_set_point_is_found() -> None:
    said = _ride(lambda t: min(8.5, 0.5 * t), lambda t: 3.0 * min(8.5, 0.5 * t), 10.0)
    assert len(said) == 1
    assert min(said.values()) < 4.0


def test_a_drive_that_ignores_its_set_points_is_found_at_rest_and_at_speed() -> None:
    for told, runs in ((8.5, 8.0 - 1.0), (0.0, 8.0), (5.9, 8.0), (8.0, 0.0)):
        said = _ride(lambda t, told=told: told, lambda t, runs=runs: runs, 6.0, noise=0.02)
        assert len(said) == 1, (told, runs)
        assert 1.5 < min(said.values()) < 3.5
    # Coasting away from its set point is not following either.
    assert _ride(lambda t: 8.0, lambda t: 8.0 - 0.3 * t, 10.0)


def test_a_roller_that_runs_away_is_found_in_half_the_time() -> None:
    """Its drive takes 8 m/s for 10.4: each second makes the way down longer."""
    said = _ride(lambda t: 8.0, lambda t: min(10.4, max(8.0, 6.0 + t)), 6.0, noise=0.02)
    assert 3.5 < min(said.values()) < 4.0, 'it is 0.5 m/s away at 2.5 s'


def test_the_ceiling_holds_for_what_is_measured() -> None:
    said = _ride(lambda t: math.nan, lambda t: 8.0 if t < 1.0 else 9.0, 3.0, ceiling=8.5)
    assert min(said.values()) < 1.3
    assert _ride(lambda t: 8.5, lambda t: 8.5, 5.0, ceiling=8.5, noise=0.03) == {}


def test_encoder_and_drive_apart_and_another_master_are_found() -> None:
    assert _ride(lambda t: 8.0, lambda t: 8.0, 5.0, turns=0.9)
    assert _ride(lambda t: 8.0, lambda t: 8.0, 5.0, turns=-1.0) == {}  # it counts backwards
    assert _ride(lambda t: 8.0, lambda t: 8.0, 5.0, turns=0.99) == {}
    assert _ride(lambda t: 8.0, lambda t: 8.0, 1.0, foreign=7.5)


def test_readings_may_come_while_they_are_looked_at() -> None:
    readings, seen = RollerReadings(0.3), 0.0

    def come() -> None:
        for k in range(20_000):
            block = DriveBlock(np.array([k]), np.array([0.0]), np.array([8.0]))
            readings.take(0.02 * k, block)

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        thread = threading.Thread(target=come)
        thread.start()
        while thread.is_alive():
            seen = max(seen, readings.lowest_mps())
            readings.slower(8.0, 0.0)
    finally:
        sys.setswitchinterval(interval)
    assert seen == 8.0


def test_a_silent_drive_does_not_count_as_one_that_does_not_follow() -> None:
    readings = RollerReadings(0.0)
    readings.take(0.0, DriveBlock(np.array([1]), np.array([math.nan]), np.array([8.0])))
    assert all(readings.fault(k * 0.1, 3.0, math.inf) == '' for k in range(10, 200))


def _feed(displacement: Displacement, seconds: float, y: Callable[[float], float]) -> list[float]:
    largest = []
    for k in range(round(seconds * 50)):
        at_s = 10.0 + k * 0.02
        block = [(round((at_s + j * 0.002) * 1e9), y(k * 0.02 + j * 0.002)) for j in range(10)]
        displacement.take(at_s, block)
        largest.append(displacement.largest(at_s))
    return largest


@pytest.mark.parametrize('hz', [2.0, 2.84, 4.0, 7.0, 10.0, 16.0])
def test_the_peak_of_any_motion_is_seen_at_once(hz) -> None:
    largest = _feed(Displacement(), 2.0, lambda t: 5e-3 * math.sin(2 * math.pi * hz * t))
    assert largest[26:] == pytest.approx([5e-3] * (len(largest) - 26), rel=0.03)
    assert max(largest) <= 5e-3


def test_a_wheelset_that_stands_aside_is_seen_and_a_spike_is_not() -> None:
    assert _feed(Displacement(), 1.0, lambda t: -8e-3)[-1] == 8e-3
    spikes = _feed(Displacement(), 2.0, lambda t: 20e-3 if round(t * 500) % 250 == 0 else 1e-5)
    assert np.nanmax(spikes) <= 1e-5
    assert _feed(Displacement(), 2.0, lambda t: math.nan if t > 0.1 else 1e-3)[-1] == 1e-3


def test_a_roller_that_stands_is_at_rest() -> None:
    readings = RollerReadings(0.3)
    assert not readings.at_rest(), 'nothing is known'
    came = itertools.count(10)
    for speed, rest in ((0.01, True), (-0.01, True), (-3.0, False), (0.3, False)):
        for k in itertools.islice(came, 3):
            block = DriveBlock(np.array([k]), np.array([math.nan]), np.array([speed]))
            readings.take(float(k), block)
        assert readings.at_rest() is rest


def test_a_sensor_that_is_silent_shows_nothing() -> None:
    displacement = Displacement()
    assert math.isnan(displacement.largest(0.0))
    _feed(displacement, 1.0, lambda t: 1e-3)
    assert math.isnan(displacement.largest(12.0))
    # The clock of the stamps is set back by an hour.
    displacement.take(12.0, [(-3600 * 10**9 + k, 2e-3) for k in range(5)])
    assert displacement.largest(12.0) == 2e-3
