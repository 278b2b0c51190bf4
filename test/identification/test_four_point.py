from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.errors import IdentificationError
from hunt_ros.identification.four_point import four_point


def radii(eps):
    return PAPER_NORMAL_FORM.stable_amplitude(8.0 * (1.0 + eps)) / 0.097


def test_four_exact_points_give_equation_33_back():
    eps = np.array([-0.19, -0.1, 0.0, 0.1])
    found = four_point(eps, radii(eps), 0.12)
    for name in ('D4', 'D7', 'D10', 'D15'):
        assert getattr(found, name) == pytest.approx(getattr(PAPER_NORMAL_FORM, name), rel=1e-6)
    assert found.warnings == ()
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
    assert any(
        'eps = -0.2' in warning or 'unstable branch' in warning for warning in found.warnings
    )


@pytest.mark.parametrize(
    ('eps', 'r'),
    [([-0.1, 0.0, 0.1], [1, 1, 1]), ([0, 0, 0, 0], [1, 1, 1, 1]), ([0, 1, 2, 3], [1, 1, 0, 1])],
)
def test_fewer_than_four_points_are_refused(eps, r):
    with pytest.raises(IdentificationError, match='four-point recipe'):
        four_point(np.array(eps, dtype=float), np.array(r, dtype=float), 0.12)
