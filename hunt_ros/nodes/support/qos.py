"""
The two qualities of service of the suite, and what a user may change about them.

No deadline and no liveliness is requested: a subscription that asks for a
deadline hears nothing at all from a publisher that offers none.
"""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions


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
#: Events are rare and none may be lost.
EVENTS = stream(1000)
#: What the detector was told, for who comes late: the start of a replay stands in it.
JOURNAL = latched(1000)
#: `/diagnostics`, `hunting/status` and `speed/target`: 5 s at 20 Hz, because what a reader missed
#: is sent again after a heartbeat, if it is still there: every 0.05 s by `fast_dds.xml`, 3 s else.
STATUS = stream(100)
#: For measurements, which foreign nodes may publish with the profile of sensor data: the
#: parameters `qos_overrides.TOPIC.subscription.reliability` and `.depth`.
OVERRIDABLE = QoSOverridingOptions(policy_kinds=(QoSPolicyKind.RELIABILITY, QoSPolicyKind.DEPTH))
