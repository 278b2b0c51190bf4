from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made import LAW

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.identification.posterior import Posterior


@pytest.fixture(scope='module')
def posterior():
    """Of the paper's form, v_n known to 0.03 m/s and v_c to 0.05 m/s."""
    rng = np.random.default_rng(1)
    p = np.tile(LAW.p, (400, 1))
    p[:, 0] += 0.02 * rng.standard_normal(400)
    p[:, 5] *= 1.0 + 0.01 * rng.standard_normal(400)
    return Posterior(LAW, p, np.full(400, np.nan), (6.2, 8.8))


@pytest.fixture(scope='module')
def branches(posterior):
    return posterior.branch_points()


def test_a_jump_known_to_half_a_step_leaves_the_disturbance_as_open(posterior):
    fine, coarse = (
        posterior.disturbance(ObservedCriticalSpeeds(7.4, v_c_between=(7.4 - half, 7.4 + half)))
        for half in (0.001, 0.2)
    )
    assert coarse.value == fine.value
    ends = PAPER_NORMAL_FORM.unstable_amplitude([7.21, 7.59])
    assert coarse.low < ends[1]
    assert coarse.high > ends[0]
    assert fine.high - fine.low < 0.5 * (coarse.high - coarse.low)


def test_a_critical_speed_that_its_draws_do_not_bound_from_above_is_not_given(posterior):
    """In one of 25 draws rest is always stable: more than lie above an interval of 95 %."""
    for without, given in ((8, True), (16, False)):
        p = posterior.p.copy()
        p[:without, :3] = -5.0, 0.0, 0.0
        some = replace(posterior, p=p)
        assert (some.number('v_c') is not None) is given
        assert some.number('v_n') is not None


def test_the_bands_hold_the_branches_and_widen_towards_the_fold(branches):
    known = [
        point for point in branches if point.unstable is not None and point.stable is not None
    ]
    assert len(known) > 15
    for point in known:
        for one in (point.stable, point.unstable):
            assert one.low <= one.value <= one.high
    widths = [point.unstable.high - point.unstable.low for point in known[:8]]
    assert widths[0] > 1.2 * widths[-1]


def test_the_edges_of_the_bands_are_smooth_up_to_the_fold(branches):
    known = [
        point for point in branches if point.unstable is not None and point.stable is not None
    ]
    speed = np.array([point.speed for point in known])
    for edge in ('low', 'high'):
        for branch in ('stable', 'unstable'):
            line = np.array([getattr(getattr(point, branch), edge) for point in known])
            # Amplitudes rise or fall all along an edge, but for a plateau at the fold itself.
            slopes = np.diff(line) / np.diff(speed)
            slopes = slopes[speed[:-1] > speed[0] + 0.1]
            assert (slopes > -2e-6).all() or (slopes < 2e-6).all()


def test_draws_that_have_lost_the_branch_beyond_v_c_pull_its_lower_edge_to_zero(branches):
    last = [point for point in branches if point.unstable is not None][-1]
    assert last.speed < 8.0
    assert last.unstable.low == pytest.approx(0.0, abs=0.5 * last.unstable.value)


@pytest.mark.parametrize('count', [0, 3])
def test_of_hardly_a_draw_nothing_is_said(count):
    drawn = Posterior(LAW, np.tile(LAW.p, (count, 1)), np.full(count, np.nan), (6.2, 8.8))
    assert set(drawn.numbers(0.0).values()) == {None}
