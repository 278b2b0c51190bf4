"""
How far simulated time may run ahead of those who follow it.

A machine that is slow, or has other work, cannot follow a rig at any multiple of real time:
samples would be lost between processes, and the run would show silence and faults that no rig
had. Simulated time therefore waits for the detector, which is the last of the chain. It never
stands still: the detector may wait in its turn for samples that come only as time goes on.
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
#: A detector that makes no headway for so long is dead, s of real time: a busy machine may take a
#: minute for its turn. Until then time goes on by this share of real time: in that minute by the
#: 2 s that are left of the 3 s.
_DEAD_S, _CREEP = 60.0, 1.0 / 30.0


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
        waited_s = self._clock() - self._progress_s
        ahead_ns = _LEAD_NS + _CREEP * waited_s * NANOSECONDS
        return waited_s < _DEAD_S and now_ns - self._judged_ns >= ahead_ns

    def _on_status(self, message: DiagnosticArray) -> None:
        self.heard = True
        judged_ns = to_ns(message.header.stamp)
        if judged_ns and judged_ns != self._judged_ns:
            self._judged_ns, self._progress_s = judged_ns, self._clock()
