"""
The node behind `hunt check`: listens to the channels of a rig for some seconds, and ends.

One line of JSON on standard output: of each channel the stamps (ns), when the messages came (ns),
the values, and who publishes it. It hears every publisher, whatever its quality of service.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from typing import Any

from rclpy.qos import ReliabilityPolicy

from hunt_ros.nodes.support.conversions import ChannelReader
from hunt_ros.nodes.support.diagnostics import steady_clock
from hunt_ros.nodes.support.hearing import waiting
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.parameters import declare
from hunt_ros.nodes.support.qos import MEASUREMENTS, stream
from hunt_ros.rig import of_rig
from hunt_ros.settings import Settings, setting

#: It finds the publishers in this time first, s.
_SETTLE_S = 2.0
_ROUND_S = 0.1


@dataclass(frozen=True)
class ListenerConfig(Settings):
    """Parameters of the listener."""

    channels: tuple[str, ...] = of_rig('channels')
    seconds: float = setting(
        10.0, 'How long it listens.', unit='s', low=0.1, high=3600.0, fixed=True
    )


class RigListenerNode(SuiteNode):
    """Listens, prints, and is done."""

    def __init__(self) -> None:
        super().__init__('rig_listener', alone=False)
        config = declare(self, ListenerConfig)
        self._inputs = {}
        self._heard: dict[str, dict[str, list[Any]]] = {}
        for channel in config.channels:
            reader = ChannelReader(channel)
            qos = stream(MEASUREMENTS)
            qos.reliability = ReliabilityPolicy.BEST_EFFORT
            subscription = self.create_polled_subscription(reader.kind, channel, qos, raw=True)
            self._inputs[channel] = subscription, reader
            self._heard[channel] = {'stamps_ns': [], 'arrivals_ns': [], 'values': []}
        self._begins = time.monotonic() + _SETTLE_S
        self._ends = self._begins + config.seconds
        self.create_timer(_ROUND_S, self._round, clock=steady_clock())

    def _round(self) -> None:
        """Take what has come; at the end print all of it."""
        now = time.monotonic()
        for channel, (subscription, reader) in self._inputs.items():
            for wire, info in waiting(subscription):
                sample = reader.read(wire)
                if sample is None or now < self._begins:
                    continue
                heard = self._heard[channel]
                heard['stamps_ns'].append(sample[0])
                heard['arrivals_ns'].append(info['received_timestamp'] or time.time_ns())
                heard['values'].append(sample[1])
        if now >= self._ends and not self.done:
            self.done = True
            print(json.dumps({name: self._told(name) for name in self._heard}), flush=True)

    def _told(self, channel: str) -> dict[str, Any]:
        """Return what was heard of a channel, and of whom."""
        topic = self._inputs[channel][0].topic_name
        names = sorted(
            f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            for info in self.get_publishers_info_by_topic(topic)
        )
        return {**self._heard[channel], 'topic': topic, 'publishers': names}


make_node = RigListenerNode
