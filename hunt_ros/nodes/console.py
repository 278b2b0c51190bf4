"""
What the command line sees of a running rig: lines of JSON out, commands in.

Every line on standard output is one object with the key `topic`; every line on
standard input is the name of a Trigger service to call. So the command line
itself needs no ROS.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.client import Client
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from hunt_ros.nodes.support.conversions import read_diagnostic, to_ns
from hunt_ros.nodes.support.hidden_node import hidden_node
from hunt_ros.nodes.support.qos import EVENTS, STATUS, latched
from hunt_ros.services import KEYS, SERVICES

#: Orders are looked for so often, and the services that they name for so long, s.
_ROUND_S, _SOUGHT_S = 0.02, 5.0
#: A status is printed so often at most, unless what is in force changes, s.
_STATUS_S = 0.1
#: Answers come in another thread than what is heard, and two lines in one are none.
_WRITING = threading.Lock()
#: What is in force.
_IN_FORCE = ('level', 'state', 'alarm', 'emergency_stop', 'interlock_state', 'profile_state')


class ConsoleNode(Node):
    """Prints statuses, events, health, normal forms and closed recordings; calls services."""

    def __init__(self) -> None:
        super().__init__('console')
        self._printed: dict[str, tuple[float, list[str | None]]] = {}
        for topic, quality, take in (
            ('hunting/events', EVENTS, self._print),
            ('hunting/status', STATUS, self._print_at_times),
            ('speed/status', latched(), self._print_at_times),
            ('/diagnostics', EVENTS, self._print),
        ):
            self.create_subscription(DiagnosticArray, topic, partial(take, topic), quality)
        for topic in ('hunting/normal_form', 'recording/closed'):
            self.create_subscription(String, topic, partial(_print_text, topic), latched())
        Caller(self.get_namespace())

    def _print_at_times(self, topic: str, message: DiagnosticArray) -> None:
        """Print a status unless one that says the same was printed just now."""
        told = read_diagnostic(message)
        now, in_force = time.monotonic(), [told.get(name) for name in _IN_FORCE]
        at, before = self._printed.get(topic, (0.0, []))
        if in_force != before or now - at >= _STATUS_S:
            self._printed[topic] = now, in_force
            self._print(topic, message)

    def _print(self, topic: str, message: DiagnosticArray) -> None:
        stamp_ns = to_ns(message.header.stamp)
        _write({'topic': topic, 'stamp_ns': stamp_ns, **read_diagnostic(message)})


def _print_text(topic: str, message: String) -> None:
    _write({'topic': topic, 'data': message.data})


class Caller:
    """
    Calls the Trigger services that standard input names, and prints the answers.

    In a thread, with the plain executor: clients do not get on with the EventsExecutor. The
    services of the operator's keys are looked for at once, so that an emergency stop does not wait
    for its discovery, and no call waits for the answer of another one.

    Parameters
    ----------
    namespace : str
        Of the rig.
    """

    def __init__(self, namespace: str) -> None:
        self._node = hidden_node('console_calls', namespace)
        self._clients: dict[str, Client] = {}
        self._orders: SimpleQueue[str] = SimpleQueue()
        #: Service, and until when it is looked for.
        self._sought: list[tuple[str, float]] = []
        for word in KEYS.values():
            self._client(SERVICES[word].name)
        threading.Thread(target=self._read, daemon=True).start()
        threading.Thread(target=self._work, daemon=True).start()

    def _client(self, name: str) -> Client:
        if name not in self._clients:
            self._clients[name] = self._node.create_client(Trigger, name)
        return self._clients[name]

    def _read(self) -> None:
        for line in sys.stdin:
            if name := line.strip():
                self._orders.put(name)

    def _work(self) -> None:
        executor = SingleThreadedExecutor()
        executor.add_node(self._node)
        try:
            while True:
                executor.spin_once(timeout_sec=_ROUND_S)
                self._round()
        except ExternalShutdownException:
            pass

    def _round(self) -> None:
        """Send what is ordered to the services that are there."""
        with suppress(Empty):
            while True:
                self._sought.append((self._orders.get_nowait(), time.monotonic() + _SOUGHT_S))
        left = []
        for name, until in self._sought:
            client = self._client(name)
            if client.service_is_ready():
                asked = client.call_async(Trigger.Request())
                asked.add_done_callback(partial(_answered, name))
            elif time.monotonic() < until:
                left.append((name, until))
            else:
                _answer(name, False, 'no such service')
        self._sought = left


def _answered(name: str, future: Future) -> None:
    _answer(name, future.result().success, future.result().message)


def _answer(name: str, ok: bool, message: str) -> None:
    _write({'topic': 'answer', 'service': name, 'ok': ok, 'message': message})


def _write(document: dict[str, object]) -> None:
    with _WRITING:
        print(json.dumps(document), flush=True)


make_node = ConsoleNode
