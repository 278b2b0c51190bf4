"""What a node cannot do it refuses before anything moves: exit code 2, and one line says why."""

from __future__ import annotations

import pytest
from made import python

DEPTH = 'qos_overrides./rig/lateral.subscription.depth'


@pytest.mark.parametrize(
    ('node', 'parameters', 'words'),
    [
        ('lateral_sensor', {'sample_rate_hz': 5.0}, 'Parameter sample_rate_hz out of range'),
        ('lateral_sensor', {'driver': 'telepathy'}, "'telepathy': unknown, those there are:"),
        ('axle_box_sensor', {}, "driver simulated: no channel 'axle_box', it has lateral, yaw"),
        ('yaw_sensor', {'calibration': 'table.yaml'}, "table.yaml: unknown key 'table'"),
        ('roller_speed', {'driver': 'modbus'}, 'neither actual_register nor encoder_register'),
        ('roller_speed', {'profile': 'hold.yaml'}, 'step 1 (hold): duration_s: -1.0 is below 0'),
        ('rig_simulator', {'wheelset': 'binary.yaml'}, "wheelset 'binary.yaml': cannot read it"),
        ('alarm_outputs', {}, 'none of sound, command and relay_coil'),
        ('alarm_outputs', {'command': '/nowhere/notify'}, "no program '/nowhere/notify'"),
        ('hunting_detector', {DEPTH: "'many'"}, DEPTH),
    ],
)
def test_what_a_node_refuses_ends_it_with_one_line(graph, node, parameters, words) -> None:
    (graph.folder / 'table.yaml').write_text('calibration: {table: [[0, 0], [2, 1]]}')
    (graph.folder / 'hold.yaml').write_text('profile: [{hold: {speed_mps: 6, duration_s: -1}}]')
    (graph.folder / 'binary.yaml').write_bytes(b'\xff\xfe\xff')
    graph.start(node, **parameters)
    assert graph.wait(node, 60.0) == 2
    said = graph.log(node).read_text().strip()
    assert words in said.splitlines()[-1]
    assert 'Traceback' not in said


def test_the_executable_of_several_nodes_asks_which() -> None:
    (line,) = python('-m', 'hunt_ros.nodes.entry', code=2).stderr.splitlines()
    assert 'bag_recorder' in line
