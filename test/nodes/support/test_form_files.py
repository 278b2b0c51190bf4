from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from hunt_ros.detection.acceptance import is_rolled_back
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.errors import HuntError
from hunt_ros.nodes.support.form_files import FormFiles


def text(v_c: float) -> str:
    return IdentifiedNormalForm(replace(PAPER_NORMAL_FORM, critical_speed=v_c)).to_yaml()


def v_c(path_text: str) -> float:
    return IdentifiedNormalForm.from_yaml(path_text).form.critical_speed


def kept(folder: Path, *speeds: float) -> FormFiles:
    """Return the files of a folder once forms of these critical speeds, m/s, were kept."""
    files = FormFiles(folder)
    for speed in speeds:
        files.keep(text(speed))
    return files


def test_going_back_walks_through_earlier_forms_in_their_order_and_deletes_nothing(
    tmp_path,
) -> None:
    files = kept(tmp_path / 'rig', 7.0, 7.5, 8.0)
    names = [path.name for path in files.earlier()]
    assert names == ['normal_form_001.yaml', 'normal_form_002.yaml']
    assert v_c(files.newest.read_text()) == 8.0
    for speed in (7.5, 7.0):
        back = files.go_back()
        assert is_rolled_back(IdentifiedNormalForm.from_yaml(back))
        assert v_c(back) == speed
        assert files.newest.read_text() == back
    with pytest.raises(HuntError, match='no earlier normal form'):
        files.go_back()
    files.keep(text(8.5))
    assert v_c(files.newest.read_text()) == 8.5
    there = sorted(v_c(path.read_text()) for path in files.newest.parent.iterdir())
    assert there == [7.0, 7.5, 8.0, 8.5], 'a new form does not overwrite one'


def test_an_earlier_form_that_cannot_be_read_changes_nothing(tmp_path) -> None:
    files = kept(tmp_path, 7.0, 7.5)
    files.earlier()[-1].write_text('half a file: [')
    before = {path.name: path.read_text() for path in tmp_path.iterdir()}
    with pytest.raises(HuntError):
        files.go_back()
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == before


def test_the_identification_beside_a_form_goes_where_the_form_goes(tmp_path) -> None:
    files = FormFiles(tmp_path / 'kept')
    for speed in (7.0, 7.5, 8.0):
        whole = tmp_path / f'{speed}.npz'
        whole.write_text(str(speed))
        files.keep(text(speed), whole)
    files.go_back()
    for path in (tmp_path / 'kept').glob('*.yaml'):
        assert path.with_suffix('.npz').read_text() == str(v_c(path.read_text()))
    assert len(list((tmp_path / 'kept').iterdir())) == 6
