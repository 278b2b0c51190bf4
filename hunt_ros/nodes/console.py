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
from concurrent.futures import Future
from contextlib import suppress
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import String

from hunt_ros.nodes.support.caller import Answer, Caller
from hunt_ros.nodes.support.conversions import read_diagnostic, to_ns
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.qos import hear
from hunt_ros.services import KEYS, SERVICES

#: Answers come in another thread than what is heard, and two lines in one are none.
_WRITING = threading.Lock()


class ConsoleNode(SuiteNode):
    """Prints statuses, events, health, normal forms and closed recordings; calls services."""

    def __init__(self) -> None:
        super().__init__('console', alone=False)
        for topic in ('hunting/events', 'hunting/status', 'speed/status', '/diagnostics'):
            hear(self, topic, partial(_print, topic))
        for topic in ('hunting/normal_form', 'recording/closed'):
            hear(self, topic, partial(_print_text, topic))
        self._caller = Caller(self, KEYS.values())
        self.work('commands', self._read)

    def _read(self, stopping: threading.Event) -> None:
        for line in sys.stdin:
            if (word := line.strip()) in SERVICES:
                answer = self._caller.call(word)
                answer.add_done_callback(partial(_answered, SERVICES[word].name))


def _print(topic: str, message: DiagnosticArray) -> None:
    ours = {'topic': topic, 'stamp_ns': to_ns(message.header.stamp)}
    _write(ours | read_diagnostic(message) | ours)  # first in the line, and whatever it says


def _print_text(topic: str, message: String) -> None:
    _write({'topic': topic, 'data': message.data})


def _answered(name: str, answer: Future[Answer]) -> None:
    ok, message, _ = answer.result()
    _write({'topic': 'answer', 'service': name, 'ok': ok, 'message': message})


def _write(document: dict[str, object]) -> None:
    with _WRITING, suppress(BrokenPipeError):  # who reads it has died: this one is to end, too
        print(json.dumps(document), flush=True)


make_node = ConsoleNode
