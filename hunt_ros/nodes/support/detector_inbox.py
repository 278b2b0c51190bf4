"""What the detector node hears: the samples of every channel since it was asked last."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from geometry_msgs.msg import TwistStamped
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from hunt_ros.nodes.support.conversions import JointReader, SpeedReader
from hunt_ros.nodes.support.polled import Polling, waiting
from hunt_ros.nodes.support.qos import OVERRIDABLE, publisher_problem, stream

#: One second of the fastest sensor.
_DEPTH = 2000


class DetectorInbox:
    """
    Subscribes to the channels of the rig, as bytes, and takes their samples.

    Parameters
    ----------
    node : Polling
        Gets the subscriptions.
    channels : sequence of str
        Topics: the names of the channels.

    Attributes
    ----------
    received, unreadable : int
        Samples handed over; messages without the expected joint.
    """

    def __init__(self, node: Polling, channels: Sequence[str]) -> None:
        self.received = 0
        self.unreadable = 0
        self._node = node
        self._inputs: list[tuple[str, JointReader | SpeedReader, Subscription]] = []
        for channel in channels:
            kind, reader = JointState, JointReader(channel)
            if channel == 'speed':
                kind, reader = TwistStamped, SpeedReader()
            subscription = node.create_polled_subscription(
                kind, channel, stream(_DEPTH), raw=True, qos_overriding_options=OVERRIDABLE
            )
            self._inputs.append((channel, reader, subscription))

    def problem(self) -> str:
        """Return what is wrong with the publishers of the channels, and what to do; or ''."""
        found = (publisher_problem(self._node, subscription) for *_, subscription in self._inputs)
        return '; '.join(filter(None, found))

    def clear(self) -> None:
        """Forget what has come."""
        for *_, subscription in self._inputs:
            for _ in waiting(subscription):
                pass

    def take(self) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """Hand over what has come: channel, stamps (ns), values."""
        for channel, reader, subscription in self._inputs:
            samples = [reader.read(wire) for wire, _ in waiting(subscription)]
            readable = [sample for sample in samples if sample is not None]
            self.unreadable += len(samples) - len(readable)
            self.received += len(readable)
            if readable:
                stamps, values = zip(*readable, strict=True)
                yield channel, np.array(stamps, dtype=np.int64), np.array(values)
