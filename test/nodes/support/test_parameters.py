"""Every parameter takes effect when it is set, or is read-only and says so."""

from __future__ import annotations

from dataclasses import fields

import pytest

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.drivers.command import DriveLimits
from hunt_ros.drivers.interlock import InterlockSettings
from hunt_ros.nodes.bag_recorder import BagRecorderNode
from hunt_ros.nodes.hunting_detector import HuntingDetectorNode
from hunt_ros.nodes.normal_form_identifier import NormalFormIdentifierNode
from hunt_ros.nodes.rig_simulator import RigSimulatorNode
from hunt_ros.nodes.roller_speed import RollerSpeedNode
from hunt_ros.nodes.support.sensor import SensorNode
from hunt_ros.settings import Settings

#: A slider of a graphical tool over more than this is of no use.
_WIDEST = 1e9
#: Parameters that rclpy declares by itself.
_OF_ROS = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


def _taken(kind: type[Settings]) -> set[str]:
    return {item.name for item in fields(kind) if not item.metadata['fixed']}


#: Node -> parameters that a running node takes; each has an effect from then on.
LIVE = {
    'lateral_sensor': set(),
    'roller_speed': _taken(DriveLimits) | _taken(InterlockSettings),
    'rig_simulator': set(),
    'normal_form_identifier': set(),
    'bag_recorder': {  # with the next recording
        'rig_name', 'operator', 'notes', 'split_s', 'split_mib', 'buffer_mib', 'chunk_s',
        'least_free_mib',
    },
    'hunting_detector': _taken(DetectorConfig),
}  # fmt: skip


@pytest.mark.parametrize(
    ('make', 'parameters'),
    [
        (lambda: SensorNode('lateral'), {}),
        (RollerSpeedNode, {}),
        (RigSimulatorNode, {'port': None}),
        (NormalFormIdentifierNode, {}),
        (BagRecorderNode, {'autostart': False}),
        (HuntingDetectorNode, {}),
    ],
    ids=['sensor', 'roller_speed', 'rig_simulator', 'identifier', 'recorder', 'detector'],
)
def test_a_parameter_without_effect_is_read_only(graph, resident, make, parameters) -> None:
    given = {name: graph.port if value is None else value for name, value in parameters.items()}
    node = resident(make, **given)
    names = [name for name in node._parameters if not name.startswith(_OF_ROS)]
    descriptors = node.describe_parameters(names)
    assert {each.name for each in descriptors if not each.read_only} == LIVE[node.get_name()]
    for each in descriptors:
        assert not each.read_only or 'start' in each.additional_constraints
        for bounds in [*each.floating_point_range, *each.integer_range]:
            assert -_WIDEST <= bounds.from_value < bounds.to_value <= _WIDEST, each.name
        value = node.get_parameter_or(each.name).value
        assert value not in ([''], [-1.0], -1.0), f'{each.name}: a number or word that means none'


def test_a_limit_with_one_end_is_said_in_words(graph, resident) -> None:
    node = resident(RollerSpeedNode, port=graph.port)
    both, one = node.describe_parameters(['safe_margin_mps', 'amplitude_limit_m'])
    assert both.floating_point_range[0].to_value == 100.0
    assert not one.floating_point_range
    assert one.additional_constraints == 'at least 1e-06'
