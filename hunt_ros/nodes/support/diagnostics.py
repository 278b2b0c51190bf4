"""What a node says on `/diagnostics`, once a second, on the steady clock: first its own health."""

from __future__ import annotations

import socket
import time
import traceback
from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from hunt_ros.errors import HuntError, one_line
from hunt_ros.nodes.support.conversions import diagnostic
from hunt_ros.nodes.support.qos import announce
from hunt_ros.suite import START_S, Awaited

#: (level, one line, values)
Health = tuple[str, str, Mapping[str, object]]


class Diagnostics:
    """
    Publishes a node's health at 1 Hz of real time, also when the simulated clock stands.

    A change of level is logged as well. A level that is `Awaited` is OK for the first `START_S`:
    the node is starting. Two things stand above what it says of
    itself: a task of it that failed, and another node of its name in the ROS domain. A node
    that judges something beside itself, as the detector does the motion, says so in a status
    of its own, in the same message and behind its health.

    Parameters
    ----------
    node : Node
        Whose health it is.
    health : callable
        Returns level ('OK', 'WARN', 'ERROR', 'STALE'), one line, and values.
    published : bool
        False: nothing is published, and only the log has what failed.

    Attributes
    ----------
    hardware : str
        What the node talks to; the computer it runs on, unless it says so.
    told : bool
        Set it where the node has logged what changes the level of what it judges, with the
        cause: the change is not logged a second time.
    namesake : bool
        Another node of this name has been seen, at the last look.
    """

    def __init__(self, node: Node, health: Callable[[], Health], published: bool = True) -> None:
        self._node = node
        self._health = health
        self.hardware = socket.gethostname()
        self._beside: dict[str, tuple[Callable[[], Health], str]] = {}
        self._levels: dict[str, str] = {}
        self._began_s = time.monotonic()
        self.told = self.namesake = False
        self._failures: dict[str, str] = {}
        if published:
            self._publisher = announce(node, '/diagnostics')
            node.create_timer(1.0, self.publish, clock=steady_clock())

    @property
    def starting(self) -> bool:
        """True while the node may still be waiting for its neighbours."""
        return time.monotonic() - self._began_s < START_S

    def judge(self, what: str, health: Callable[[], Health], hardware: str) -> None:
        """Say more: a status with the name `what`, in the node's namespace, about `hardware`."""
        self._beside[what] = health, hardware

    def failed(self, task: str, error: Exception) -> None:
        """Say from now on that a task failed (in any thread); the log has what nobody expected."""
        before, reason = self._failures.get(task), one_line(error)
        self._failures[task] = reason
        expected = isinstance(error, HuntError | OSError)
        trace = '' if expected else '\n' + ''.join(traceback.format_exception(error))
        if reason != before:
            self._node.get_logger().error(f'{task}: {reason}{trace}')

    def done(self, task: str) -> None:
        """Say no longer that a task failed: it has been done since."""
        self._failures.pop(task, None)

    def publish(self) -> None:
        """Say it now; it is said once a second anyway."""
        name = self._node.get_fully_qualified_name()
        now_ns = self._node.get_clock().now().nanoseconds
        message = self._said(now_ns, name, self._own_health(name), self.hardware)
        for what, (health, hardware) in self._beside.items():
            beside = f'{self._node.get_namespace().rstrip("/")}/{what}'
            said = self._said(now_ns, beside, health(), hardware, self.told)
            message.status.extend(said.status)
        self.told = False
        self._publisher.publish(message)

    def _own_health(self, name: str) -> Health:
        """Return what the node says of itself, below what stands above it."""
        level, text, values = self._health()
        if isinstance(level, Awaited) and self.starting:
            level, text = 'OK', f'starting: {text}'
        problems = [f'{task} failed: {why}' for task, why in list(self._failures.items())]
        self.namesake = self._namesakes(name) > 1
        if self.namesake:
            problems.append(f'another node is named {name} in this ROS domain')
        if problems:
            said = [] if level == 'OK' else [text]
            level, text = 'ERROR', '; '.join(problems + said)
        return level, text, values

    def _said(
        self,
        now_ns: int,
        name: str,
        health: Health,
        hardware: str,
        told: bool = False,
    ) -> DiagnosticArray:
        """Return a health as a message; log it where its level has changed, if nobody has."""
        level, text, values = health
        before = self._levels.get(name, 'OK')
        if not (isinstance(level, Awaited) and self.starting):
            self._levels[name] = level
            if level != before and not told:
                log(self._node, level, f'{level} (was {before}): {text}')
        return diagnostic(now_ns, name.lstrip('/'), level, text, values, hardware)

    def _namesakes(self, name: str) -> int:
        """Return how many nodes of the graph have this full name."""
        nodes = self._node.get_node_names_and_namespaces()
        return sum(f'{namespace.rstrip("/")}/{each}' == name for each, namespace in nodes)


def log(node: Node, level: str, line: str) -> None:
    """Write a line of the log; rclpy wants each severity in a place of its own."""
    logger = node.get_logger()
    if level == 'ERROR':
        logger.error(line)
    elif level == 'OK':
        logger.info(line)
    else:
        logger.warning(line)


class NewSince:
    """How much a running total has grown since it was asked for last."""

    def __init__(self) -> None:
        self._before: dict[str, int] = {}

    def __call__(self, name: str, total: int) -> int:
        """Return the growth of the total `name`."""
        before, self._before[name] = self._before.get(name, 0), total
        return total - before


def steady_clock() -> Clock:
    """Return a clock that no one can set."""
    return Clock(clock_type=ClockType.STEADY_TIME)
