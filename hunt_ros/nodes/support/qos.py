"""
The topics of the suite, the two qualities of service, and what a user may change about them.

No deadline and no liveliness is requested: a subscription that asks for a
deadline hears nothing at all from a publisher that offers none.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from hunt_ros.nodes.support.conversions import message_class
from hunt_ros.sensors import CHANNEL_FIELDS, TWIST_STAMPED


def stream(depth: int) -> QoSProfile:
    """Reliable, keep-last `depth`: one second or more of the topic's messages."""
    return QoSProfile(depth=max(1, depth), reliability=ReliabilityPolicy.RELIABLE)


def latched(depth: int = 1) -> QoSProfile:
    """Reliable, transient local: whoever comes late gets the last `depth` messages."""
    profile = stream(depth)
    profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return profile


#: Depth of the measurements: what a reader missed is sent again while the writer still has it. At
#: least a second at the highest rate, also of a rig that is simulated faster than real time.
MEASUREMENTS = 4000
#: What is published 20 times a second or less: 5 s, because what a reader missed is sent again
#: after a heartbeat, if it is still there: every 0.05 s by `fast_dds.xml`, 3 s else.
STATUS = stream(100)
#: Events are rare and none may be lost.
EVENTS = stream(1000)
_DIAGNOSTIC, _STRING = 'diagnostic_msgs/msg/DiagnosticArray', 'std_msgs/msg/String'
#: Topic -> type of its messages, and quality of service.
TOPICS: dict[str, tuple[str, QoSProfile]] = {
    **{channel: (kind, stream(MEASUREMENTS)) for channel, (kind, _) in CHANNEL_FIELDS.items()},
    'speed/target': (TWIST_STAMPED, STATUS),
    'speed/status': (_DIAGNOSTIC, latched()),
    'hunting/status': (_DIAGNOSTIC, STATUS),
    'hunting/events': (_DIAGNOSTIC, EVENTS),
    'hunting/alarms': (_STRING, latched()),
    'hunting/normal_form': (_STRING, latched()),
    #: What the detector was told, for who comes late: the start of a replay stands in it.
    'hunting/journal': (_STRING, latched(1000)),
    'recording/mark': (_STRING, stream(10)),
    'recording/closed': (_STRING, latched()),
    'parameters': (_STRING, latched()),
    '/diagnostics': (_DIAGNOSTIC, STATUS),
    '/rosout': ('rcl_interfaces/msg/Log', latched(100)),
    '/clock': ('rosgraph_msgs/msg/Clock', stream(100)),
}
#: For measurements, which foreign nodes may publish with the profile of sensor data: the
#: parameters `qos_overrides.TOPIC.subscription.reliability` and `.depth`.
OVERRIDABLE = QoSOverridingOptions(policy_kinds=(QoSPolicyKind.RELIABILITY, QoSPolicyKind.DEPTH))


def announce(node: Node, topic: str) -> Publisher:
    """Return a publisher of one of `TOPICS`."""
    kind, quality = TOPICS[topic]
    return node.create_publisher(message_class(kind), topic, quality)


def hear(node: Node, topic: str, take: Callable[[Any], None]) -> None:
    """Have the messages of one of `TOPICS` taken."""
    kind, quality = TOPICS[topic]
    node.create_subscription(message_class(kind), topic, take, quality)
