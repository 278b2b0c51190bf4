from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hunt_ros.analysis.steady_state import SteadyState
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.identification.four_point import at_detunings, four_point


def radii(eps):
    return PAPER_NORMAL_FORM.stable_amplitude(8.0 * (1.0 + eps)) / 0.097


def test_four_exact_points_give_equation_33_back():
    eps = np.array([-0.19, -0.1, 0.0, 0.1])
    found = four_point(eps, radii(eps), 0.12)
    for name in ('D4', 'D7', 'D10', 'D15'):
        assert getattr(found, name) == pytest.approx(getattr(PAPER_NORMAL_FORM, name), rel=1e-6)
    assert found.missed == 0
    assert found.condition_number > 100.0


def test_half_a_percent_of_error_is_blown_up_as_the_condition_number_says():
    eps = np.array([-0.19, -0.1, 0.0, 0.1])
    rng = np.random.default_rng(0)
    spread = []
    for _ in range(50):
        noisy = radii(eps) * (1.0 + 0.005 * rng.standard_normal(4))
        spread.append(four_point(eps, noisy, 0.12).D4)
    assert np.std(spread) > PAPER_NORMAL_FORM.D4


def test_a_point_without_a_real_state_is_said():
    # The paper's own first point: with the coefficients (33) eps = -0.2 has no steady state.
    eps = np.array([-0.2, -0.1, 0.0, 0.1])
    r = np.array([4.4e-3, *radii(eps[1:])])
    found = four_point(eps, r, 0.12)
    assert found.missed >= 1


def state(speed, start=0):
    return SteadyState(speed, 6e-4, 1e-6, 'up', 50, start_ns=start + 5, end_ns=start + 9)


def test_a_hold_that_contains_a_jump_is_not_one_of_the_four():
    speeds = [6.5, 7.2, 8.0, 8.02, 8.8]
    states = [state(speed, start=20 * k) for k, speed in enumerate(speeds)]
    chosen = at_detunings(states, [], 8.0)
    assert [one.speed for one in chosen] == [6.5, 7.2, 8.0, 8.8]
    jump = ('', 41, 44)  # before the amplitude had settled, in the same hold
    chosen = at_detunings(states, [jump], 8.0)
    assert [one.speed for one in chosen] == [6.5, 7.2, 8.02, 8.8]


def test_amplitudes_along_a_ramp_have_not_settled():
    ramp = [replace(state(speed, start=20), kind='ramp') for speed in (6.5, 7.2, 8.0, 8.8)]
    assert 'no settled limit cycle' in at_detunings(ramp, [], 8.0)


def test_limit_cycles_far_from_the_four_detunings_do_not_stand_in_for_them():
    states = [state(speed, start=20 * k) for k, speed in enumerate([7.4, 7.6, 8.0, 8.8, 9.2])]
    assert 'near eps = -0.2' in at_detunings(states, [], 8.0)
