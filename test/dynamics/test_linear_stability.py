"""Appendix B against eigenvalues computed numerically."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hunt_ros.dynamics.center_manifold import normal_form_of
from hunt_ros.dynamics.linear_stability import (
    critical_frequency,
    critical_speed,
    eigenvalues,
    hunting_mode,
)
from hunt_ros.dynamics.parameters import RigParameters, paper_rig
from hunt_ros.dynamics.wheelset import Wheelset
from hunt_ros.errors import ConfigError

creeps = st.tuples(st.floats(0.5, 6.0), st.floats(0.5, 6.0))


def linear_rig(creep: tuple[float, float]) -> RigParameters:
    return RigParameters().with_linear(*creep)


def has_hopf(rig: RigParameters) -> bool:
    try:
        critical_speed(rig)
    except ConfigError:
        return False
    return True


def test_the_default_rig_is_the_linear_model_of_the_paper() -> None:
    rig = paper_rig()
    assert (rig.d11, rig.d22) == pytest.approx((1.74497, 2.56600), abs=5e-6)
    assert critical_speed(rig) == pytest.approx(8.0, abs=1e-12)
    assert critical_frequency(rig) == pytest.approx(0.68755, abs=5e-6)
    form = normal_form_of(rig)
    d1, d7 = form.D1, form.D7
    assert d1.real == pytest.approx(0.12, abs=1e-12)
    assert d7.real == pytest.approx(-0.1077, abs=5e-5)
    assert hunting_mode(rig, 8.0).frequency_hz == pytest.approx(2.835, abs=5e-4)


@given(creep=creeps)
@settings(max_examples=40, deadline=None)
def test_the_hunting_mode_changes_sign_at_the_critical_speed_and_only_there(
    creep: tuple[float, float],
) -> None:
    rig = linear_rig(creep)
    assume(has_hopf(rig))
    speeds = critical_speed(rig) * np.array([0.2, 0.5, 0.9, 0.999, 1.001, 1.1, 2.0, 5.0])
    assert (
        np.sign(eigenvalues(rig, speeds)[:, 0].real) == np.sign(speeds - speeds[3:5].mean())
    ).all()


def test_eigenvectors_satisfy_their_equations() -> None:
    rig = paper_rig()
    for speed in (3.0, 6.4, 7.2, 9.0):
        mode = hunting_mode(rig, speed)
        matrix = Wheelset(rig).linear_matrix(speed)
        value = mode.eigenvalue * rig.time_scale
        np.testing.assert_allclose(matrix @ mode.shape, value * mode.shape, atol=1e-12)
        np.testing.assert_allclose(mode.adjoint @ matrix, value * mode.adjoint, atol=1e-12)
        assert mode.shape[0] == pytest.approx(1.0)
        assert mode.adjoint @ mode.shape == pytest.approx(1.0)


def test_a_rig_without_hopf_point_is_named() -> None:
    with pytest.raises(ConfigError, match=r'flat: no Hopf point.*tread_angle = 0\.0001'):
        critical_speed(RigParameters(tread_angle=1e-4, name='flat'))


def test_where_creep_damps_everything_there_is_no_hunting_mode() -> None:
    with pytest.raises(ConfigError, match=r'no oscillating mode at 0\.01 m/s'):
        hunting_mode(RigParameters(lateral_frequency_rad_per_s=1e-6, tread_angle=1e-9), 0.01)
