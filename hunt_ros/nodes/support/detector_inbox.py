"""What the detector node hears: the samples of every channel since it was asked last."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from rclpy.subscription import Subscription

from hunt_ros.nodes.support.conversions import JointReader, SpeedReader, channel_reader
from hunt_ros.nodes.support.polled import Missed, Polling, waiting
from hunt_ros.nodes.support.qos import MEASUREMENTS, OVERRIDABLE, publisher_problem, stream

#: Sensor nodes that start together have all begun to publish this long after the first, s.
_TOGETHER_S = 5.0


class DetectorInbox:
    """
    Subscribes to the channels of the rig, as bytes, and takes their samples.

    It begins when all of them are there: a sensor that starts a second after another one is not
    silent. What is missing `_TOGETHER_S` after the first is not waited for.

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
    missed : dict of str to Missed
        By channel: the messages that were lost on their way here.
    """

    def __init__(self, node: Polling, channels: Sequence[str]) -> None:
        self.received = 0
        self.unreadable = 0
        self._node = node
        self.missed: dict[str, Missed] = {}
        self._inputs: list[tuple[str, JointReader | SpeedReader, Subscription]] = []
        for channel in channels:
            kind, reader = channel_reader(channel)
            subscription = node.create_polled_subscription(
                kind, channel, stream(MEASUREMENTS), raw=True, qos_overriding_options=OVERRIDABLE
            )
            self._inputs.append((channel, reader, subscription))
            publishers = partial(node.count_publishers, subscription.topic_name)
            self.missed[channel] = Missed(publishers)
        self._began_s: float | None = None
        self._absent = set(channels)

    def begun(self) -> bool:
        """Return True once samples are handed over; those of before are left out."""
        if not self._absent:
            return True
        for channel, _, subscription in self._inputs:
            if [None for _ in waiting(subscription)]:
                self._absent.discard(channel)
                self._began_s = self._began_s or time.monotonic()
        if self._began_s is not None and time.monotonic() - self._began_s > _TOGETHER_S:
            self._absent.clear()
        return not self._absent

    def problem(self) -> str:
        """Return what is wrong with the publishers of the channels, and what to do; or ''."""
        found = (publisher_problem(self._node, subscription) for *_, subscription in self._inputs)
        return '; '.join(filter(None, found))

    def clear(self) -> None:
        """Forget what has come, and begin anew."""
        self._began_s, self._absent = None, {channel for channel, *_ in self._inputs}
        for channel, _, subscription in self._inputs:
            for _ in waiting(subscription):
                pass
            self.missed[channel].restart()

    def take(self) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """Hand over what has come: channel, stamps (ns), values."""
        for channel, reader, subscription in self._inputs:
            samples = []
            for wire, info in waiting(subscription):
                self.missed[channel].take(info)
                samples.append(reader.read(wire))
            readable = [sample for sample in samples if sample is not None]
            self.unreadable += len(samples) - len(readable)
            self.received += len(readable)
            if readable:
                stamps, values = zip(*readable, strict=True)
                yield channel, np.array(stamps, dtype=np.int64), np.array(values)
