"""
The two qualities of service of the suite, and what a user may change about them.

No deadline and no liveliness is requested: a subscription that asks for a
deadline hears nothing at all from a publisher that offers none.
"""

from __future__ import annotations

from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription


def stream(depth: int) -> QoSProfile:
    """Reliable, keep-last `depth`: one second or more of the topic's messages."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=max(1, depth),
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
    )


def latched(depth: int = 1) -> QoSProfile:
    """Reliable, transient local: whoever comes late gets the last `depth` messages."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


#: Depth of the measurements: what a reader missed is sent again while the writer still has it. At
#: least a second at the highest rate, also of a rig that is simulated faster than real time.
MEASUREMENTS = 4000
#: Events are rare and none may be lost.
EVENTS = stream(1000)
#: What the detector was told, for who comes late: the start of a replay stands in it.
JOURNAL = latched(1000)
#: `/diagnostics`, `hunting/status` and `speed/target`: 5 s at 20 Hz, because what a reader missed
#: is sent again after the heartbeat of its writer, every 3 s by default, if it is still there.
STATUS = stream(100)
#: For measurements, which foreign nodes may publish with the profile of sensor data: the
#: parameters `qos_overrides.TOPIC.subscription.reliability` and `.depth`.
OVERRIDABLE = QoSOverridingOptions(policy_kinds=(QoSPolicyKind.RELIABILITY, QoSPolicyKind.DEPTH))


def publisher_problem(node: Node, subscription: Subscription) -> str:
    """
    Return one line where a measurement has several publishers, or one that cannot be heard.

    Parameters
    ----------
    node : Node
        Whose subscription it is.
    subscription : Subscription
        Of a topic that somebody may publish with best effort.

    Returns
    -------
    str
        Names the topic, and what helps; '' where one publisher is heard, or none is there.
    """
    topic = subscription.topic_name
    publishers = node.get_publishers_info_by_topic(topic)
    if len(publishers) > 1:
        names = sorted(f'{p.node_namespace.rstrip("/")}/{p.node_name}' for p in publishers)
        return (
            f'{topic} has {len(names)} publishers ({", ".join(names)}), expected one: end the'
            ' others, or give the second rig another namespace'
        )
    if subscription.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT:
        return ''
    for info in publishers:
        if info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT:
            return (
                f'{topic} is published with best effort and not heard: set the parameter'
                f' qos_overrides.{topic}.subscription.reliability to best_effort'
            )
    return ''
