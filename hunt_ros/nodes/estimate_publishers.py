"""The estimate topics: which columns of the detector's rows go where, and in which layout."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from geometry_msgs.msg import Vector3Stamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState

from hunt_ros.nodes.conversions import FixedLayout, joint_layout, vector_layout
from hunt_ros.nodes.qos import stream

_Column = str | Callable[[np.ndarray], np.ndarray]
#: publisher, layout, columns in it, zeros after them
_Output = tuple[Publisher, FixedLayout, tuple[_Column, ...], int]

#: Topics are looked at this often for somebody who listens, s.
_LOOK_S = 0.2


def _angular_frequency(rows: np.ndarray) -> np.ndarray:
    """Return 2 pi f, rad/s."""
    return 2.0 * np.pi * rows['frequency_hz']


def _margin_std(rows: np.ndarray) -> np.ndarray:
    """Return the standard deviation that a normal 95 % interval of this width would have."""
    return (rows['margin_high'] - rows['margin_low']) / (2.0 * 1.959964)


_AMPLITUDES = ('lateral_amplitude', 'yaw_amplitude')
_ENVELOPES = ('lateral_envelope', 'yaw_envelope')
_ROUGHNESS = ('lateral_roughness', 'yaw_roughness')

#: topic -> (joint names, columns of the positions, columns of the velocities)
_JOINTS: dict[str, tuple[tuple[str, ...], tuple[_Column, ...], tuple[_Column, ...]]] = {
    'hunting/amplitude': (
        _AMPLITUDES,
        _AMPLITUDES,
        ('lateral_amplitude_rate', 'yaw_amplitude_rate'),
    ),
    'hunting/amplitude_std': (
        _AMPLITUDES,
        ('lateral_amplitude_std', 'yaw_amplitude_std'),
        ('lateral_amplitude_rate_std', 'yaw_amplitude_rate_std'),
    ),
    'hunting/envelope': (_ENVELOPES, _ENVELOPES, ()),
    'hunting/roughness': (_ROUGHNESS, _ROUGHNESS, ()),
    'hunting/phase': (('hunting_phase',), ('phase',), (_angular_frequency,)),
}

#: topic -> column
_NUMBERS: dict[str, _Column] = {
    'hunting/growth_rate': 'growth_rate',
    'hunting/growth_rate_std': 'growth_rate_std',
    'hunting/margin': 'margin',
    'hunting/margin_std': _margin_std,
    'hunting/unstable_amplitude': 'unstable_amplitude',
    'hunting/unstable_amplitude_std': 'unstable_amplitude_std',
}


#: What a replay makes again from the measurements and the journal.
ESTIMATE_TOPICS: tuple[str, ...] = (*_JOINTS, *_NUMBERS)


class EstimatePublishers:
    """
    Publishes rows of estimates on the topics of the design, where somebody listens.

    Most of what the detector node costs is writing to the middleware; a topic that nobody
    has subscribed is left out. Who comes later hears it from `_LOOK_S` on at the latest.

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
        self._outputs: list[_Output] = []
        self._heard: list[_Output] = []
        self._look_at = 0.0
        for topic, (names, positions, velocities) in _JOINTS.items():
            publisher = node.create_publisher(JointState, topic, qos)
            layout = joint_layout(names, frame, velocity=bool(velocities))
            self._outputs.append((publisher, layout, positions + velocities, 0))
        for topic, column in _NUMBERS.items():
            publisher = node.create_publisher(Vector3Stamped, topic, qos)
            # the value stands in x; y and z are zero
            self._outputs.append((publisher, vector_layout(frame), (column,), 2))

    def publish(self, rows: np.ndarray) -> None:
        """Publish every row of the detector's estimates (`ESTIMATE_DTYPE`)."""
        now = time.monotonic()
        if now >= self._look_at:
            self._look_at = now + _LOOK_S
            self._heard = [out for out in self._outputs if out[0].get_subscription_count()]
        stamps = rows['stamp_ns'].tolist()
        zeros = [0.0] * len(stamps)
        for publisher, layout, columns, padding in self._heard:
            values = [_values(rows, column) for column in columns] + [zeros] * padding
            for stamp_ns, *numbers in zip(stamps, *values, strict=True):
                publisher.publish(layout.encode(stamp_ns, *numbers))


def _values(rows: np.ndarray, column: _Column) -> list[float]:
    values = rows[column] if isinstance(column, str) else column(rows)
    return values.tolist()
