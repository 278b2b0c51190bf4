"""Whatever came before: where nothing is left of the motion, no state of hunting stays."""

from __future__ import annotations

import numpy as np
import pytest
from decided import ROWS, decided, noise
from hypothesis import given, settings
from hypothesis import strategies as st
from made import PAPER

from hunt_ros.detection.decision.form import form_numbers
from hunt_ros.detection.regions import State

FORM = form_numbers(PAPER)
NO_FORM = form_numbers(None)
QUIET = 8e-6  # r.m.s. of the quiet motion, m


@pytest.mark.parametrize('form', [FORM, NO_FORM], ids=['form', 'no form'])
@settings(max_examples=25, deadline=None)
@given(
    speed=st.sampled_from([6.6, 7.2, 7.6]),
    stretches=st.lists(
        st.tuples(st.floats(0.05, 6.0), st.floats(1e-6, 8e-4)), min_size=1, max_size=6
    ),
    seed=st.integers(0, 1000),
)
def test_what_is_over_is_not_escaping_and_becomes_quiet(form, speed, stretches, seed) -> None:
    rng = np.random.default_rng(seed)
    before = np.abs(noise(30.0, 1.0, QUIET, rng))
    times = np.cumsum([0.0, *(length for length, _ in stretches)])
    sizes = [float(before[-1]), *(size for _, size in stretches)]
    t = np.arange(0.0, times[-1], 1.0 / ROWS)
    path = np.exp(np.interp(t, times, np.log(sizes)))
    down = np.geomspace(sizes[-1], QUIET, ROWS)
    after = np.abs(noise(60.0, 1.0, QUIET, rng))
    amplitude = np.concatenate([before, path, down, after])
    states = decided(amplitude, form=form, speed=speed)['state']
    calm = states[-after.size :]
    assert not (calm[2 * ROWS :] == State.ESCAPING).any()
    assert (calm[45 * ROWS :] <= State.DISTURBED).all()
