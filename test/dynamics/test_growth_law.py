from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made import LAW, SCALES, from_normal_form

from hunt_ros.dynamics.growth_law import FELT, QUINTIC, GrowthLaw, lawful, reading
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import COEFFICIENTS, PAPER_NORMAL_FORM, NormalForm
from hunt_ros.dynamics.paper_form import normal_form_of, to_normal_form

PAPER = LAW.p


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
    rate = GrowthLaw(lawful(law), SCALES).growth_rate(speeds, amplitudes)
    assert rate == pytest.approx(form.growth_rate(speeds, amplitudes), rel=1e-9, abs=1e-9)


@given(st.integers(0, 10**6), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))
@settings(max_examples=60, deadline=None)
def test_a_law_read_with_another_gain_and_scale_is_the_same_law(seed, gain, scale):
    p = np.random.default_rng(seed).standard_normal(PAPER.size)
    speed, amplitude, line = np.array([6.0, 7.3, 9.0]), np.array([1e-4, 4e-4, 8e-4]), 1e-8
    read = GrowthLaw(reading(gain, scale) @ p, SCALES)
    measured = speed * np.exp(-scale), amplitude * np.exp(gain), line * np.exp(2.0 * gain)
    expected = GrowthLaw(p, SCALES).growth_rate(speed, amplitude, line)
    assert read.growth_rate(*measured) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_many_laws_at_once_give_what_each_gives_alone():
    p = PAPER * (1.0 + 0.1 * np.random.default_rng(2).standard_normal((40, PAPER.size)))
    many, speeds = GrowthLaw(p, SCALES), np.linspace(6.2, 8.6, 9)
    branches, folds = many.steady_amplitudes(speeds), many.folds(5.0)
    for k, row in enumerate(p):
        one = GrowthLaw(row, SCALES)
        speeds_of_one = [one.critical_speed or np.nan, one.saddle_node(5.0) or np.nan]
        assert speeds_of_one == pytest.approx([many.critical_speeds[k], folds[0, k]], nan_ok=True)
        for alone, together in zip(one.steady_amplitudes(speeds), branches, strict=True):
            np.testing.assert_allclose(alone, together[k], rtol=1e-9)


def test_a_law_without_a_critical_speed_has_a_fold():
    """Rest is damped alike at every speed, and the limit cycle ends below 7 m/s."""
    p = lawful([-0.3, 0.0, 0.0, 2.0, 4.0, -2.3])
    law = GrowthLaw(p, SCALES)
    assert law.critical_speed is None
    assert np.isnan(law.folds(5.0)[0, 0])
    fold = law.folds(5.0, 8.8)[0, 0]
    assert np.isfinite(law.steady_amplitudes(fold + 1e-3)).all()
    assert np.isnan(law.steady_amplitudes(fold - 1e-3)).all()


@pytest.mark.parametrize('D4', [10.0, 100.0, 1000.0])
def test_the_fold_of_a_narrow_hysteresis_is_found(D4):
    form = NormalForm(8.0, 0.12, D4, 0.0, 0.0, -2e7)
    law = GrowthLaw(lawful(from_normal_form(form, SCALES)), SCALES)
    width = 8.0 * D4**2 / (4.0 * 0.12 * 2e7)
    assert law.critical_speed - law.saddle_node(5.0) == pytest.approx(width, rel=1e-3)


def test_the_fold_is_that_of_the_normal_form():
    law = GrowthLaw(PAPER, SCALES)
    assert law.saddle_node(5.0) == pytest.approx(PAPER_NORMAL_FORM.saddle_node()[0], rel=1e-6)
    assert law.critical_speed == pytest.approx(8.0)
    assert (law.criticality, law.name) == ('subcritical', QUINTIC)


def further(*terms: float) -> GrowthLaw:
    """Law of the paper with u x^2, u^2 x and saturation beside it."""
    p = PAPER.copy()
    p[6 : 6 + len(terms)] = terms
    return GrowthLaw(p, SCALES)


