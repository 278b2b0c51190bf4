"""A normal form of another rig would call the wrong speeds safe: it is refused everywhere."""

from __future__ import annotations

from pathlib import Path

from std_msgs.msg import String

from hunt_ros.cli.main import main
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.nodes.support.qos import latched


def _form(folder: Path, rig_name: str) -> Path:
    path = folder / f'{rig_name}.yaml'
    path.write_text(IdentifiedNormalForm(PAPER_NORMAL_FORM, rig_name=rig_name).to_yaml())
    return path


def test_hunt_run_starts_nothing_with_it(tmp_path, capsys) -> None:
    rig = tmp_path / 'rig_file.yaml'
    rig.write_text('/**: {ros__parameters: {rig_name: B}}\n')
    words = ['--rig', str(rig), '--normal-form', str(_form(tmp_path, 'A'))]
    assert main(['run', *words, '--directory', str(tmp_path / 'recordings')]) == 2
    assert "A.yaml: identified on rig 'A', expected 'B'" in capsys.readouterr().err
    assert not (tmp_path / 'recordings').exists()


def test_the_detector_does_not_begin_with_it_nor_take_it_over(graph) -> None:
    graph.start('hunting_detector', _form(graph.folder, 'A'), rig_name='B')
    assert graph.wait('hunting_detector') == 2
    assert "identified on rig 'A', expected 'B'" in graph.log('hunting_detector').read_text()

    statuses = graph.told('hunting/status')
    graph.start('hunting_detector', rig_name='B')
    graph.spin_until(lambda: statuses)
    publisher = graph.node.create_publisher(String, 'hunting/normal_form', latched())
    publisher.publish(String(data=_form(graph.folder, 'A').read_text()))
    graph.spin_until(
        lambda: 'the form in force stays' in graph.log('hunting_detector').read_text()
    )
    assert statuses.last.get('v_n_mps', 'nan') in ('nan', '')
    publisher.publish(String(data=_form(graph.folder, 'B').read_text()))
    graph.spin_until(lambda: statuses.last.get('v_n_mps', 'nan').startswith('6.4'))
