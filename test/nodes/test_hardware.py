"""Nodes on hardware that goes away and comes back."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState

from hunt_ros.nodes.conversions import read_diagnostic

pytestmark = pytest.mark.ros


def _told(health: list) -> list[tuple[str, str]]:
    texts = [read_diagnostic(message) for message in health]
    return [(text['level'], text['message']) for text in texts]


def test_a_sensor_on_a_modbus_device_that_is_cut_is_heard_again(graph, modbus_server) -> None:
    health = graph.collect(DiagnosticArray, '/diagnostics')
    heard = graph.collect(JointState, 'lateral')
    modbus_server.put(3, -7)
    graph.start(
        'lateral_sensor', driver='modbus', port=modbus_server.port, register=3, scale=0.001
    )
    graph.spin_until(lambda: heard)
    assert heard[0].position[0] == -0.007
    modbus_server.stop()
    graph.spin_until(lambda: any('cannot connect' in text for _, text in _told(health)))
    assert {text: level for level, text in _told(health)}[
        f'modbus tcp 127.0.0.1:{modbus_server.port} device 1: cannot connect'
    ] == 'ERROR'
    modbus_server.put(3, 8)
    modbus_server.start()
    graph.spin_until(lambda: heard[-1].position[0] == 0.008)
    health.clear()
    graph.spin_until(lambda: any(level != 'ERROR' for level, _ in _told(health)))
    log = graph.log('lateral_sensor').read_text()
    assert 'Connection to' not in log, 'the library does not write beside our one line'
