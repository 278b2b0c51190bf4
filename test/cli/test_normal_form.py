"""`hunt normal-form`: the keys, the agreement with the library, and one line for bad input."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from hunt_ros.cli.main import main
from hunt_ros.dynamics.center_manifold import normal_form_of
from hunt_ros.dynamics.parameters import RigParameters, paper_rig


def document(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rig: RigParameters
) -> dict[str, Any]:
    path = tmp_path / 'rig.yaml'
    path.write_text(rig.to_yaml(), encoding='utf-8')
    assert main(['normal-form', str(path), '--json', '-']) == 0
    result: dict[str, Any] = json.loads(capsys.readouterr().out)
    return result


def test_the_json_has_its_keys_and_the_numbers_of_the_library(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = document(tmp_path, capsys, paper_rig())
    form = normal_form_of(paper_rig())
    assert result['v_c_mps'] == pytest.approx(8.0)
    assert result['hunting_frequency_hz'] == pytest.approx(2.835, abs=1e-3)
    for name in ('D1', 'D4', 'D7', 'D10', 'D15'):
        assert complex(*result[name]) == getattr(form, name)
    assert set(result['amplitude_coordinate']) == {'D10', 'D15'}
    assert result['criticality'] == 'subcritical'
    assert result['v_n_mps'] == pytest.approx(6.976, abs=1e-3)
    assert result['full_model']['v_n_mps'] == pytest.approx(6.433, abs=1e-3)


def test_what_does_not_exist_is_null(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    soft = document(tmp_path, capsys, RigParameters(beta={'30': -300.0}))
    assert soft['criticality'] == 'supercritical'
    assert soft['v_n_mps'] is None
    linear = document(tmp_path, capsys, RigParameters())
    assert linear['criticality'] is None
    assert linear['full_model'] == {'v_n_mps': None}


def test_a_person_gets_a_table_and_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, picture = tmp_path / 'rig.yaml', tmp_path / 'diagram.png'
    path.write_text(paper_rig().to_yaml(), encoding='utf-8')
    assert main(['normal-form', str(path), '--plot', str(picture)]) == 0
    printed = capsys.readouterr().out
    assert 'subcritical Hopf bifurcation at v_c = 8.0000 m/s' in printed
    assert 'fold of the full model: v_n = 6.433 m/s' in printed
    assert 'e+' not in printed
    assert picture.read_bytes().startswith(b'\x89PNG')
