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
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from hunt_ros.nodes.conversions import read_diagnostic, to_ns
from hunt_ros.nodes.parameters import declare
from hunt_ros.nodes.qos import EVENTS, STATUS, latched
from hunt_ros.settings import Settings, setting


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
        threading.Thread(target=self._read_commands, daemon=True).start()

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

    def _read_commands(self) -> None:
        for line in sys.stdin:
            name = line.strip()
            if name:
                self._call(name)

    def _call(self, name: str) -> None:
        """Call a Trigger service; what it answers is printed."""
        client = self.create_client(Trigger, name)

        def answered(future) -> None:
            answer = future.result()
            _write(
                {
                    'topic': 'answer',
                    'service': name,
                    'ok': answer.success,
                    'message': answer.message,
                }
            )

        if client.wait_for_service(timeout_sec=5.0):
            client.call_async(Trigger.Request()).add_done_callback(answered)
        else:
            _write({'topic': 'answer', 'service': name, 'ok': False, 'message': 'no such service'})


def _write(document: dict[str, object]) -> None:
    print(json.dumps(document), flush=True)


make_node = ConsoleNode
