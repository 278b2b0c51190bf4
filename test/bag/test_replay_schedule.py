"""Pacing of a live replay: every message once, in time, whatever the caller does."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.bag.replay_schedule import ReplaySchedule
from hunt_ros.errors import ConfigError

SECOND = 1_000_000_000
STAMPS = 10**18 + np.arange(1000) * 10_000_000  # 10 s at 100 Hz


@given(st.lists(st.integers(0, 3 * SECOND), max_size=60), st.sampled_from([0.1, 1.0, 7.5, 50.0]))
@settings(max_examples=60, deadline=None)
def test_every_message_is_due_once_and_in_order_whatever_the_steps(steps, rate) -> None:
    schedule = ReplaySchedule(STAMPS, rate=rate)
    now, seen = 5, []
    schedule.play(now)
    for step in [*steps, 200 * SECOND]:
        now += step
        due = schedule.due(now)
        seen += range(due.start, due.stop)
        reached = schedule.time_ns(now)
        assert all(STAMPS[i] <= reached for i in seen)
        assert len(seen) == 1000 or STAMPS[len(seen)] > reached
    assert seen == list(range(1000))
    assert schedule.finished


@pytest.mark.parametrize('rate', [0.1, 1.0, 50.0])
def test_wait_is_the_time_until_the_next_message(rate: float) -> None:
    schedule = ReplaySchedule(STAMPS, rate=rate)
    now = 123
    schedule.play(now)
    seen = 0
    while not schedule.finished:
        wait = schedule.wait_ns(now)
        assert wait is not None
        if wait:
            assert schedule.due(now + wait - 1).stop <= seen + 1
        now += wait
        due = schedule.due(now)
        seen = max(seen, due.stop)
    assert seen == 1000
    assert now - 123 == pytest.approx(9.99 * SECOND / rate, abs=1000)
    assert schedule.wait_ns(now) is None


def test_pause_stops_time_and_play_goes_on_from_there() -> None:
    schedule = ReplaySchedule(STAMPS)
    schedule.play(0)
    assert schedule.due(SECOND).stop == 101
    schedule.pause(SECOND)
    assert schedule.wait_ns(2 * SECOND) is None
    assert schedule.due(50 * SECOND).start == schedule.due(60 * SECOND).stop == 101
    assert schedule.time_ns(50 * SECOND) == STAMPS[0] + SECOND
    schedule.play(100 * SECOND)
    due = schedule.due(101 * SECOND)
    assert (due.start, due.stop) == (101, 201)


def test_from_and_to_bound_what_is_played() -> None:
    schedule = ReplaySchedule(STAMPS, from_s=2.0, to_s=3.0)
    schedule.play(0)
    assert schedule.time_ns(0) == STAMPS[200]
    due = schedule.due(5 * SECOND)
    assert (due.start, due.stop) == (200, 301)
    assert schedule.finished
    assert schedule.time_ns(5 * SECOND) == STAMPS[300]


def test_loop_plays_the_rest_then_restarts_without_losing_time() -> None:
    schedule = ReplaySchedule(STAMPS, from_s=9.0, loop=True)
    schedule.play(0)
    rest = schedule.due(2 * SECOND)
    assert (rest.start, rest.stop) == (900, 1000)
    again = schedule.due(2 * SECOND)
    assert again.start == 900
    assert not schedule.finished
    now, rounds = 2 * SECOND, 0
    for _ in range(1000):
        now += 10_000_000
        due = schedule.due(now)
        rounds += len(due) > 0 and due.stop == 1000
    # 0.99 s a round
    assert rounds == pytest.approx(10, abs=2)


def test_rate_changes_without_a_jump_in_time() -> None:
    schedule = ReplaySchedule(STAMPS)
    schedule.play(0)
    schedule.set_rate(SECOND, 5.0)
    assert schedule.time_ns(SECOND) == STAMPS[0] + SECOND
    assert schedule.time_ns(2 * SECOND) == STAMPS[0] + 6 * SECOND


@pytest.mark.parametrize(
    ('options', 'words'),
    [
        ({'rate': 0.05}, 'rate'),
        ({'rate': 51.0}, 'rate'),
        ({'rate': float('nan')}, 'rate'),
        ({'from_s': 11.0}, 'no message from 11 s'),
        ({'from_s': 5.0, 'to_s': 4.0}, 'no message from 5 s to 4 s'),
    ],
)
def test_what_cannot_be_played_is_refused_by_name(options, words) -> None:
    with pytest.raises(ConfigError, match=words):
        ReplaySchedule(STAMPS, **options)
    with pytest.raises(ConfigError, match='no message'):
        ReplaySchedule([])
