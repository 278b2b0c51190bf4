"""Stamps of one channel: what is believed does not depend on how they arrive in blocks."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.detection.door import AHEAD, BACKWARD, REPEATED, Channel

SECOND = 1_000_000_000


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
    assert [len(queue) for queue in two.queues] == [100, 150]