@given(*(st.floats(-1.0, 1.0) for _ in range(2)), st.floats(0.0, 1.0))
@settings(max_examples=60, deadline=None)
def test_the_branches_are_all_changes_of_sign_within_reach(a, b, c):
    law = further(a, b, c)
    speed = 7.3
    amplitude = SCALES.amplitude * np.sqrt(np.linspace(1e-4, 8.9, 20_000))
    rate = law.growth_rate(speed, amplitude)
    up = np.flatnonzero((rate[:-1] < 0.0) & (rate[1:] > 0.0))
    down = np.flatnonzero((rate[:-1] > 0.0) & (rate[1:] < 0.0))
    unstable, stable = (branch[0] for branch in law.steady_amplitudes(speed))
    if rate[0] < 0.0 and up.size and (down > up[0]).any():
        top = down[down > up[0]][0]
        assert amplitude[up[0]] * 0.999 <= unstable <= amplitude[up[0] + 1] * 1.001
        assert amplitude[top] * 0.999 <= stable <= amplitude[top + 1] * 1.001
    elif rate[0] < 0.0 and not down.size:
        assert np.isnan(stable)


@pytest.mark.parametrize('fifth', [-0.5, 0.0, 0.2])
def test_a_soft_law_keeps_its_limit_cycle_whatever_bounds_it_far_above(fifth):
    # With a destabilising quintic term the unstable root lies above the limit cycle.
    law = GrowthLaw(lawful([-0.07, 3.5, 0.0, -0.36, -3.0, fifth]), SCALES)
    speeds = law.critical_speed * np.linspace(1.01, 1.1, 6)
    unstable, stable = law.steady_amplitudes(speeds)
    assert np.isnan(unstable).all()
    assert (np.diff(stable) > 0.0).all()
    assert law.growth_rate(speeds, stable) == pytest.approx(0.0, abs=1e-9)
    assert (law.growth_rate(speeds, 1.01 * stable) < 0.0).all()
    assert np.isnan(law.steady_amplitudes(0.98 * law.critical_speed)[1]).all()


def test_a_critical_speed_far_beyond_the_data_is_none():
    nearly_flat = [-0.1, 1e-12, 1e-14, -0.36, -3.0, 0.0]
    assert GrowthLaw(lawful(nearly_flat), SCALES).critical_speed is None
    there = [-0.1, 0.1, 1e-14, -0.36, -3.0, 0.0]
    assert GrowthLaw(lawful(there), SCALES).critical_speed == pytest.approx(2.0 * SCALES.speed)


@pytest.mark.parametrize('terms', [(-0.5,), (0.0, 0.0, 0.1), (0.3, 1.0, 0.05)])
def test_the_nearest_form_keeps_both_branches_of_another_law(terms):
    law = further(*terms)
    form = normal_form_of(law, 6.6, 8.8)
    assert form is not None
    assert form.critical_speed == pytest.approx(law.critical_speed)
    speeds = np.linspace(6.9, 7.6, 6)
    for ours, theirs in zip(
        law.steady_amplitudes(speeds), form.steady_amplitudes(speeds), strict=True
    ):
        np.testing.assert_allclose(theirs, ours, rtol=0.03)


def test_what_one_branch_leaves_open_is_not_drawn_far_away():
    """A soft rig shows a stable branch only: it tells no four coefficients apart."""
    rng = np.random.default_rng(1)
    soft = np.array([-0.16, 2.15, 0.06, -0.2, 0.29, -0.025, 0.0, 0.0, 0.0, 1.0])
    rows = np.tile(soft, (200, 1))
    rows[:, 6:9] += 0.03 * rng.standard_normal((200, 3))
    rows[:, 8] = np.abs(rows[:, 8])
    forms = [normal_form_of(GrowthLaw(row, SCALES), 6.7, 8.7) for row in rows]
    vectors = np.array([IdentifiedNormalForm(form).vector for form in forms])
    exact = to_normal_form(soft[:6], SCALES)
    drawn = IdentifiedNormalForm(exact, np.cov(vectors.T)).draws(200)
    # What is drawn from their covariance has the branch that all of them have.
    stable = np.array([float(form.stable_amplitude(8.5)) for form in drawn])
    assert np.mean(np.abs(stable / float(exact.stable_amplitude(8.5)) - 1.0) < 0.3) > 0.93


