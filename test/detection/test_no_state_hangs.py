"""Whatever came before: where nothing is left of the motion, no state of hunting stays."""

from __future__ import annotations

import math

import numpy as np
import pytest
from decided import decided
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.detection.decision.form import FormNumbers, form_numbers
from hunt_ros.detection.regions import State
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM

FORM = form_numbers(IdentifiedNormalForm(PAPER_NORMAL_FORM))
NO_FORM = form_numbers(None)
QUIET, ROWS = 8e-6, 100  # r.m.s. of the quiet motion, m; rows in a second


def noise(seconds: float, rng: np.random.Generator, correlation_s: float = 1.0) -> np.ndarray:
    """Return the amplitude of narrow-band noise, r.m.s. `QUIET`, m."""
    keep = math.exp(-1.0 / (ROWS * correlation_s))
    steps = rng.normal(size=(round(seconds * ROWS), 2)) @ np.array([1.0, 1j])
    z, found = complex(steps[0]), np.empty(steps.size)
    for k in range(steps.size):
        z = keep * z + math.sqrt(1.0 - keep**2) * complex(steps[k])
        found[k] = abs(z)
    return QUIET * found / math.sqrt(2.0)


def judged(amplitude: np.ndarray, speed: float, form: FormNumbers) -> np.ndarray:
    """Return the states of the decisions on an amplitude known to 1 um."""
    return decided(amplitude, form=form, speed=speed)['state'].copy()


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
    before = noise(30.0, rng)
    times = np.cumsum([0.0, *(length for length, _ in stretches)])
    sizes = [float(before[-1]), *(size for _, size in stretches)]
    t = np.arange(0.0, times[-1], 1.0 / ROWS)
    path = np.exp(np.interp(t, times, np.log(sizes)))
    down = np.geomspace(sizes[-1], QUIET, ROWS)
    after = noise(60.0, rng)
    states = judged(np.concatenate([before, path, down, after]), speed, form)
    calm = states[-after.size :]
    assert not (calm[2 * ROWS :] == State.ESCAPING).any()
    assert (calm[45 * ROWS :] <= State.DISTURBED).all()
