"""Where ROS has no EventsExecutor, as Humble, a node runs without it."""

from __future__ import annotations

import os


def test_a_node_runs_without_an_events_executor(graph, monkeypatch) -> None:
    script = "import sys\nsys.modules['rclpy.experimental'] = None\n"
    (graph.folder / 'sitecustomize.py').write_text(script)
    monkeypatch.setenv('PYTHONPATH', f'{graph.folder}{os.pathsep}{os.environ["PYTHONPATH"]}')
    health = graph.told()
    graph.start('roller_speed', port=graph.port)  # where nobody answers
    graph.spin_until(lambda: health)
