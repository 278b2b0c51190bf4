"""
What the command line sees of a running rig: lines of JSON out, commands in.

Every line on standard output is one object with the key `topic`; every line on
standard input is a word of `hunt_ros.services`, which is called. So the command line
itself needs no ROS.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from concurrent.futures import Future
from contextlib import suppress
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import String

from hunt_ros.nodes.support.caller import Answer, Caller
from hunt_ros.nodes.support.conversions import read_diagnostic, to_ns
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.qos import EVENTS, STATUS, latched
from hunt_ros.services import KEYS, SERVICES

#: A status is printed so often at most, unless what is in force changes, s.
_STATUS_S = 0.1
#: Answers come in another thread than what is heard, and two lines in one are none.
_WRITING = threading.Lock()
#: What is in force.
_IN_FORCE = ('level', 'state', 'alarm', 'emergency_stop', 'interlock_state', 'profile_state')


class ConsoleNode(SuiteNode):
    """Prints statuses, events, health, normal forms and closed recordings; calls services."""

    def __init__(self) -> None:
        super().__init__('console', alone=False)
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
        self._caller = Caller(self, KEYS.values())
        self.work('commands', self._read)

    def _read(self, stopping: threading.Event) -> None:
        for line in sys.stdin:
            if (word := line.strip()) in SERVICES:
                answer = self._caller.call(word)
                answer.add_done_callback(partial(_answered, SERVICES[word].name))

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


def _answered(name: str, answer: Future[Answer]) -> None:
    ok, message, _ = answer.result()
    _write({'topic': 'answer', 'service': name, 'ok': ok, 'message': message})


def _write(document: dict[str, object]) -> None:
    with _WRITING, suppress(BrokenPipeError):  # who reads it has died: this one is to end, too
        print(json.dumps(document), flush=True)


make_node = ConsoleNode
