"""
The driver `topic`: samples that another node already publishes, in any numeric field.

A lab with nodes of its own for its hardware needs no code here: `source` names topic and field as
`--channel` does for a recording, `/daq/ch0.data[3]*0.001`. The driver listens in a context of its
own, so that it is as any other driver: one thread opens it, waits in `read`, and closes it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from hunt_ros.bag import ChannelSource
from hunt_ros.bag.cdr.layout import joint_of, parse_path, usual_field
from hunt_ros.bag.cdr.message_types import standard_definitions
from hunt_ros.drivers.base import SensorBlock, SensorDriver
from hunt_ros.errors import BagError, ConfigError, DriverError, RefusedError
from hunt_ros.nodes.support.conversions import message_class, to_ns
from hunt_ros.nodes.support.hearing import waiting
from hunt_ros.nodes.support.worker import hidden_node
from hunt_ros.settings import Settings, setting

_LOOK_S, _WAIT_S = 0.05, 0.005
#: Its publisher is looked for so long, s.
_DISCOVERY_S = 1.0
#: Samples that may wait for the thread that reads.
_DEPTH = 5000


@dataclass(frozen=True)
class Topic(Settings):
    """A field of a topic."""

    source: str = setting('', 'Topic and field, as /daq/ch0.data[3]*0.001.')


class Sensor(SensorDriver):
    """A numeric field of a topic, stamped by its header or, without one, when it was sent."""

    Settings = Topic

    def __init__(self, settings: Topic, channel: str, rate_hz: float) -> None:
        super().__init__(settings, channel, rate_hz)
        try:
            self._source = ChannelSource.of(channel, settings.source or '-')
            if self._source.field and joint_of(self._source.field) is None:
                parse_path(self._source.field)
        except (BagError, ValueError) as error:
            raise ConfigError(f'source: {error}') from error
        if not self._source.source.startswith('/'):
            raise ConfigError(
                f'source: {settings.source!r} names no topic, expected /topic.field with the'
                ' full name of the topic'
            )

    def open(self) -> None:
        """Find the topic and listen; raises DriverError where there is none, or no such field."""
        self.handle = context = rclpy.Context()
        rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = hidden_node(f'_{self.channel}_source', context=context)
        kind_name = self._find_type()
        if (kind := message_class(kind_name)) is None:
            raise RefusedError(f'{self}: its type {kind_name} is not installed here')
        self._value = _reader(self._source, kind_name)
        # A best-effort subscription hears publishers of either kind.
        profile = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._heard = self._node.create_subscription(kind, self._source.topic, print, profile)

    def read(self, timeout_s: float) -> SensorBlock:
        """Wait for messages; raises DriverError where they have not the field."""
        self.opened()
        deadline_s = time.monotonic() + timeout_s
        while not (taken := list(waiting(self._heard))) and time.monotonic() < deadline_s:
            time.sleep(_WAIT_S)
        stamps = np.zeros(len(taken), dtype=np.int64)
        values = np.zeros(len(taken))
        for number, (message, info) in enumerate(taken):
            try:
                values[number] = float(self._value(message))
            except (AttributeError, LookupError, TypeError, ValueError) as error:
                raise DriverError(f'{self}: {type(message).__name__}: {error}') from error
            header = getattr(message, 'header', None)
            stamp_ns = to_ns(header.stamp) if header is not None else 0
            stamps[number] = stamp_ns or info['source_timestamp']
        return SensorBlock(stamps, values * self._source.scale + self._source.offset)

    def _release(self, handle: rclpy.Context) -> None:
        rclpy.shutdown(context=handle)

    def _find_type(self) -> str:
        """Return the type of the topic, once somebody publishes it."""
        deadline_s = time.monotonic() + _DISCOVERY_S
        topic = self._source.topic
        while time.monotonic() < deadline_s:
            publishers = self._node.get_publishers_info_by_topic(topic)
            if publishers:
                return publishers[0].topic_type
            time.sleep(_LOOK_S)
        raise DriverError(f'{self}: nobody publishes {topic}')

    def __str__(self) -> str:
        return f'topic {self._source.source}'


def _reader(source: ChannelSource, kind_name: str) -> Callable[[Any], float]:
    """Return what takes the number out of a message; without a field, the usual one."""
    text = source.field or usual_field(standard_definitions(), kind_name)
    if not text:
        raise RefusedError(
            f'topic {source.source}: {kind_name} has no usual field, expected /topic.field'
        )
    if (joint := joint_of(text)) is not None:
        field, name = joint
        return lambda message: getattr(message, field)[list(message.name).index(name)]

    steps = parse_path(text)

    def of_field(message: Any) -> float:
        """Follow the path of the field."""
        for step in steps:
            message = getattr(message, step) if isinstance(step, str) else message[step]
        return message

    return of_field
