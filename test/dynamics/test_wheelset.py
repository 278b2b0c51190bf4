"""The equations of motion against their printed form, and the Jacobian against differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.dynamics.parameters import CUBIC_KEYS, QUINTIC_KEYS, RigParameters
from hunt_ros.dynamics.wheelset import Wheelset
from hunt_ros.errors import ConfigError


def random_rig(seed: int) -> RigParameters:
    """Return a rig with all twenty coefficients of each kind."""
    rng = np.random.default_rng(seed)
    sizes = {3: 60.0, 5: 6e3}
    alpha, beta = (
        {key: float(rng.normal(0, sizes[int(key[0]) + int(key[1])])) for key in keys}
        for keys in (CUBIC_KEYS + QUINTIC_KEYS,) * 2
    )
    return RigParameters(alpha=alpha, beta=beta).with_linear(*rng.uniform(1.0, 3.0, 2))


@given(seed=st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_the_derivative_is_equations_2_and_3_term_by_term(seed: int) -> None:
    rig = random_rig(seed)
    rng = np.random.default_rng(seed)
    y, a, p, b = rng.normal(0, 0.05, 4)
    v_mps = rng.uniform(1.0, 12.0)
    v = v_mps / rig.speed_scale
    lateral = -rig.d11 / v * a - rig.k11 * y - rig.k12 * p
    yaw = -rig.d22 / v * b - rig.k21 * y - rig.k22 * p
    for key in CUBIC_KEYS + QUINTIC_KEYS:
        i, j = int(key[0]), int(key[1])
        lateral -= rig.alpha[key] * y**i * p**j
        yaw -= rig.beta[key] * y**i * p**j
    found = Wheelset(rig).derivative([y, a, p, b], v_mps)
    np.testing.assert_allclose(found, [a, lateral, b, yaw], rtol=1e-12, atol=1e-15)


@given(seed=st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_the_jacobian_is_the_derivative_of_the_derivative(seed: int) -> None:
    wheelset = Wheelset(random_rig(seed))
    rng = np.random.default_rng(seed)
    state, speed = rng.normal(0, 0.05, 4), rng.uniform(1.0, 12.0)
    step = 1e-6
    columns = [
        (wheelset.derivative(state + e, speed) - wheelset.derivative(state - e, speed)) / 2 / step
        for e in step * np.eye(4)
    ]
    jacobian = wheelset.jacobian(state, speed)
    scale = np.abs(jacobian).max()
    np.testing.assert_allclose(jacobian, np.stack(columns, axis=-1), atol=1e-7 * scale)


@pytest.mark.parametrize('speed', [0.0, -1.0, float('nan')])
def test_a_speed_that_is_not_positive_is_refused(speed: float) -> None:
    with pytest.raises(ConfigError, match='speed must be positive'):
        Wheelset(RigParameters()).linear_matrix(speed)
