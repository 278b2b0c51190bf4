"""The estimate topics: one table, at most eight of them, values with their deviation."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from hunt_ros.detection.output import ESTIMATE_DTYPE
from hunt_ros.nodes.support.conversions import to_ns
from hunt_ros.nodes.support.estimate_publishers import ESTIMATES, EstimatePublishers
from hunt_ros.samples import CHANNELS

TOPICS = Path(__file__).parents[3] / 'docs' / 'topics.md'


class _Node:
    """Collects what is published, with one listener on every topic."""

    def __init__(self) -> None:
        self.heard: dict[str, list[JointState]] = defaultdict(list)

    def create_publisher(self, kind, name, qos):
        return _Publisher(self.heard[name])


class _Publisher:
    def __init__(self, heard: list[JointState]) -> None:
        self._heard = heard

    def get_subscription_count(self) -> int:
        return 1

    def publish(self, wire: bytes) -> None:
        self._heard.append(deserialize_message(wire, JointState))


def _rows(first: int, count: int) -> np.ndarray:
    rows = np.zeros(count, dtype=ESTIMATE_DTYPE)
    rows['stamp_ns'] = (first + 1 + np.arange(count)) * 10_000_000
    rows['lateral_amplitude'], rows['yaw_amplitude'] = 1e-3, 2e-3
    rows['lateral_amplitude_rate'], rows['lateral_amplitude_std'] = 3e-3, 4e-6
    rows['growth_rate'], rows['growth_rate_std'] = np.arange(first, first + count), 0.5
    return rows


@pytest.mark.parametrize('block', [1, 7, 100])
def test_a_value_its_rate_and_its_deviation_are_one_message(block) -> None:
    node = _Node()
    publishers = EstimatePublishers(node, 100.0)
    publishers.beside |= {'critical_speed': 8.0, 'critical_speed_std': 0.1}
    for first in range(0, 100, block):
        publishers.publish(_rows(first, min(block, 100 - first)))
    amplitude, growth = node.heard['hunting/amplitude'], node.heard['hunting/growth_rate']
    assert list(amplitude[0].name) == ['lateral_amplitude', 'yaw_amplitude']
    assert list(amplitude[0].position) == [1e-3, 2e-3]
    assert list(amplitude[0].velocity) == [3e-3, 0.0]
    assert list(amplitude[0].effort) == [4e-6, 0.0]
    assert list(growth[-1].effort) == [0.5]
    speed = node.heard['hunting/critical_speed'][0]
    assert (list(speed.position), list(speed.effort)) == ([8.0], [0.1])
    assert [to_ns(m.header.stamp) for m in amplitude] == [10**7 * k for k in range(1, 101)]
    slow = [to_ns(m.header.stamp) for m in growth]
    assert slow[1:] == [50_000_000 * k for k in range(1, 21)], 'the grid does not hang on blocks'


def test_there_are_at_most_eight_and_no_joint_is_that_of_a_measurement() -> None:
    assert len(ESTIMATES) <= 8
    names = [joint for topic in ESTIMATES for joint in topic.joints]
    assert len(set(names)) == len(names)
    assert not set(names) & set(CHANNELS)


@pytest.mark.parametrize('topic', ESTIMATES)
def test_the_page_of_the_topics_says_what_it_holds_and_how_often(topic) -> None:
    (row,) = (r for r in TOPICS.read_text().splitlines() if r.startswith(f'| `{topic.name}` |'))
    says = [f'`{word}`' in row for word in ('velocity', 'effort', 'output_rate_hz')]
    assert says == [topic.rate, topic.std, topic.fast]
    assert row.endswith('20 Hz |') != topic.fast
