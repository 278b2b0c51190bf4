"""The angle of the roller: an encoder that wraps, one that is silent, and none at all."""

from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.estimation import turning
from hunt_ros.estimation.turning import TurningAngle, Unwrapping
from hunt_ros.samples import Series

TURN = 2.0 * np.pi


def unwrapped(read: np.ndarray) -> np.ndarray:
    """Of samples every 10 ms."""
    return turning.unwrapped(Series(np.arange(read.size) * 10_000_000, read))


@pytest.mark.parametrize('step', [0.03, 0.57, 2.9])
@pytest.mark.parametrize('sense', [1.0, -1.0])
@pytest.mark.parametrize('wraps', ['0 to 2 pi', '-pi to pi', 'after 8 turns', 'not'])
def test_an_encoder_that_wraps_turns_on(step: float, sense: float, wraps: str) -> None:
    true = 0.4 + sense * step * np.arange(2000)
    read = {
        '0 to 2 pi': np.mod(true, TURN),
        '-pi to pi': np.mod(true + np.pi, TURN) - np.pi,
        'after 8 turns': np.mod(true, 8.0 * TURN),
        'not': true,
    }[wraps]
    steps = np.diff(unwrapped(read))
    np.testing.assert_allclose(steps, sense * step, atol=1e-9)


@pytest.mark.parametrize('wrong', [0.9, 2.0, 4.0, 6.0, -3.0])
@pytest.mark.parametrize('step', [0.03, 0.57, 2.9])
@pytest.mark.parametrize('wraps', [False, True])
def test_a_wrong_reading_leaves_nothing_behind(step: float, wrong: float, wraps: bool) -> None:
    true = 0.4 + step * np.arange(300)
    read = np.mod(true, TURN) if wraps else true.copy()
    read[150] += wrong
    np.testing.assert_allclose(np.diff(unwrapped(read))[154:], step, atol=1e-9)


@pytest.mark.parametrize('wraps', [False, True])
@pytest.mark.parametrize('lost', [5, 12, 40, 130])
@pytest.mark.parametrize('begins', [6, 400])
def test_through_a_gap_the_roller_turns_on(wraps: bool, lost: int, begins: int) -> None:
    true = 0.4 + 0.47 * np.arange(800)
    read = np.mod(true, TURN) if wraps else true
    kept = np.r_[0:begins, begins + lost : 800]
    stamps = kept * 10_000_000
    got = turning.unwrapped(Series(stamps, read[kept]))
    np.testing.assert_allclose(got - got[0], true[kept] - true[0], atol=1e-9)


def test_an_angle_that_does_not_wrap_is_believed_after_a_gap_in_which_it_slowed_down() -> None:
    rate = np.where(np.arange(800) < 200, 0.47, 0.4)
    true = np.cumsum(rate)
    kept = np.r_[0:200, 300:800]
    got = turning.unwrapped(Series(kept * 10_000_000, true[kept]))
    np.testing.assert_allclose(got - got[0], true[kept] - true[0], atol=1e-9)


def test_samples_stamped_in_bursts_have_no_gaps() -> None:
    read = np.mod(0.57 * np.arange(500), TURN)
    stamps = np.arange(500) // 10 * 100_000_000 + np.arange(500) % 10
    np.testing.assert_allclose(np.diff(turning.unwrapped(Series(stamps, read)))[12:], 0.57)


def test_missing_readings_are_passed_on_and_blocks_change_nothing() -> None:
    read = np.mod(0.57 * np.arange(300), TURN)
    read[100:110] = np.nan
    stamps = np.arange(300) * 10_000_000
    whole, parts = Unwrapping(), Unwrapping()
    expected = whole.update(stamps, read)[0]
    got = [parts.update(stamps[a : a + 7], read[a : a + 7])[0] for a in range(0, 300, 7)]
    assert np.concatenate(got).tobytes() == expected.tobytes()
    # What comes next is told, and not taken in.
    told = int(stamps[12]), float(read[12])
    first, after = Unwrapping().update(stamps[:12], read[:12], *told)
    np.testing.assert_allclose(after - first[-1], 0.57)


def test_a_speed_takes_the_place_of_a_silent_encoder_at_the_ratio_that_was_seen() -> None:
    stamps = np.arange(4000) * 10_000_000
    time = stamps * 1e-9
    speed = 6.0 + 0.2 * np.sin(0.3 * time)
    way = 6.0 * time + 0.2 / 0.3 * (1.0 - np.cos(0.3 * time))
    true = -2.0 / 0.31 * way  # it runs backwards, and the diameter is 0.31 m, not 0.3 m
    encoder = np.where((time > 20.0) & (time < 25.0), np.nan, true)
    got = TurningAngle(0.3).update(stamps, encoder, speed)
    np.testing.assert_allclose(got, true, atol=0.02)
    assert got[time <= 20.0].tobytes() == true[time <= 20.0].tobytes()


def test_without_an_encoder_the_angle_follows_from_speed_and_diameter() -> None:
    stamps = np.arange(1000) * 10_000_000
    speed = np.full(1000, 6.0)
    silent = np.full(1000, np.nan)
    whole, parts = TurningAngle(0.4), TurningAngle(0.4)
    angle = whole.update(stamps, silent, speed)
    np.testing.assert_allclose(np.diff(angle), 0.01 * 6.0 * 2.0 / 0.4, rtol=1e-9)
    got = [parts.update(stamps[a:b], silent[a:b], speed[a:b]) for a, b in ((0, 3), (3, 1000))]
    assert np.concatenate(got).tobytes() == angle.tobytes()
    assert np.isnan(TurningAngle(0.4).update(stamps, silent, silent)).all()
