"""A speed profile runs, holds, resumes, and refuses what is no profile."""

from __future__ import annotations

import pytest

from hunt_ros.drivers.profile import ProfileRunner
from hunt_ros.errors import ConfigError

S = 1_000_000_000


def test_the_set_point_follows_the_corners_and_stays_at_the_last() -> None:
    profile = ProfileRunner([0.0, 10.0, 20.0], [6.0, 8.0, 7.0])
    profile.start(5 * S)
    assert profile.set_point(5 * S) == 6.0
    assert profile.set_point(10 * S) == 7.0
    assert profile.set_point(99 * S) == 7.0
    assert not profile.finished(24 * S)
    assert profile.finished(25 * S)


def test_a_stopped_profile_holds_and_goes_on_where_it_was() -> None:
    profile = ProfileRunner([0.0, 10.0], [0.0, 10.0])
    profile.start(0)
    profile.stop(4 * S)
    assert profile.set_point(400 * S) == 4.0
    profile.resume(500 * S)
    assert profile.set_point(501 * S) == 5.0


@pytest.mark.parametrize(
    ('times', 'speeds', 'message'),
    [
        ([], [], 'at least one'),
        ([0.0, 1.0], [6.0], '2 times and 1 speeds'),
        ([1.0, 0.5], [6.0, 7.0], 'must not decrease'),
        ([0.0, float('nan')], [6.0, 7.0], 'must not decrease'),
        ([0.0, 1.0], [6.0, -7.0], 'negative'),
    ],
)
def test_what_is_no_profile_is_refused(times, speeds, message) -> None:
    with pytest.raises(ConfigError, match=message):
        ProfileRunner(times, speeds)
