"""Recordings side by side: the numbers of each, and of two their difference in deviations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from report_made import identification_of

from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.report.comparison import comparison_diagram, comparison_table, names_of
from hunt_ros.report.figures import style
from hunt_ros.samples import Record, Uncertain


@pytest.fixture
def alone():
    """Two recordings, the second with a critical speed that is 0.3 m/s higher."""
    found = []
    for number, shift in enumerate((0.0, 0.3)):
        form = replace(PAPER_NORMAL_FORM, critical_speed=PAPER_NORMAL_FORM.critical_speed + shift)
        found.append(
            identification_of(
                form,
                v_n=None if number else Uncertain(6.4, 0.1),
                hysteresis_width=None,
                coefficients={'D1': Uncertain(0.1, 0.01)},
                records=[Record({}, f'/data/run_{number}')],
            )
        )
    return found


def test_the_difference_is_told_in_standard_deviations(alone) -> None:
    page = comparison_table(alone)
    assert 'run_0' in page
    assert 'in standard deviations' in page
    row = page[page.index('m/s') :].split('</tr>')[0]
    assert '0.300 ± 0.057' in row
    assert '5.3' in row
    assert page.count('not known') == 11, 'v_n once, the width and four coefficients twice'


def test_each_recording_has_its_colour_and_its_name(alone) -> None:
    figure = comparison_diagram(alone)
    lines = {line.get_label(): line for line in figure.axes[0].get_lines()}
    assert lines['run_0'].get_color() != lines['run_1'].get_color()
    for number, name in enumerate(('run_0', 'run_1')):
        speeds = lines[name].get_xdata()
        known = np.isfinite(lines[name].get_ydata())
        v_n = alone[number].normal_form.form.nonlinear_critical_speed
        assert speeds[known].min() == pytest.approx(v_n, abs=1e-6)
    style.svg(figure, 'compared')


def test_a_recording_without_a_form_of_its_own_is_named_all_the_same(alone) -> None:
    alone[1] = replace(alone[1], normal_form=None)
    legend = comparison_diagram(alone).axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == [
        'run_0',
        'run_1',
        'speed up',
        'speed down',
    ]


def test_recordings_of_one_name_keep_their_paths(alone) -> None:
    alone[0] = replace(alone[0], records=[Record({}, '/monday/run_1')])
    assert names_of(alone) == ['/monday/run_1', '/data/run_1']


def test_three_recordings_have_no_difference(alone) -> None:
    assert 'difference' not in comparison_table([*alone, alone[0]])
