from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.dynamics.normal_form import COEFFICIENTS, PAPER_NORMAL_FORM, NormalForm
from hunt_ros.identification.growth_law import (
    CONICITY,
    EXTENDED,
    QUINTIC,
    GrowthLaw,
    GrowthScales,
)
from hunt_ros.identification.normal_form_map import (
    from_normal_form,
    normal_form_of,
    to_normal_form,
)

SCALES = GrowthScales(7.4, 7e-4, 0.0485, 1.0 / 25.91, 2.84)


@given(
    st.floats(5.0, 12.0),
    st.floats(0.05, 0.4),
    st.floats(-3000.0, 3000.0),
    st.floats(-0.3, 0.05),
    st.floats(-2000.0, 2000.0),
    st.floats(-8e7, -1e6),
)
@settings(max_examples=60, deadline=None)
def test_normal_form_and_law_are_inverses(v_c, d1, d4, d7, d10, d15):
    form = NormalForm(v_c, d1, d4, d7, d10, d15, frequency_hz=2.84)
    law = from_normal_form(form, SCALES)
    slope_at_zero = law[1] + 2 * law[2] * (v_c / SCALES.speed - 1)
    back = to_normal_form(law, SCALES)
    if slope_at_zero > 1e-3:
        assert back is not None
        for name in ('critical_speed', *COEFFICIENTS):
            assert getattr(back, name) == pytest.approx(getattr(form, name), rel=1e-6, abs=1e-6)
    speeds, amplitudes = np.array([6.0, 7.0, 9.0]), np.array([1e-4, 4e-4, 8e-4])
    rate = GrowthLaw(QUINTIC, law, SCALES).growth_rate(speeds, amplitudes)
    assert rate == pytest.approx(form.growth_rate(speeds, amplitudes), rel=1e-9, abs=1e-9)


def test_branches_and_fold_are_those_of_the_normal_form():
    law = GrowthLaw(QUINTIC, from_normal_form(PAPER_NORMAL_FORM, SCALES), SCALES)
    speeds = np.linspace(6.0, 8.8, 15)
    unstable, stable = law.steady_amplitudes(speeds)
    expected = PAPER_NORMAL_FORM.steady_amplitudes(speeds)
    np.testing.assert_allclose(unstable, expected[0], rtol=1e-9)
    np.testing.assert_allclose(stable, expected[1], rtol=1e-9)
    assert law.saddle_node(5.0) == pytest.approx(6.4059, abs=1e-4)
    assert law.critical_speed == pytest.approx(8.0)
    assert law.criticality == 'subcritical'


@pytest.mark.parametrize(
    ('name', 'extra'), [(EXTENDED, [-2.0]), (CONICITY, [0.6])], ids=['extended', 'conicity']
)
def test_growth_vanishes_on_the_branches_and_changes_sign_as_named(name, extra):
    p = np.concatenate([from_normal_form(PAPER_NORMAL_FORM, SCALES), extra])
    if name == CONICITY:
        p[5] = -1.1
    law = GrowthLaw(name, p, SCALES)
    speeds = np.linspace(6.9, 7.7, 5)
    unstable, stable = law.steady_amplitudes(speeds)
    for branch, sign in ((unstable, 1.0), (stable, -1.0)):
        assert np.isfinite(branch).all()
        assert law.growth_rate(speeds, branch) == pytest.approx(0.0, abs=1e-9)
        assert (sign * law.growth_rate(speeds, 1.001 * branch) > 0.0).all()


@pytest.mark.parametrize('fifth', [-0.5, 0.0, 0.2])
def test_a_soft_law_keeps_its_limit_cycle_whatever_bounds_it_far_above(fifth):
    # With a destabilising quintic term the unstable root lies above the limit cycle.
    law = GrowthLaw(QUINTIC, np.array([-0.07, 3.5, 0.0, -0.36, -3.0, fifth]), SCALES)
    speeds = law.critical_speed * np.linspace(1.01, 1.1, 6)
    unstable, stable = law.steady_amplitudes(speeds)
    assert np.isnan(unstable).all()
    assert (np.diff(stable) > 0.0).all()
    assert law.growth_rate(speeds, stable) == pytest.approx(0.0, abs=1e-9)
    assert (law.growth_rate(speeds, 1.01 * stable) < 0.0).all()
    assert np.isnan(law.steady_amplitudes(0.98 * law.critical_speed)[1]).all()


def test_the_nearest_quintic_keeps_both_branches_of_another_law():
    p = np.concatenate([from_normal_form(PAPER_NORMAL_FORM, SCALES), [-1.0]])
    law = GrowthLaw(EXTENDED, p, SCALES)
    form = normal_form_of(law, 6.6, 8.8)
    assert form is not None
    assert form.critical_speed == pytest.approx(law.critical_speed)
    speeds = np.linspace(6.9, 7.6, 6)
    for ours, theirs in zip(
        law.steady_amplitudes(speeds), form.steady_amplitudes(speeds), strict=True
    ):
        np.testing.assert_allclose(theirs, ours, rtol=0.03)


def test_no_critical_speed_where_the_growth_never_rises_through_zero():
    law = GrowthLaw(QUINTIC, np.array([-1.0, -1.0, 0.0, 1.0, 0.0, -1.0]), SCALES)
    assert law.critical_speed is None or law.critical_speed < 0.0 or law.p[1] > 0.0
    assert to_normal_form(np.array([-1.0, 0.0, -1.0, 1.0, 0.0, -1.0]), SCALES) is None


@pytest.mark.parametrize('name', [QUINTIC, EXTENDED, CONICITY])
def test_steady_amplitudes_beside_a_line_neither_grow_nor_fade(name):
    quintic = from_normal_form(PAPER_NORMAL_FORM, SCALES)
    bent = {
        QUINTIC: quintic,
        EXTENDED: [*quintic, 0.2],
        CONICITY: [*quintic[:5], -0.1, quintic[5]],
    }
    law = GrowthLaw(name, np.array(bent[name]), SCALES)
    speed, line = np.array([6.8, 7.2, 7.6]), np.array([0.0, 1e-9, 3e-9])
    unstable, stable = law.steady_amplitudes(speed, line)
    for branch in (unstable, stable):
        assert np.isfinite(branch).all()
        assert np.abs(law.growth_rate(speed, branch, line)).max() < 1e-9
    # Roughness lowers the threshold, by about B^2 / A_u.
    alone, _ = law.steady_amplitudes(speed)
    assert (unstable[1:] < alone[1:]).all()


def test_a_law_that_runs_away_beyond_its_branches_has_the_form_of_its_branches():
    # Of a staircase: below the fold a conicity that turns round has further, idle zeros.
    p = np.array([-0.2506, 2.9797, -1.3492, 3.1789, 4.0077, -1.0561, 0.6918])
    law = GrowthLaw(CONICITY, p, replace(SCALES, amplitude=6.9756e-4, speed=7.399))
    speeds = np.linspace(6.0, 8.8, 57)
    unstable, stable = law.steady_amplitudes(speeds)
    assert np.isnan(unstable[np.isnan(stable)]).all()
    form = normal_form_of(law, 6.0, 8.8)
    assert form.criticality == 'subcritical'
    assert form.nonlinear_critical_speed == pytest.approx(law.saddle_node(6.0), abs=0.03)
    inner = (speeds > 6.6) & (speeds < 7.8)
    np.testing.assert_allclose(form.unstable_amplitude(speeds[inner]), unstable[inner], rtol=0.05)
