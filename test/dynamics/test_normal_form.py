"""The normal form as an object: the paper's numbers, closed forms, and the amplitude equation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from made import python

from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM, NormalForm
from hunt_ros.errors import ConfigError

forms = st.builds(
    NormalForm,
    critical_speed=st.floats(2.0, 30.0),
    D1=st.floats(0.02, 0.5),
    D4=st.floats(-5e3, 5e3).filter(lambda x: abs(x) > 50),
    D7=st.floats(-0.3, 0.1),
    D10=st.floats(-2e3, 2e3),
    D15=st.floats(-1e8, -1e6),
)


@pytest.mark.parametrize(
    ('speed', 'unstable_mm', 'stable_mm', 'rate', 'digits'),
    [
        (6.6, 0.390, 0.563, -0.59, 3),
        (7.2, 0.2591, 0.6291, -0.33, 4),
        (7.6, 0.174, 0.655, -0.16, 3),
        (8.0, 0.0, 0.6744, 0.0, 4),
        (8.8, None, 0.7037, 0.30, 4),
    ],
)
def test_the_published_coefficients_give_the_known_table(
    speed: float, unstable_mm: float | None, stable_mm: float, rate: float, digits: int
) -> None:
    unstable, stable = (1e3 * float(x) for x in PAPER_NORMAL_FORM.steady_amplitudes(speed))
    assert round(stable, digits) == stable_mm
    if unstable_mm:
        assert round(unstable, digits) == unstable_mm
    else:
        assert math.isnan(unstable)  # at v_c it has just become the quiet state itself
    assert round(float(PAPER_NORMAL_FORM.growth_rate(speed)), 2) == rate


def test_the_fold_of_the_published_coefficients() -> None:
    fold = PAPER_NORMAL_FORM.saddle_node()
    assert fold is not None
    assert round(fold[0], 4) == 6.4059
    assert round(1e3 * fold[1], 4) == 0.4852
    assert round(float(PAPER_NORMAL_FORM.detuning(fold[0])), 5) == -0.19926
    width = PAPER_NORMAL_FORM.hysteresis_width
    assert width == pytest.approx(8.0 - fold[0])
    assert PAPER_NORMAL_FORM.criticality == 'subcritical'


def test_the_papers_first_point_is_no_steady_state_of_its_own_coefficients() -> None:
    """At eps = -0.2 the discriminant of Eq. (28) is -1.7e4: no real amplitude."""
    form = PAPER_NORMAL_FORM
    eps = -0.2
    b, c = form.D4 + form.D10 * eps, form.D1 * eps + form.D7 * eps**2
    assert b * b - 4 * form.D15 * c == pytest.approx(-1.7e4, rel=0.02)
    assert np.isnan(form.steady_amplitudes(6.4)).all()


@given(form=forms, share=st.floats(0.6, 1.3))
@settings(max_examples=200, deadline=None)
def test_steady_amplitudes_are_steady_and_their_stability_is_that_of_the_flow(
    form: NormalForm, share: float
) -> None:
    speed = share * form.critical_speed
    for amplitude, stable in zip(form.steady_amplitudes(speed), (False, True), strict=True):
        if math.isnan(amplitude):
            continue
        r2 = (float(amplitude) / (2.0 * form.length_scale)) ** 2
        scale = abs(form.D15) * r2**2 / form.time_scale
        rate = float(form.growth_rate(speed, amplitude))
        assert abs(rate) < 1e-9 * max(scale, abs(float(form.growth_rate(speed)))) + 1e-12
        outside = float(form.growth_rate(speed, amplitude * (1 + 1e-6)))
        assume(abs(outside) > 1e-12)
        assert (outside < 0) == stable


@given(form=forms)
@settings(max_examples=100, deadline=None)
def test_at_the_fold_both_branches_meet(form: NormalForm) -> None:
    fold = form.saddle_node()
    assume(fold is not None and fold[0] < 0.999 * form.critical_speed)
    assert fold is not None
    speed, amplitude = fold
    above = speed + 1e-10 * form.critical_speed
    assume(np.isfinite(form.steady_amplitudes(above)).all())
    slope = np.diff(form.growth_rate(speed, amplitude * np.array([1 - 1e-6, 1 + 1e-6]))) / 2e-6
    assert float(slope[0]) * form.time_scale == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(form.steady_amplitudes(above), amplitude, rtol=5e-2)
    assert np.isnan(form.steady_amplitudes(speed - 1e-7 * form.critical_speed)).all()


def test_a_supercritical_form_has_no_fold_and_no_unstable_branch() -> None:
    form = NormalForm(8.0, 0.12, -2000.0, -0.06, 0.0, -1e6)
    assert form.criticality == 'supercritical'
    assert form.saddle_node() is None
    assert form.hysteresis_width is None
    speeds = np.linspace(5.0, 10.0, 21)
    unstable, stable = form.steady_amplitudes(speeds)
    assert np.isnan(unstable).all()
    np.testing.assert_array_equal(np.isfinite(stable), speeds > 8.0)


@pytest.mark.parametrize('name', ['D1', 'D4', 'D7', 'D10', 'D15'])
def test_a_coefficient_that_is_no_number_is_named(name: str) -> None:
    values = dict.fromkeys(('D1', 'D4', 'D7', 'D10', 'D15'), 1.0) | {name: math.nan}
    with pytest.raises(ConfigError, match=f'{name} must be finite, got nan'):
        NormalForm(critical_speed=8.0, **values)


def test_a_normal_form_is_known_without_scipy() -> None:
    # Every node and verb imports it; scipy costs them 0.5 s and 50 MB.
    words = 'import sys, hunt_ros.dynamics.identified; sys.exit("scipy" in sys.modules)'
    python('-c', words)
