"""Times that go on where a clock was set back."""

from __future__ import annotations

import numpy as np

from hunt_ros.bag.clocks import going_on

STEP = 10_000_000


def test_channels_stay_beside_each_other_where_their_clock_was_set_back() -> None:
    whole = 10**18 + np.arange(4000) * STEP // 2
    fast = whole.copy()
    fast[1001:] -= 3600 * 10**9
    fast[3000:] -= 2 * 10**9
    np.testing.assert_array_equal(going_on(fast), whole)
    np.testing.assert_array_equal(going_on(fast[::2]), whole[::2])


def test_what_a_writer_shuffles_is_no_clock_that_was_set() -> None:
    stamps = 10**18 + np.random.default_rng(1).permutation(500) * STEP
    np.testing.assert_array_equal(going_on(stamps), stamps)
