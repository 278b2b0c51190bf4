"""The processes of a run."""

from __future__ import annotations

from pathlib import Path

import pytest

from hunt_ros.cli.processes import Processes


def test_the_logs_of_another_run_are_not_overwritten(tmp_path: Path) -> None:
    pytest.importorskip('rclpy', reason='the extra ros is not installed')
    runs = [Processes('rig', tmp_path / 'logs', private=True) for _ in range(3)]
    folders = {run.logs for run in runs}
    assert len(folders) == 3
    assert all(folder.is_dir() and folder.parent == tmp_path / 'logs' for folder in folders)
