"""The diagram of several models: what is drawn is what they say."""

from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.analysis.steady_state import SteadyState
from hunt_ros.dynamics.limit_cycle import Branch, limit_cycles
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.report.figures.diagram import (
    Curve,
    bifurcation_diagram,
    branch_curve,
    form_curve,
)


@pytest.fixture(scope='module')
def branch() -> Branch:
    return limit_cycles(paper_rig())


def test_lines_points_and_bands_are_all_there(branch: Branch) -> None:
    paper = form_curve(PAPER_NORMAL_FORM, 6.0, 9.0, 'paper', colour='#111111')
    v = np.linspace(7, 8, 5)
    edges = {'stable': (v, 4e-4 + 0 * v, 6e-4 + 0 * v)}
    banded = Curve('banded', v, 0 * v, 5e-4 + 0 * v, bands=edges, colour='#222222')
    states = [SteadyState(v, 6.8e-4, 1e-5, 'up', 60) for v in (8.2, 8.4)]
    figure = bifurcation_diagram(
        [branch_curve(branch, 'full', colour='#000000'), paper, banded], 6.0, 9.0, {'': states}
    )
    axes = figure.axes[0]
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ['full', 'paper', 'banded', 'speed up']
    stable = axes.get_lines()[0]
    drawn = np.asarray(stable.get_ydata(), dtype=float)
    assert np.nanmax(drawn) == pytest.approx(1e3 * branch.amplitude.max())
    assert axes.get_xlim() == (6.0, 9.0)
    assert len(axes.collections) >= 2  # the band and the error bars
    dashes = [line.get_linestyle() for line in axes.get_lines()[:4]]
    assert dashes == ['-', '--', '-', '--']


def test_the_stable_and_unstable_parts_of_a_branch_touch_at_the_fold(branch: Branch) -> None:
    curve = branch_curve(branch, 'full')
    both = np.isfinite(curve.stable) & np.isfinite(curve.unstable)
    assert both.sum() == 1
    assert curve.speed[both][0] == pytest.approx(6.433, abs=5e-3)


def test_a_picture_of_nothing_has_an_axis() -> None:
    nothing = np.full(3, np.nan)
    empty = Curve('none', np.linspace(6, 9, 3), nothing, nothing)
    figure = bifurcation_diagram([empty], 6.0, 9.0)
    assert figure.axes[0].get_ylim()[1] == 1.0
