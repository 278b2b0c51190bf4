"""The sensor node in a process of its own, reading a real socket, heard by a real subscriber."""

from __future__ import annotations

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState

from hunt_ros.drivers.simulator_protocol import Channel
from hunt_ros.drivers.simulator_server import SimulatorServer
from hunt_ros.nodes.conversions import read_diagnostic, to_ns

pytestmark = pytest.mark.ros


def _serve_until_read(graph, server: SimulatorServer) -> None:
    graph.spin_until(lambda: server.poll() is None and server.readers == 1)


def _send_until_heard(graph, server: SimulatorServer, channel: Channel, heard: list) -> None:
    """Send a sample now and then: what comes before the node is ready is thrown away."""

    def sent_and_heard() -> bool:
        if not heard:
            server.send_sensor(channel, np.array([10]), np.array([0.5]))
        return bool(heard)

    graph.spin_until(sent_and_heard)
    graph.spin(0.5)


def test_every_sample_is_published_with_the_stamp_of_the_driver(graph) -> None:
    server = SimulatorServer('127.0.0.1', graph.port)
    heard = graph.collect(JointState, 'lateral')
    graph.start('lateral_sensor', port=graph.port)
    _serve_until_read(graph, server)
    _send_until_heard(graph, server, Channel.LATERAL, heard)
    heard.clear()
    stamps = 1_700_000_000_000_000_000 + 2_000_000 * np.arange(500)
    for k in range(0, 500, 10):
        server.send_sensor(Channel.LATERAL, stamps[k : k + 10], 1e-6 * np.arange(k, k + 10.0))
    graph.spin_until(lambda: len(heard) == 500)
    assert [to_ns(message.header.stamp) for message in heard] == stamps.tolist()
    assert [message.position[0] for message in heard] == (1e-6 * np.arange(500.0)).tolist()
    assert heard[0].name == ['lateral']
    server.close()


def test_a_lost_simulator_is_an_error_in_the_diagnostics_and_is_found_again(graph) -> None:
    server = SimulatorServer('127.0.0.1', graph.port)
    health = graph.collect(DiagnosticArray, '/diagnostics')
    heard = graph.collect(JointState, 'yaw')
    graph.start('yaw_sensor', port=graph.port)
    _serve_until_read(graph, server)
    server.close()

    def levels() -> list[str]:
        return [read_diagnostic(message)['level'] for message in health]

    graph.spin_until(lambda: 'ERROR' in levels())
    server = SimulatorServer('127.0.0.1', graph.port)
    _serve_until_read(graph, server)
    _send_until_heard(graph, server, Channel.YAW, heard)
    server.close()


@pytest.mark.parametrize(
    ('parameters', 'words'),
    [
        ({'sample_rate_hz': 5.0}, ('sample_rate_hz', '5.0', '100')),
        ({'driver': 'telepathy'}, ('driver', 'telepathy', 'simulated')),
        ({'port': 0}, ('port', '0', '1')),
    ],
)
def test_an_impossible_parameter_ends_the_node_with_one_line(graph, parameters, words) -> None:
    graph.start('lateral_sensor', **parameters)
    assert graph.wait('lateral_sensor') == 2
    lines = graph.log('lateral_sensor').read_text().strip().splitlines()
    assert len(lines) == 1
    for word in words:
        assert word in lines[0]