def test_the_form_comes_out_of_a_law_whose_further_terms_vanish():
    nearly = normal_form_of(further(1e-7, 1e-7, 1e-7), 6.0, 8.8)
    for name in ('critical_speed', *COEFFICIENTS):
        expected = pytest.approx(getattr(PAPER_NORMAL_FORM, name), rel=1e-4, abs=1e-3)
        assert getattr(nearly, name) == expected


def test_no_critical_speed_where_the_growth_never_rises_through_zero():
    assert to_normal_form(np.array([-1.0, 0.0, -1.0, 1.0, 0.0, -1.0]), SCALES) is None


@pytest.mark.parametrize('terms', [(), (0.2,), (0.2, 0.5, 0.1)])
@pytest.mark.parametrize('felt', [1.0, 0.5])
def test_steady_amplitudes_beside_a_line_neither_grow_nor_fade(terms, felt):
    law = further(*terms)
    law.p[FELT] = felt
    speed, line = np.array([6.8, 7.2, 7.6]), np.array([0.0, 1e-9, 3e-9])
    unstable, stable = law.steady_amplitudes(speed, line)
    for branch in (unstable, stable):
        assert np.isfinite(branch).all()
        assert np.abs(law.growth_rate(speed, branch, line)).max() < 1e-9
    # Roughness lowers the threshold, by about B^2 / A_u.
    alone, _ = law.steady_amplitudes(speed)
    assert (unstable[1:] < alone[1:]).all()


def test_a_line_acts_through_the_mean_of_its_powers():
    # One harmonic of (A cos a + B cos b)^n over A, averaged over the angles, n = 3, 5.
    law = further(0.5, 2.0)
    amplitude, line, speed = 5e-4, 2e-4, 7.3
    a, b = np.meshgrid(*2 * [np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)])
    y = (amplitude * np.cos(a) + line * np.cos(b)) / SCALES.amplitude
    size = amplitude / SCALES.amplitude

    def power(n: int) -> float:
        alone = np.mean(np.cos(a) ** (n + 1))
        return float(np.mean(y**n * np.cos(a)) / size / alone)

    u = float(law.detuning(speed))
    p = law.p
    expected = float(law.linear(u)) + (p[3] + p[4] * u + p[7] * u**2) * power(3)
    expected += (p[5] + p[6] * u) * power(5)
    assert float(law.growth_rate(speed, amplitude, line**2)) == pytest.approx(expected, rel=1e-9)


def test_the_stable_branch_is_continuous_across_the_critical_speed():
    """At v_c the growth from rest is rounding: a law is asked there, and next to it."""
    rng = np.random.default_rng(0)
    compared = 0
    for _ in range(1000):
        p = PAPER * (1.0 + 0.2 * rng.standard_normal(PAPER.size))
        p[6:9] = np.array([2.0, 2.0, 0.3]) * [*rng.standard_normal(2), rng.random()]
        law = GrowthLaw(p, SCALES)
        v_c = law.critical_speed
        if v_c is None or law.criticality != 'subcritical':
            continue
        below, at, above = law.steady_amplitudes(v_c * np.array([1 - 1e-7, 1.0, 1 + 1e-7]))[1]
        assert at == pytest.approx(above, rel=1e-4, nan_ok=True)
        assert at == pytest.approx(below, rel=1e-4, nan_ok=True)
        compared += np.isfinite(at)
    assert compared > 300
