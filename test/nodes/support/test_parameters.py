"""Every parameter takes effect when it is set, or is read-only and says so."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.drivers.command import DriveLimits
from hunt_ros.drivers.interlock import InterlockSettings
from hunt_ros.errors import ConfigError
from hunt_ros.nodes.bag_recorder import BagRecorderNode
from hunt_ros.nodes.hunting_detector import HuntingDetectorNode
from hunt_ros.nodes.normal_form_identifier import NormalFormIdentifierNode
from hunt_ros.nodes.rig_simulator import RigSimulatorNode
from hunt_ros.nodes.roller_speed import RollerSpeedNode
from hunt_ros.nodes.support.parameters import declare
from hunt_ros.nodes.support.sensor import SensorNode
from hunt_ros.settings import Settings, setting

pytestmark = pytest.mark.ros

#: A slider of a graphical tool over more than this is of no use.
_WIDEST = 1e9
#: Parameters that rclpy declares by itself.
_OF_ROS = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


@dataclass(frozen=True)
class Two(Settings):
    """Two thresholds, one above the other."""

    low: float = setting(1.0, 'lower', unit='m', low=0.0)
    high: float = setting(2.0, 'upper', unit='m', low=0.0, high=10.0)
    words: tuple[str, ...] = setting((), 'words', fixed=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.low < self.high:
            raise ConfigError(f'low: {self.low} must lie below high ({self.high})')


@dataclass(frozen=True)
class Other(Settings):
    """Settings of the same node, of another class."""

    size: int = setting(3, 'size', low=1)


@dataclass
class Followed:
    """A node that follows two classes of settings."""

    node: Node
    busy: bool = False
    taken: list[Settings] = field(default_factory=list)

    def __post_init__(self) -> None:
        declare(self.node, Two, self.taken.append, self.check)
        declare(self.node, Other, self.taken.append)

    def check(self, two: Two) -> None:
        if self.busy:
            raise ConfigError('the node is busy')

    def set(self, **values: object) -> tuple[bool, str]:
        words = [Parameter(name, value=value) for name, value in values.items()]
        result = self.node.set_parameters_atomically(words)
        return result.successful, result.reason


@pytest.fixture
def followed(resident) -> Followed:
    return Followed(resident(lambda: Node('toy')))


def test_what_was_refused_has_no_effect_then_or_later(followed: Followed) -> None:
    followed.busy = True
    assert followed.set(high=5.0) == (False, 'the node is busy')
    followed.busy = False
    assert followed.set(low=1.5) == (True, '')
    assert followed.taken == [Two(low=1.5, high=2.0)]


def test_settings_of_two_classes_are_taken_together_or_not_at_all(followed: Followed) -> None:
    followed.busy = True
    assert not followed.set(size=4, high=5.0)[0]
    assert not followed.taken
    followed.busy = False
    assert followed.set(size=4, high=5.0)[0]
    assert followed.taken == [Two(high=5.0), Other(size=4)]
    refused, reason = followed.set(size=0)
    assert not refused
    assert 'below 1' in reason


def test_a_range_is_a_range_or_words_and_an_empty_list_is_empty(followed: Followed) -> None:
    low, high, words, size = followed.node.describe_parameters(['low', 'high', 'words', 'size'])
    assert not low.floating_point_range
    assert 'at least 0' in low.additional_constraints
    assert high.floating_point_range[0].to_value == 10.0
    assert words.read_only
    assert 'start' in words.additional_constraints
    assert 'at least 1' in size.additional_constraints
    assert not followed.node.get_parameter_or('words').value


def _taken(kind: type[Settings]) -> set[str]:
    return {item.name for item in fields(kind) if not item.metadata['fixed']}


#: Node -> parameters that a running node takes; each has an effect from then on.
LIVE = {
    'lateral_sensor': set(),
    'roller_speed': {'emergency_speed_mps', 'profile', 'slow_down_at_end'}
    | _taken(DriveLimits)
    | _taken(InterlockSettings),
    'rig_simulator': {'kick_m'},
    # With the next identification.
    'normal_form_identifier': {'on_close', 'lateral_range_m', 'rig_name'},
    'bag_recorder': {  # with the next recording
        'rig_name', 'operator', 'notes', 'prefix', 'split_s', 'split_mib', 'buffer_mib', 'chunk_s',
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
