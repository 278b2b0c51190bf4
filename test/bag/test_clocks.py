"""Times that go on where a clock was set back."""

from __future__ import annotations

import numpy as np

from hunt_ros.bag.clocks import going_on

STEP = 10_000_000


def test_channels_stay_beside_each_other_where_their_clock_was_set_back() -> None:
    """Each of another rate; one ends before the first setting."""
    fast = 10**18 + np.arange(4000) * STEP // 2
    fast[1001:] -= 3600 * 10**9
    fast[3000:] -= 2 * 10**9
    slow = fast[::2].copy()
    times = going_on({'fast': fast, 'slow': slow, 'first': fast[:700]})
    assert (np.diff(times['fast']) >= 0).all()
    np.testing.assert_array_equal(times['slow'], times['fast'][::2])
    np.testing.assert_array_equal(times['first'], fast[:700])
    assert times['fast'][-1] - times['fast'][0] <= 3999 * STEP // 2


def test_what_a_writer_shuffles_is_no_clock_that_was_set() -> None:
    stamps = 10**18 + np.random.default_rng(1).permutation(500) * STEP
    np.testing.assert_array_equal(going_on({'a': stamps})['a'], stamps)
