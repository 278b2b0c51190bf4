"""The condensed edge of the basin against the exact committor and escape time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import erfc

from hunt_ros.detection.basin import SHARP, EdgeTable, edge_noise, form_numbers
from hunt_ros.dynamics.disturbance import committor, diffusion_from_quiet, mean_escape_time
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM

FORM = PAPER_NORMAL_FORM


@pytest.mark.parametrize('speed', [6.6, 7.2, 7.6])
@pytest.mark.parametrize('ratio', [0.02, 0.05, 0.1, 0.2])
def test_two_moments_stand_for_the_committor(speed: float, ratio: float) -> None:
    unstable = float(FORM.unstable_amplitude(speed))
    diffusion = diffusion_from_quiet(FORM, speed, ratio * unstable)
    edge = edge_noise(FORM, speed, diffusion)
    amplitude = np.linspace(0.3, 1.8, 200) * unstable
    exact = committor(FORM, speed, amplitude, diffusion)
    distance = (amplitude / unstable - edge.centre) / max(edge.width, 1e-9)
    condensed = 0.5 * erfc(-distance / math.sqrt(2.0))
    assert np.abs(condensed - exact).max() < 0.04
    assert edge.rate == pytest.approx(1.0 / mean_escape_time(FORM, speed, diffusion), rel=1e-9)


def test_without_noise_or_form_the_edge_is_the_branch_itself() -> None:
    assert EdgeTable(None).at(7.2, 1e-11) == SHARP
    assert EdgeTable(FORM).at(7.2, math.nan) == SHARP
    assert EdgeTable(FORM).at(5.0, 1e-11) == SHARP  # no unstable branch there


def test_the_table_answers_by_its_cells_whatever_was_asked_before() -> None:
    first, second = EdgeTable(FORM), EdgeTable(FORM)
    first.at(7.19, 1.1e-11)
    for speed, diffusion in ((7.2, 1e-11), (6.9, 3e-12), (7.2, 1e-11)):
        assert first.at(speed, diffusion) == second.at(speed, diffusion)


def test_uncertainty_of_the_form_spreads_the_branch_and_the_critical_speed() -> None:
    covariance = np.zeros((6, 6))
    covariance[0, 0] = 0.1**2
    numbers = form_numbers(IdentifiedNormalForm(FORM, covariance))
    speeds = numbers.speed_low + numbers.speed_step * np.arange(numbers.unstable_std.size)
    at = np.argmin(np.abs(speeds - 7.2))
    shifted = [float(replace(FORM, critical_speed=v).unstable_amplitude(7.2)) for v in (7.9, 8.1)]
    assert numbers.unstable_std[at] == pytest.approx((shifted[1] - shifted[0]) / 2.0, rel=0.2)
    at = np.argmin(np.abs(speeds - 8.0))
    assert 0.3 < numbers.quiet_share[at] < 0.7
