"""
The threads of a node, of which none ends in silence, and the nodes beside it.

An error that nobody expected is logged with its traceback and stands on `/diagnostics` from then
on: a node whose thread is gone must not look well.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import rclpy
from rclpy.context import Context
from rclpy.node import Node

#: Gets the name of a task and the error that ended it: `Diagnostics.failed`.
Failed = Callable[[str, Exception], None]


class Worker:
    """
    Runs a function in a thread, from now until it returns or is asked to stop.

    Parameters
    ----------
    failed : callable
        Told when the function raises.
    name : str
        Of the thread.
    work : callable
        Gets the event that asks it to return. Each worker has its own: a thread that
        was too slow to end in time can never be taken for its successor.
    patience_s : float
        It is waited for so long at its end; then it is left to itself.
    """

    def __init__(
        self,
        failed: Failed,
        name: str,
        work: Callable[[threading.Event], None],
        patience_s: float = 2.0,
    ) -> None:
        self._failed, self._name, self._work, self._patience_s = failed, name, work, patience_s
        self.stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Ask it to return, and wait for it."""
        self.stopping.set()
        self._thread.join(self._patience_s)

    def _run(self) -> None:
        try:
            self._work(self.stopping)
        except Exception as error:
            if not self.stopping.is_set():  # else: what it used is gone already
                self._failed(self._name, error)


def hidden_node(name: str, namespace: str = '', context: Context | None = None) -> Node:
    """Return a node without parameters of its own and without a log topic; `_` hides its name."""
    return rclpy.create_node(
        name,
        context=context,
        namespace=namespace,
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
    )
