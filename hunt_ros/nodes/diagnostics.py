"""Every node's own health on `/diagnostics`, once a second, on the steady clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from hunt_ros.nodes.conversions import diagnostic
from hunt_ros.nodes.qos import STATUS

#: (level, one line, values)
Health = tuple[str, str, Mapping[str, object]]


class Diagnostics:
    """
    Publishes a node's health at 1 Hz of real time, also when the simulated clock stands.

    Parameters
    ----------
    node : Node
        Whose health it is.
    health : callable
        Returns level ('OK', 'WARN', 'ERROR', 'STALE'), one line, and values.
    """

    def __init__(self, node: Node, health: Callable[[], Health]) -> None:
        self._node = node
        self._health = health
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', STATUS)
        self._timer = node.create_timer(1.0, self._publish, clock=steady_clock())

    def _publish(self) -> None:
        level, text, values = self._health()
        now_ns = self._node.get_clock().now().nanoseconds
        name = self._node.get_fully_qualified_name().lstrip('/')
        self._publisher.publish(diagnostic(now_ns, name, level, text, values))


def steady_clock() -> Clock:
    """Return a clock that no one can set."""
    return Clock(clock_type=ClockType.STEADY_TIME)
