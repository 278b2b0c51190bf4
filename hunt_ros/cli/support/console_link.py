"""The command line's end of the console node: what it prints as objects, and calls to services."""

from __future__ import annotations

import json
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from queue import Empty, Queue
from typing import Any

from hunt_ros.cli.support.processes import NodeSpec
from hunt_ros.cli.support.supervisor import Supervisor
from hunt_ros.services import SERVICES

Line = dict[str, Any]

#: It is looked so often whether a node has ended, s.
_LOOK_S = 0.25


class ConsoleLink:
    """
    Reads the console's lines in a thread, so that waiting for one has a deadline.

    Parameters
    ----------
    supervisor : Supervisor
        Starts the console, again and again if it must: nothing depends on it.
    """

    def __init__(self, supervisor: Supervisor) -> None:
        self._supervisor = supervisor
        self._lines: Queue[Line] = Queue()
        self._look_at = 0.0
        supervisor.start(NodeSpec('console', piped=True), self._attach)

    def _attach(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        threading.Thread(target=self._read, args=(process,), daemon=True).start()

    def lines(self, timeout_s: float) -> Iterator[Line]:
        """
        Iterate over the lines that come within `timeout_s` seconds.

        What becomes of the processes of the run comes as lines of the topic `process`.

        Raises
        ------
        HuntError
            If a node ended and is not started again.
        """
        deadline = time.monotonic() + timeout_s
        while (left_s := deadline - time.monotonic()) > 0.0:
            if time.monotonic() >= self._look_at:
                self._look_at = time.monotonic() + _LOOK_S
                for text in self._supervisor.look():
                    yield {'topic': 'process', 'data': text}
            with suppress(Empty):
                line = self._lines.get(timeout=min(left_s, _LOOK_S))
                if line['topic'] == '/diagnostics':
                    self._supervisor.heard(str(line['name']))
                yield line

    def call(self, word: str) -> None:
        """Ask for a service by its word of `hunt call`; the answer comes as a line."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f'{word}\n')
            self._process.stdin.flush()
        except OSError:
            said = {'ok': False, 'message': 'not asked: the console is being started again'}
            self._lines.put({'topic': 'answer', 'service': SERVICES[word].name, **said})

    def _read(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        for text in process.stdout:
            with suppress(ValueError):  # a warning of some library
                self._lines.put(json.loads(text))
