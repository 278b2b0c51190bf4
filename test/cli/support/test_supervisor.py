"""The processes of a run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hunt_ros.cli.main import main
from hunt_ros.cli.support import suite, supervisor
from hunt_ros.cli.support.processes import NodeSpec
from hunt_ros.cli.support.supervisor import Supervisor
from hunt_ros.suite import SIMULATOR, SOURCES


def test_the_logs_of_another_run_are_not_overwritten(tmp_path: Path) -> None:
    pytest.importorskip('rclpy', reason='the extra ros is not installed')
    runs = [Supervisor('rig', tmp_path / 'logs', private=True) for _ in range(3)]
    folders = {run.logs for run in runs}
    assert len(folders) == 3
    assert all(folder.parent == tmp_path / 'logs' for folder in folders)


def test_two_simulated_rigs_on_one_machine_do_not_share_a_port(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip('rclpy', reason='the extra ros is not installed')
    started: list[dict] = []
    monkeypatch.setattr(supervisor.Supervisor, 'start', lambda *given: None)
    monkeypatch.setattr(suite, 'start_nodes', lambda *given: started.append(given[3]))
    words = ['run', '--simulated', '--duration', '1e-9', '--directory', str(tmp_path)]
    assert main(words) == 0
    ports = {started[0][name]['port'] for name in (SIMULATOR, *SOURCES)}
    assert len(ports) == 1
    assert 'sweep' in started[0]['roller_speed']['profile'], 'what the key s starts'
    assert ports != {47100}, 'the default is where a rig of ros2 launch is'
    file = tmp_path / 'rig.yaml'
    file.write_text('/**/rig_simulator: {ros__parameters: {port: 47110}}')
    assert main([*words, '--rig', str(file)]) == 0
    assert SIMULATOR not in started[1], 'the file says where the simulator is'


def test_recordings_go_where_the_option_says_else_where_the_rig_file_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A section of a node in the rig file once won over the option: no recording in its folder."""
    pytest.importorskip('rclpy', reason='the extra ros is not installed')
    started: list[tuple[NodeSpec, str]] = []

    def start(run: Supervisor, spec: NodeSpec, *rest: object) -> None:
        if spec.module == 'bag_recorder':
            started.append((spec, spec.parameter_files[-1].read_text()))

    monkeypatch.setattr(supervisor.Supervisor, 'start', start)
    file, told, asked = tmp_path / 'rig.yaml', tmp_path / 'told', tmp_path / 'asked'
    file.write_text(f'/**/bag_recorder: {{ros__parameters: {{directory: {told}}}}}')
    words = ['run', '--listen', '--duration', '1e-9', '--rig', str(file)]
    for given, folder in (([], told), (['--directory', str(asked)], asked)):
        started.clear()
        assert main([*words, *given]) == 0
        ((recorder, told_it),) = started
        assert [recorder.parameter_files[0], recorder.parameters] == [file, {}]
        own = json.loads(told_it)
        assert own['/**/bag_recorder']['ros__parameters']['directory'] == str(folder)
        assert f'logs in {folder / "logs"}' in capsys.readouterr().out
