"""Stamps of one channel: what is believed does not depend on how they arrive in blocks."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made import SECOND

from hunt_ros.detection.stamps import AHEAD, BACKWARD, REPEATED, Channel


def _fed(stamps: list[int], cuts: list[int]) -> Channel:
    channel = Channel(SECOND)
    array = np.array(stamps, dtype=np.int64)
    for begin, end in itertools.pairwise([0, *sorted(cuts), len(stamps)]):
        if end > begin:
            channel.push(array[begin:end], np.arange(begin, end, dtype=np.float64))
    channel.finish()
    return channel


def _content(channel: Channel) -> list[list[tuple[int, float, int]]]:
    found = []
    for queue in channel.queues:
        stamps, values, marks, _ = queue.take(2**62)
        found.append(list(zip(stamps.tolist(), values.tolist(), marks.tolist(), strict=True)))
    return found


#: Steps as they should be, and every kind that should not: repeated, back, ahead, reset.
_STEPS = st.lists(
    st.sampled_from([10, 10, 10, 10, 0, -15, 700, 1500, 5000, -1500, -4000]), max_size=300
)


@settings(deadline=None)
@given(steps=_STEPS, data=st.data())
def test_any_blocks_give_the_same_samples_epochs_and_counts(steps, data) -> None:
    stamps = (20 * SECOND + np.cumsum(steps) * 1_000_000).tolist() if steps else []
    cuts = data.draw(st.lists(st.integers(0, len(stamps)), max_size=20))
    whole, cut = _fed(stamps, []), _fed(stamps, cuts)
    assert whole.refused == cut.refused
    assert _content(whole) == _content(cut)


@settings(deadline=None)
@given(steps=_STEPS)
def test_believed_stamps_increase_and_every_sample_is_believed_or_counted(steps) -> None:
    stamps = (20 * SECOND + np.cumsum(steps) * 1_000_000).tolist() if steps else []
    channel = _fed(stamps, [])
    content = _content(channel)
    for epoch in content:
        assert all(a[0] < b[0] for a, b in itertools.pairwise(epoch))
    assert sum(map(len, content)) + channel.refused.total() == len(stamps)


@pytest.mark.parametrize(('gap_ms', 'behind_ms'), [(1050, 60), (1500, 600), (2000, 1200)])
def test_after_a_gap_one_stamp_that_is_behind_is_refused_alone(gap_ms, behind_ms) -> None:
    """It goes on as if there had been no gap: one stamp is no evidence of that."""
    steps = [10] * 300 + [gap_ms] + [10] * 300
    stamps = (20 * SECOND + np.cumsum(steps) * 1_000_000).tolist()
    late = stamps[500] - behind_ms * 1_000_000
    channel = _fed([*stamps[:501], late, *stamps[501:]], [])
    assert channel.refused.total() == channel.refused['backward'] == 1
    assert [stamp for stamp, _, _ in _content(channel)[0]] == stamps


def test_the_next_sample_tells_what_was_refused() -> None:
    ms = SECOND // 1000
    stamps = [0, ms, ms, 2 * ms, ms, 3 * ms, 9000 * ms, 4 * ms, 5 * ms]
    [epoch] = _content(_fed(stamps, []))
    assert [stamp // ms for stamp, _, _ in epoch] == [0, 1, 2, 3, 4, 5]
    assert [mark for _, _, mark in epoch] == [0, 0, REPEATED, BACKWARD, AHEAD, 0]


def test_a_gap_that_the_next_sample_confirms_is_believed() -> None:
    [epoch] = _content(_fed([0, 10, 8 * SECOND, 8 * SECOND + 10], []))
    assert len(epoch) == 4


def test_a_short_excursion_into_the_past_is_refused_and_a_lasting_one_is_a_new_epoch() -> None:
    step = SECOND // 100
    forward = [20 * SECOND + k * step for k in range(100)]
    short = [10 * SECOND + k * step for k in range(50)]
    lasting = [10 * SECOND + k * step for k in range(150)]
    again = [forward[-1] + k * step for k in range(1, 50)]
    one = _fed([*forward, *short, *again], [])
    assert len(one.queues) == 1
    assert one.refused['backward'] == 50
    two = _fed([*forward, *lasting], [])
    assert [len(queue.stamps) for queue in two.queues] == [100, 150]


def _leap(by_s: int) -> list[int]:
    """Stamps of a clock that leaps by some seconds for two, and comes back."""
    step = SECOND // 100
    stamps = [20 * SECOND + k * step for k in range(600)]
    return [s + by_s * SECOND if 200 <= k < 400 else s for k, s in enumerate(stamps)]


@settings(deadline=None, max_examples=30)
@given(by_s=st.sampled_from([-3600, -5, 3, 3600]), cuts=st.lists(st.integers(0, 600), max_size=6))
def test_a_clock_that_leaps_and_comes_back_goes_on_without_the_leap(by_s, cuts) -> None:
    channel = _fed(_leap(by_s), cuts)
    assert channel.returned_ns() == 24 * SECOND
    channel.rejoin()
    [content] = _content(channel)
    expected = [20 * SECOND + k * SECOND // 100 for k in (*range(200), *range(400, 600))]
    assert [stamp for stamp, _, _ in content] == expected
    assert content[200][2] & (AHEAD if by_s > 0 else BACKWARD)
    assert channel.refused.total() == 200


def test_a_clock_that_is_set_back_or_a_channel_that_was_off_has_not_leapt() -> None:
    step = SECOND // 100
    forward = [20 * SECOND + k * step for k in range(200)]
    back = [5 * SECOND + k * step for k in range(400)]
    assert _fed(forward + back, []).returned_ns() is None
    after_a_pause = [100 * SECOND + k * step for k in range(600)]
    back = [50 * SECOND + k * step for k in range(400)]
    assert _fed(forward + after_a_pause + back, []).returned_ns() is None
