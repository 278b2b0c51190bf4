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
from dataclasses import dataclass
from functools import partial
from queue import Empty, SimpleQueue

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.client import Client
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from hunt_ros.nodes.conversions import read_diagnostic, to_ns
from hunt_ros.nodes.parameters import declare
from hunt_ros.nodes.qos import EVENTS, STATUS, latched
from hunt_ros.services import KEYS, SERVICES
from hunt_ros.settings import Settings, setting

#: Orders are looked for so often, and the services that they name for so long, s.
_ROUND_S, _SOUGHT_S = 0.02, 5.0


@dataclass(frozen=True)
class ConsoleConfig(Settings):
    """Parameters of the console."""

    status_every: int = setting(
        4, 'Print every n-th status (20 Hz).', low=1, high=1000, fixed=True
    )
    follow: str = setting('', 'Node whose health is printed every time.', fixed=True)


class ConsoleNode(Node):
    """Prints events, statuses, normal forms and closed recordings; calls services."""

    def __init__(self) -> None:
        super().__init__('console')
        config = declare(self, ConsoleConfig)
        self._every, self._follow = config.status_every, config.follow
        self._count = 0
        self.create_subscription(DiagnosticArray, 'hunting/events', self._on_event, EVENTS)
        self.create_subscription(DiagnosticArray, 'hunting/status', self._on_status, STATUS)
        for topic in ('hunting/normal_form', 'recording/closed'):
            self.create_subscription(String, topic, self._text_printer(topic), latched())
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_health, STATUS)
        self._health: dict[str, str] = {}
        Caller(self.get_namespace())

    def _on_event(self, message: DiagnosticArray) -> None:
        self._print('hunting/events', message)

    def _on_status(self, message: DiagnosticArray) -> None:
        self._count += 1
        if self._count % self._every == 0:
            self._print('hunting/status', message)

    def _on_health(self, message: DiagnosticArray) -> None:
        """Print a node's health when its level changes."""
        health = read_diagnostic(message)
        name, level = health.get('name', ''), health.get('level', '')
        followed = self._follow and name.endswith(f'/{self._follow}')
        if followed or self._health.get(name) != level:
            self._health[name] = level
            self._print('/diagnostics', message)

    def _print(self, topic: str, message: DiagnosticArray) -> None:
        stamp_ns = to_ns(message.header.stamp)
        _write({'topic': topic, 'stamp_ns': stamp_ns, **read_diagnostic(message)})

    def _text_printer(self, topic: str):
        return lambda message: _write({'topic': topic, 'data': message.data})


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
        self._node = rclpy.create_node(
            'console_calls',
            namespace=namespace,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
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
    print(json.dumps(document), flush=True)


make_node = ConsoleNode
