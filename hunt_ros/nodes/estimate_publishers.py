"""The estimate topics: which columns of the detector's rows go where, and in which layout."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import Vector3Stamped
from rclpy.node import Node
from sensor_msgs.msg import JointState

from hunt_ros.nodes.conversions import FixedLayout, joint_layout, vector_layout
from hunt_ros.nodes.qos import stream

#: topic -> (joint names, columns of the positions, columns of the velocities)
_JOINTS: dict[str, tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]] = {
    'hunting/amplitude': (
        ('lateral_amplitude', 'yaw_amplitude'),
        ('lateral_amplitude', 'yaw_amplitude'),
        ('lateral_amplitude_rate', 'yaw_amplitude_rate'),
    ),
    'hunting/amplitude_std': (
        ('lateral_amplitude', 'yaw_amplitude'),
        ('lateral_amplitude_std', 'yaw_amplitude_std'),
        ('lateral_amplitude_rate_std', 'yaw_amplitude_rate_std'),
    ),
    'hunting/envelope': (
        ('lateral_envelope', 'yaw_envelope'),
        ('lateral_envelope', 'yaw_envelope'),
        (),
    ),
    'hunting/roughness': (
        ('lateral_roughness', 'yaw_roughness'),
        ('lateral_roughness', 'yaw_roughness'),
        (),
    ),
    'hunting/phase': (('hunting_phase',), ('phase',), ('angular_frequency',)),
}

#: topic -> column, each with its standard deviation on a topic of its own
_NUMBERS: dict[str, str] = {
    'hunting/growth_rate': 'growth_rate',
    'hunting/margin': 'margin',
    'hunting/unstable_amplitude': 'unstable_amplitude',
    'hunting/critical_speed': 'critical_speed',
}


class EstimatePublishers:
    """
    Publishes rows of estimates on the topics of the design.

    Parameters
    ----------
    node : Node
        Gets the publishers.
    rate_hz : float
        Rate of the rows: the topics keep one second of them.
    frame : str
        frame_id of the messages.
    """

    def __init__(self, node: Node, rate_hz: float, frame: str) -> None:
        qos = stream(int(rate_hz))
        self._outputs: list[tuple[object, FixedLayout, tuple[str, ...], int]] = []
        for topic, (names, positions, velocities) in _JOINTS.items():
            publisher = node.create_publisher(JointState, topic, qos)
            layout = joint_layout(names, frame, velocity=bool(velocities))
            self._outputs.append((publisher, layout, positions + velocities, 0))
        for topic, column in _NUMBERS.items():
            for suffix in ('', '_std'):
                publisher = node.create_publisher(Vector3Stamped, topic + suffix, qos)
                # value in x; y and z are zero
                self._outputs.append((publisher, vector_layout(frame), (column + suffix,), 2))

    def publish(self, rows: np.ndarray) -> None:
        """Publish every row, a structured array with `stamp_ns` and the columns above."""
        stamps = rows['stamp_ns'].tolist()
        for publisher, layout, columns, zeros in self._outputs:
            values = [rows[column].tolist() for column in columns] + [[0.0] * len(rows)] * zeros
            for stamp_ns, *numbers in zip(stamps, *values, strict=True):
                publisher.publish(layout.encode(stamp_ns, *numbers))
