"""
A thread of a node that does not end in silence.

An error that nobody expected is logged with its traceback and stands on
`/diagnostics` from then on: a node whose thread is gone must not look well.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from hunt_ros.nodes.support.diagnostics import Diagnostics


class Worker:
    """
    Runs a function in a thread, from now until it returns or is asked to stop.

    Parameters
    ----------
    diagnostics : Diagnostics
        Told when the function raises.
    name : str
        Of the thread.
    work : callable
        Gets the event that asks it to return. Each worker has its own: a thread that
        was too slow to end in time can never be taken for its successor.
    """

    def __init__(
        self, diagnostics: Diagnostics, name: str, work: Callable[[threading.Event], None]
    ) -> None:
        self._diagnostics = diagnostics
        self._name = name
        self._work = work
        self.stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def stop(self, timeout_s: float = 2.0) -> None:
        """Ask it to return, and wait so long for it."""
        self.stopping.set()
        self._thread.join(timeout=timeout_s)

    def _run(self) -> None:
        try:
            self._work(self.stopping)
        except Exception as error:
            if not self.stopping.is_set():  # else: what it used is gone already
                self._diagnostics.failed(self._name, error)
