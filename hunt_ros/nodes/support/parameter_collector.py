"""The parameters of every node in the graph, asked for beside the recorder."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import yaml
from rcl_interfaces.srv import GetParameters, GetParameterTypes, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from hunt_ros.nodes.support.worker import Aside, Failed

_LOOK_S = 0.5
#: A node that is still starting has not declared all: it is asked again after this time, s, and
#: again after twice as long each time. One that does not answer is given up after the second.
_AGAIN_S, _ANSWER_S = 1.5, 2.0


class ParameterCollector(Aside):
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
        self._clients: dict[str, dict[type, Any]] = {}
        self.ask_again()
        super().__init__(node, failed, 'parameters', _LOOK_S, self._look)

    def ask_again(self) -> None:
        """Ask every node anew: another recording has begun."""
        self._due: dict[str, tuple[float, float]] = {}  # when to ask, steady clock; wait after
        self._told: dict[str, str] = {}

    def _look(self) -> None:
        """Ask every node where it is due."""
        for name, namespace in self.node.get_node_names_and_namespaces():
            full, now_s = f'{namespace.rstrip("/")}/{name}', time.monotonic()
            due_s, wait_s = self._due.get(full, (now_s, _AGAIN_S))
            if name.startswith('_') or now_s < due_s:
                continue
            values = self._values(full)
            if values is None:
                continue  # not there yet: in the next round
            self._due[full] = now_s + wait_s, 2.0 * wait_s
            document = {full: {'ros__parameters': values}}
            text = yaml.safe_dump(document, default_flow_style=None, width=99)
            if self._told.get(full) != text:
                self._told[full] = text
                self._tell(full, text)

    def _values(self, node: str) -> dict[str, Any] | None:
        """Return the parameters of a node; None where it does not answer, or they change."""
        listed = self._ask(node, ListParameters, 'list_parameters')
        if listed is None:
            return None
        names = list(listed.result.names)
        kinds = self._ask(node, GetParameterTypes, 'get_parameter_types', names=names)
        if kinds is None or len(kinds.types) != len(names):
            return None
        # A node gives no values at all where one of those asked for has none.
        known = [name for name, kind in zip(names, kinds.types, strict=True) if kind]
        got = self._ask(node, GetParameters, 'get_parameters', names=known)
        if got is None or len(got.values) != len(known):
            return None
        values = map(parameter_value_to_python, got.values)
        return {name: each for name, each in zip(known, values, strict=True) if each is not None}

    def _ask(self, node: str, kind: type, service: str, **request: Any) -> Any:
        """Return the answer of a service; None where there is none in time."""
        clients = self._clients.setdefault(node, {})
        if kind not in clients:
            clients[kind] = self.node.create_client(kind, f'{node}/{service}')
        if not clients[kind].service_is_ready():
            return None
        asked = clients[kind].call_async(kind.Request(**request))  # type: ignore[attr-defined]
        if self.answered(asked, _ANSWER_S):
            return asked.result()
        clients[kind].remove_pending_request(asked)
        return None
