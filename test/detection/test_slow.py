"""Rows on the grid, and the slow channels at any stamp."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.detection.door import Door
from hunt_ros.detection.slow import SlowChannel

MS = 1_000_000


def _rows(stamps: np.ndarray, cuts: list[int]) -> list[int]:
    """Return the rows, ms, of one channel with a timeout of 80 ms that comes in pieces."""
    door, found = Door({'speed': 80 * MS}, 10 * MS), []
    for part in [*np.split(stamps, sorted(cuts)), None]:
        if part is None:
            door.finish()
        else:
            door.push('speed', part, np.zeros(part.size))
        found += [row // MS for stretch in door.complete() for row in stretch[0].tolist()]
    return found


def test_rows_stop_in_a_long_silence_and_go_on_after_it() -> None:
    samples = np.array([5, 15, 25, 1005, 1015], dtype=np.int64) * MS
    assert _rows(samples, []) == [*range(10, 130, 10), 1010]
    later = np.append(samples, samples[-1] + 50 * 365 * 86400 * 1000 * MS)
    assert _rows(later, [])[:14] == [*range(10, 130, 10), 1010, 1020]


@settings(deadline=None)
@given(
    gaps=st.lists(st.sampled_from([3, 7, 40, 90, 350]), min_size=2, max_size=60), data=st.data()
)
def test_rows_do_not_depend_on_where_the_stream_is_cut(gaps, data) -> None:
    samples = np.cumsum(gaps).astype(np.int64) * MS
    cuts = data.draw(st.lists(st.integers(0, len(gaps)), max_size=8))
    assert _rows(samples, cuts) == _rows(samples, [])


def test_between_samples_lies_a_straight_line_and_beyond_them_the_last_rate() -> None:
    stamps = np.array([0, 10, 20], dtype=np.int64) * MS
    angle = SlowChannel(50 * MS, rising=True)
    wanted = np.array([5, 15, 30, 69, 71], dtype=np.int64) * MS
    found = angle.at(wanted, stamps, np.array([0.0, 1.0, 3.0]), None)
    assert found[:4] == pytest.approx([0.5, 2.0, 5.0, 12.8])
    assert np.isnan(found[4])
    speed = SlowChannel(50 * MS, rising=False)
    assert speed.at(wanted[2:3], stamps, np.array([0.0, 1.0, 3.0]), None) == pytest.approx([3.0])


def test_an_angle_that_repeats_goes_on_at_its_rate_until_the_timeout() -> None:
    stamps = np.arange(0, 12, dtype=np.int64) * 10 * MS
    values = np.array([0.0, 1.0, 2.0, 3.0, *[3.0] * 8])
    angle = SlowChannel(50 * MS, rising=True)
    found = angle.at(np.array([45, 75, 85], dtype=np.int64) * MS, stamps, values, None)
    assert found[:2] == pytest.approx([4.5, 7.5])
    assert np.isnan(found[2])
