"""The driver that docs/drivers.md shows, as it stands there, installed and run by a real node."""

from __future__ import annotations

import contextlib
import os
import re
import socket
from pathlib import Path

import numpy as np
from made import install_driver
from sensor_msgs.msg import JointState

from hunt_ros.nodes.support.conversions import to_ns

ROOT = Path(__file__).parents[2]


def _install_example(folder: Path) -> None:
    """Do what pip does with the example and its setup.py."""
    module, setup = re.findall(
        r'```python\n(.*?)```', (ROOT / 'docs/drivers.md').read_text(), re.S
    )
    entry = re.search(r"'hunt_ros\.drivers': \['(.*?)'\]", setup)[1]
    name = re.search(r"py_modules=\['(.*?)'\]", setup)[1]
    install_driver(folder, name, module, entry)


def test_the_driver_of_the_docs_is_found_read_and_read_again_after_a_loss(
    graph, tmp_path, monkeypatch
) -> None:
    _install_example(tmp_path)
    monkeypatch.setenv('PYTHONPATH', f'{ROOT}{os.pathsep}{tmp_path}')
    heard = graph.collect(JointState, 'lateral')
    health = graph.told()
    with socket.create_server(('127.0.0.1', 0)) as amplifier:
        amplifier.settimeout(0.01)
        graph.start(
            'lateral_sensor',
            driver='lab_amplifier',
            address='127.0.0.1',
            stream_port=amplifier.getsockname()[1],
        )
        connections: list[socket.socket] = []

        def streamed(count: int) -> bool:
            with contextlib.suppress(TimeoutError):
                connections.append(amplifier.accept()[0])
            if connections:
                connections[-1].sendall(np.arange(5.0, dtype='<f4').tobytes())
            return len(heard) >= count

        graph.spin_until(lambda: streamed(50))
        assert {message.position[0] for message in heard} == set(range(5))
        connections.pop().close()
        graph.spin_until(lambda: health.says('closed the connection'))
        heard.clear()
        graph.spin_until(lambda: streamed(50))
        for connection in connections:
            connection.close()
    stamps = [to_ns(message.header.stamp) for message in heard]
    assert (np.diff(stamps) > 0).all()
