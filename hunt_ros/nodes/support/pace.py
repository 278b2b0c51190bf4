"""
How far simulated time may run ahead of those who follow it.

A machine that is slow, or has other work, cannot follow a rig at any multiple of real time:
samples would be lost between processes, and the run would show silence and faults that no rig
had. Simulated time therefore waits for the detector, which is the last of the chain.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from hunt_ros.nodes.support.conversions import to_ns
from hunt_ros.nodes.support.qos import STATUS
from hunt_ros.samples import NANOSECONDS

#: Below the time after which the detector calls a sensor silent where time runs fast: a pause of
#: the machine is then a longer one of the rig (`hunt demo` sets its `..._timeout_s` to 3 s).
_LEAD_NS = NANOSECONDS
#: A detector that makes no headway for so long, because a sensor is dead or it is itself, is
#: not waited for, s of real time.
_PATIENCE_S = 5.0


class Pace:
    """
    Compares simulated time with the newest estimate of the detector, once that is heard.

    Before its first estimate the time counts at which it was first heard: samples that come to
    it by several ways must not be seconds of the rig apart when it begins.

    Parameters
    ----------
    node : Node
        Gets the subscription to `hunting/status`.
    clock : callable, optional
        Real time, s.

    Attributes
    ----------
    heard : bool
        True once the detector has said anything.
    """

    def __init__(self, node: Node, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self.heard = False
        self._judged_ns = 0
        self._progress_s = clock()
        self._subscription = node.create_subscription(
            DiagnosticArray, 'hunting/status', self._on_status, STATUS
        )

    def must_wait(self, now_ns: int) -> bool:
        """Return True if simulated time `now_ns` is as far ahead as it may be."""
        if not self.heard:
            return False
        if not self._judged_ns:
            self._judged_ns, self._progress_s = now_ns, self._clock()
        if now_ns - self._judged_ns < _LEAD_NS:
            return False
        return self._clock() - self._progress_s < _PATIENCE_S

    def _on_status(self, message: DiagnosticArray) -> None:
        self.heard = True
        judged_ns = to_ns(message.header.stamp)
        if judged_ns and judged_ns != self._judged_ns:
            self._judged_ns, self._progress_s = judged_ns, self._clock()
