"""`hunt calibrate`: known displacements in, parameters of a sensor node out."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hunt_ros.cli.main import main
from hunt_ros.drivers.calibration import Calibration
from hunt_ros.rig import parameters_of, told_by

_POINTS = '1=-8.01,3=-4,5=0.02,7=3.99,9=8'


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_points_become_a_file_that_a_sensor_takes(folder, capsys) -> None:
    arguments = ['lateral.yaml', '--unit', 'mm', '--points', _POINTS, '--range', '0.1,9.9']
    assert main(['calibrate', *arguments, '--json', '-']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['gain']['value'] == pytest.approx(2.0005e-3)
    assert found['gain']['std'] == pytest.approx(found['residual_std'] / 40**0.5)
    low, high = found['gain']['ci95']
    assert high - low > 2.0 * 3.18 * found['gain']['std'], 'three degrees of freedom'
    assert sum(point['residual'] for point in found['points']) == pytest.approx(0.0, abs=1e-12)
    assert not found['warnings']
    text = Path('lateral.yaml').read_text()
    assert set(parameters_of('lateral_sensor', text, '')) == {'gain', 'offset', 'range'}
    calibration = told_by(Calibration(), 'lateral_sensor', [('', text)])
    assert calibration.range == (0.1, 9.9)
    assert calibration.apply([5.0])[0] == pytest.approx(0.0, abs=2e-5)


def test_two_points_give_no_deviation_that_is_none(folder, capsys) -> None:
    assert main(['calibrate', 'lateral.yaml', '--unit', 'mm', '--points', '1=2,2=4']) == 0
    told = capsys.readouterr().out
    assert 'gain 2 mm' in told
    assert 'take a third' in told
    assert 'nan' not in told


def test_points_that_bend_are_named(folder, capsys) -> None:
    points = ','.join(f'{x}={x + 0.05 * x * x}' for x in range(8))
    assert main(['calibrate', 'lateral.yaml', '--unit', 'mm', '--points', points]) == 1
    assert 'the points bend' in capsys.readouterr().out
