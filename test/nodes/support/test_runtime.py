"""What a distribution of ROS lacks is said once by each process, and the node runs without it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='the extra ros is not installed')
pytestmark = pytest.mark.ros

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402

EXECUTOR = 'no EventsExecutor'
DISCOVERY = 'ROS_LOCALHOST_ONLY=1'


def said_at_start(graph) -> str:
    """Start a node, wait until it runs, and return what it has said."""
    heard = graph.collect(DiagnosticArray, '/diagnostics')
    graph.start('roller_speed', port=graph.port)  # where nobody answers
    graph.spin_until(lambda: heard)
    return graph.log('roller_speed').read_text()


@pytest.fixture
def no_events_executor(graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let Python find no `rclpy.experimental` in the processes that are started, as in Humble."""
    folder = tmp_path / 'as_humble'
    folder.mkdir()
    script = "import sys\nsys.modules['rclpy.experimental'] = None\n"
    (folder / 'sitecustomize.py').write_text(script)
    monkeypatch.setenv('PYTHONPATH', f'{folder}{os.pathsep}{os.environ["PYTHONPATH"]}')


def test_on_humble_one_line_says_what_is_lacking_and_the_node_runs(
    graph, no_events_executor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('ROS_DISTRO', 'humble')
    said = said_at_start(graph)
    (line,) = [line for line in said.splitlines() if 'humble' in line]
    assert line.startswith('[WARN]')
    assert EXECUTOR in line
    assert DISCOVERY in line


def test_on_humble_nothing_is_said_of_a_setting_that_is_made(
    graph, no_events_executor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('ROS_DISTRO', 'humble')
    monkeypatch.setenv('ROS_LOCALHOST_ONLY', '1')
    said = said_at_start(graph)
    assert EXECUTOR in said
    assert DISCOVERY not in said


def test_where_nothing_is_lacking_nothing_is_said(graph) -> None:
    said = said_at_start(graph)
    assert EXECUTOR not in said
    assert DISCOVERY not in said
