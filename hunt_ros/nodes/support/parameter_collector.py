"""The parameters of every node in the graph, asked for beside the recorder."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import yaml
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, GetParameterTypes, ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

from hunt_ros.nodes.support.worker import Aside, Failed

_LOOK_S = 0.5
#: A node that is still starting has not declared all: it is asked again after this time, s, and
#: again after twice as long each time.
_AGAIN_S = 1.5


class ParameterCollector:
    """
    Asks each node, as it appears, for all its parameters, and ever more rarely again.

    Parameters
    ----------
    node : Node
        Beside which it asks; nodes whose names begin with '_' are not asked.
    failed : callable
        Told when asking fails.
    tell : callable
        Gets (full node name, parameter file as text) where it has changed, in the
        collector's thread.
    """

    def __init__(self, node: Node, failed: Failed, tell: Callable[[str, str], None]) -> None:
        self._tell = tell
        self._clients: dict[str, tuple[Client, ...]] = {}
        self.ask_again()
        self._aside = Aside(node, failed, 'parameters', _LOOK_S, self._round)

    def ask_again(self) -> None:
        """Ask every node anew: another recording has begun."""
        self._next: dict[str, tuple[float, float]] = {}  # when to ask, steady clock; wait after
        self._told: dict[str, str] = {}
        self._looked_s = 0.0

    def close(self) -> None:
        """Stop asking."""
        self._aside.close()

    def _round(self) -> None:
        """Ask every node that there is."""
        if time.monotonic() - self._looked_s < _LOOK_S:
            return  # an answer came
        self._looked_s = time.monotonic()
        for name, namespace in self._aside.node.get_node_names_and_namespaces():
            if not name.startswith('_'):
                self._ask(f'{namespace.rstrip("/")}/{name}')

    def _ask(self, node: str) -> None:
        """Ask a node for its parameters where it is due: names, types, then values."""
        now = time.monotonic()
        due, wait = self._next.get(node, (now, _AGAIN_S))
        if now < due:
            return
        if node not in self._clients:
            client = self._aside.node.create_client
            self._clients[node] = (
                client(ListParameters, f'{node}/list_parameters'),
                client(GetParameterTypes, f'{node}/get_parameter_types'),
                client(GetParameters, f'{node}/get_parameters'),
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
            text = _parameter_text(node, names, values)
            if self._told.get(node) != text:
                self._told[node] = text
                self._tell(node, text)

        lister.call_async(ListParameters.Request()).add_done_callback(listed)


def _parameter_text(node: str, names: Sequence[str], values: Sequence[ParameterValue]) -> str:
    """Return a parameter file that gives a node the values it has."""
    found = {
        name: parameter_value_to_python(value) for name, value in zip(names, values, strict=True)
    }
    parameters = {name: value for name, value in found.items() if value is not None}
    document = {node: {'ros__parameters': parameters}}
    return yaml.safe_dump(document, default_flow_style=None, width=99)
