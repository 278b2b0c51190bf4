"""
The two qualities of service of the suite.

No deadline and no liveliness is requested: a subscription that asks for a
deadline hears nothing at all from a publisher that offers none.
"""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def stream(depth: int) -> QoSProfile:
    """Reliable, keep-last `depth`: one second of the topic's messages."""
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


#: Events are rare and none may be lost.
EVENTS = stream(1000)
#: `diagnostics` and `hunting/status`.
STATUS = stream(20)
