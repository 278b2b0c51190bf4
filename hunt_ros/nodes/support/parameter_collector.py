"""
The parameters of every node in the graph, asked for beside the recorder.

It asks from a node and a thread of its own, with the plain executor: service
clients that come and go crash the EventsExecutor of these wheels now and then.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import rclpy
from rcl_interfaces.srv import GetParameters, GetParameterTypes, ListParameters
from rclpy.client import Client
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.task import Future

from hunt_ros.nodes.support.diagnostics import Diagnostics
from hunt_ros.nodes.support.parameter_text import parameter_text
from hunt_ros.nodes.support.worker import Worker

_LOOK_S = 0.5
#: A node that is still starting has not declared all: it is asked again after this time, s, and
#: again after twice as long each time.
_AGAIN_S = 1.5


class ParameterCollector:
    """
    Asks each node, as it appears, for all its parameters, and ever more rarely again.

    Parameters
    ----------
    namespace : str
        Of the node that asks; it and nodes whose names begin with '_' are not asked.
    tell : callable
        Gets (full node name, parameter file as text) where it has changed, in the
        collector's thread.
    diagnostics : Diagnostics
        Told when asking fails.
    """

    def __init__(
        self, namespace: str, tell: Callable[[str, str], None], diagnostics: Diagnostics
    ) -> None:
        self._node = rclpy.create_node('_parameter_collector', namespace=namespace)
        self._tell = tell
        self._clients: dict[str, tuple[Client, ...]] = {}
        self.ask_again()
        self._worker = Worker(diagnostics, 'parameters', self._work)

    def ask_again(self) -> None:
        """Ask every node anew: another recording has begun."""
        self._next: dict[str, tuple[float, float]] = {}  # when to ask, steady clock; wait after
        self._told: dict[str, str] = {}

    def close(self) -> None:
        """Stop asking."""
        self._worker.stop()
        self._node.destroy_node()

    def _work(self, stopping: threading.Event) -> None:
        """Ask every node that there is, again and again."""
        executor = SingleThreadedExecutor()
        executor.add_node(self._node)
        try:
            while not stopping.is_set():
                for name, namespace in self._node.get_node_names_and_namespaces():
                    if not name.startswith('_'):
                        self._ask(f'{namespace.rstrip("/")}/{name}')
                _spin(executor, _LOOK_S)
        except ExternalShutdownException:
            pass
        finally:
            executor.shutdown()

    def _ask(self, node: str) -> None:
        """Ask a node for its parameters where it is due: names, types, then values."""
        now = time.monotonic()
        due, wait = self._next.get(node, (now, _AGAIN_S))
        if now < due:
            return
        if node not in self._clients:
            self._clients[node] = (
                self._node.create_client(ListParameters, f'{node}/list_parameters'),
                self._node.create_client(GetParameterTypes, f'{node}/get_parameter_types'),
                self._node.create_client(GetParameters, f'{node}/get_parameters'),
            )
        clients = lister, typer, getter = self._clients[node]
        if not all(client.service_is_ready() for client in clients):
            return
        self._next[node] = now + wait, 2.0 * wait

        def listed(future: Future) -> None:
            """Ask for the types of the parameters."""
            names = list(future.result().result.names)
            request = GetParameterTypes.Request(names=names)
            typer.call_async(request).add_done_callback(lambda reply: typed(names, reply))

        def typed(names: list[str], future: Future) -> None:
            """Ask for the values of those that have one."""
            # A node gives no values at all where one of those asked for has none.
            kinds = future.result().types
            if len(kinds) < len(names):
                return  # undeclared in the meantime: next time
            known = [name for name, kind in zip(names, kinds, strict=True) if kind]
            request = GetParameters.Request(names=known)
            getter.call_async(request).add_done_callback(lambda reply: got(known, reply))

        def got(names: list[str], future: Future) -> None:
            """Hand the values on where they are others than before."""
            values = future.result().values
            if len(values) < len(names):
                return
            text = parameter_text(node, names, values)
            if self._told.get(node) != text:
                self._told[node] = text
                self._tell(node, text)

        lister.call_async(ListParameters.Request()).add_done_callback(listed)


def _spin(executor: SingleThreadedExecutor, seconds: float) -> None:
    """Take the answers that come within a time."""
    deadline = time.monotonic() + seconds
    while (left_s := deadline - time.monotonic()) > 0.0:
        executor.spin_once(timeout_sec=left_s)
