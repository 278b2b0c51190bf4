"""A user's own model beside the measurement."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hunt_ros.cli.main import main
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.errors import HuntError
from hunt_ros.report.figures.own_model import model_diagram, model_of, residuals, sentence, to_json
from hunt_ros.report.result import Result


def table(form, shift: float = 0.0) -> str:
    speeds = np.linspace(6.0, 8.8, 141)
    unstable, stable = form.steady_amplitudes(speeds)
    rows = ['v, A, stability']
    for name, branch in (('unstable', unstable), ('stable', stable + shift)):
        known = np.isfinite(branch)
        rows += [f'{v},{a},{name}' for v, a in zip(speeds[known], branch[known], strict=True)]
    return '\n'.join(rows)


@pytest.fixture
def result(document):
    entries = document()
    for point in entries['branches']:
        known = point['unstable_amplitude_m']
        point['unstable_std_m'] = None if known is None else 1e-5
    return Result(entries)


def test_the_true_model_is_within_the_scatter_and_a_wrong_one_is_not(result):
    found = residuals(model_of(table(PAPER_NORMAL_FORM), 'own.csv'), result)
    assert {one.branch for one in found} == {'stable', 'unstable'}
    stable = np.array([one.deviations for one in found if one.branch == 'stable'])
    assert stable.size > 10
    assert np.sqrt(np.mean(stable**2)) < 1.5
    # Linear interpolation of the table, near the fold.
    assert all(abs(one.deviations) < 0.5 for one in found if one.branch == 'unstable')
    wrong = residuals(model_of(table(PAPER_NORMAL_FORM, 5e-5), 'own.csv'), result)
    assert np.mean([one.deviations for one in wrong if one.branch == 'stable']) < -3.0
    assert 'within two standard deviations' in sentence(found)


def test_it_is_drawn_and_in_the_json(result):
    model = model_of(table(PAPER_NORMAL_FORM), 'own.csv')
    found = residuals(model, result)
    assert len(model_diagram(model, found, result).axes) == 2
    assert to_json(model, found)['residuals'][0]['branch'] == 'stable'
    nothing = model_of('speed_mps,amplitude_m,stable\n3.0,0.0,1', 'rest.csv')
    assert residuals(nothing, result) == []
    assert model_diagram(nothing, [], result).axes
    assert 'no limit cycle' in sentence([])


@pytest.mark.slow
def test_the_limit_cycles_of_a_rig_are_a_model_too(result):
    path = Path(__file__).parents[3] / 'config' / 'wheelset.yaml'
    model = model_of(path.read_text(), str(path))
    speed, _ = model.branch(True)
    assert 6.3 < speed[0] < 6.6


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('', 'no column v'),
        ('v,stability\n7,stable', 'no column A'),
        ('v,A,stability', '0 rows'),
        ('v,A,stability\n7,fast,stable', 'row 2'),
        ('v,A,stability\n7,1e-4,maybe', 'row 2'),
        ('v,A,stability\n7', 'row 2'),
        ('v,A,stability\n7,84,stable', '84 m'),
        ('v,A,stability\n-7,1e-4,stable', '-7 m/s'),
        ('v,A,stability\n7,nan,stable', 'nan m'),
    ],
)
def test_what_is_no_model_is_refused_in_a_line(text, words):
    with pytest.raises(HuntError) as error:
        model_of(text, 'own.csv')
    assert words in str(error.value)
    assert 'own.csv' in str(error.value)
    assert '\n' not in str(error.value)


def test_a_model_that_is_not_there_is_said_before_the_work_begins(tmp_path, capsys):
    words = ['report', 'bags/nowhere', '--model', str(tmp_path / 'own.csv')]
    assert main([*words, '--out', str(tmp_path / 'r.html')]) == 2
    error = capsys.readouterr().err
    assert 'own.csv' in error
    assert error.count('\n') == 1
