"""
The node behind `hunt check`: listens to the channels of a rig for some seconds, and ends.

One line of JSON on standard output: of each channel the stamps (ns), when the messages came (ns),
the values, and who publishes it. It hears every publisher, whatever its quality of service.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass

from rclpy.qos import ReliabilityPolicy

from hunt_ros.nodes.support.diagnostics import steady_clock
from hunt_ros.nodes.support.hearing import Channels
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
    seconds: float = setting(10.0, 'How long it listens.', unit='s', low=0.1, high=3600.0)


class RigListenerNode(SuiteNode):
    """Listens, prints, and is done."""

    def __init__(self) -> None:
        super().__init__('rig_listener', alone=False)
        config = declare(self, ListenerConfig)
        every_publisher = stream(MEASUREMENTS)
        every_publisher.reliability = ReliabilityPolicy.BEST_EFFORT
        self._inbox = Channels(self, config.channels, every_publisher)
        self._heard: dict[str, dict[str, list[float]]] = {
            name: {'stamps_ns': [], 'arrivals_ns': [], 'values': []} for name in config.channels
        }
        self._begins = time.monotonic() + _SETTLE_S
        self._ends = self._begins + config.seconds
        self.create_timer(_ROUND_S, self._round, clock=steady_clock())

    def _round(self) -> None:
        """Take what has come; at the end print all of it."""
        now = time.monotonic()
        for channel, stamps_ns, values, came_ns in self._inbox.take():
            if now >= self._begins:
                heard = self._heard[channel]
                heard['stamps_ns'] += stamps_ns.tolist()
                heard['arrivals_ns'] += came_ns
                heard['values'] += values.tolist()
        if now >= self._ends and not self.done:
            self.done = True
            told = {}
            for name, heard in self._heard.items():
                topic, publishers = self._inbox.publishers(name)
                told[name] = {**heard, 'topic': topic, 'publishers': publishers}
            print(json.dumps(told), flush=True)


make_node = RigListenerNode
