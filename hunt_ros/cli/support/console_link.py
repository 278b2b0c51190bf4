"""The command line's end of the console node: what it prints as objects, and calls to services."""

from __future__ import annotations

import json
import subprocess
import threading
import time
from collections.abc import Iterator
from queue import Empty, Queue
from typing import Any

from hunt_ros.cli.support.processes import Processes
from hunt_ros.errors import HuntError

Line = dict[str, Any]

_LOOK_S = 1.0


class ConsoleLink:
    """
    Reads the console's lines in a thread, so that waiting for one has a deadline.

    Parameters
    ----------
    process : Popen
        The console node, piped.
    processes : Processes
        The run it belongs to: a node that ends by itself ends the waiting.
    """

    def __init__(self, process: subprocess.Popen[str], processes: Processes) -> None:
        self._process = process
        self._processes = processes
        self._lines: Queue[Line] = Queue()
        self._look_at = 0.0
        threading.Thread(target=self._read, daemon=True).start()

    def lines(self, timeout_s: float) -> Iterator[Line]:
        """
        Iterate over the lines that come within `timeout_s` seconds.

        What the nodes say of their compilation comes as lines of the topic `progress`.

        Raises
        ------
        HuntError
            If a node ended by itself.
        """
        deadline = time.monotonic() + timeout_s
        while (left_s := deadline - time.monotonic()) > 0.0:
            if time.monotonic() >= self._look_at:
                self._look_at = time.monotonic() + _LOOK_S
                for text in self._processes.progress():
                    yield {'topic': 'progress', 'data': text}
            try:
                yield self._lines.get(timeout=min(left_s, 0.25))
            except Empty:
                failure = self._processes.failed()
                if failure:
                    raise HuntError(failure) from None

    def call(self, service: str) -> None:
        """Ask for a Trigger service (relative name); the answer comes as a line."""
        if self._process.stdin is not None:
            self._process.stdin.write(f'{service}\n')
            self._process.stdin.flush()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for text in self._process.stdout:
            try:
                line = json.loads(text)
            except ValueError:
                continue  # a warning of some library
            self._lines.put(line)
