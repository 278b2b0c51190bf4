"""
One node of a name on a machine: the second one refuses to start.

Two suites under one namespace would answer the same services and publish the same
topics, and two speed nodes would drive one roller. The name is held as an abstract
socket of Linux: the kernel gives it to one process of the network namespace, which
is what can meet in a ROS domain, and takes it back when that process ends, however it
ends. Namesakes on other machines are seen by `diagnostics` once they are discovered.
"""

from __future__ import annotations

import hashlib
import socket
import sys
from weakref import WeakKeyDictionary

from rclpy.node import Node

from hunt_ros.errors import ConfigError


class _Holder:
    """Holds a name until the ROS context is shut down."""

    def __init__(self, name: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._socket.bind(name)
        except OSError:
            self._socket.close()
            raise

    def release(self) -> None:
        self._socket.close()


_HELD: WeakKeyDictionary[Node, _Holder] = WeakKeyDictionary()


def hold_name(node: Node) -> None:
    """
    Hold the node's full name until its ROS context is shut down.

    Raises
    ------
    ConfigError
        If another node of this name runs on this machine in this ROS domain.
    """
    if sys.platform != 'linux':
        return
    name, domain = node.get_fully_qualified_name(), node.context.get_domain_id()
    key = hashlib.sha256(f'{domain} {name}'.encode()).hexdigest()
    try:
        _HELD[node] = _Holder(f'\0hunt_ros/{key}')
    except OSError as error:
        raise ConfigError(
            f'{name} runs already on this machine in ROS domain {domain}:'
            ' choose another namespace or ROS_DOMAIN_ID'
        ) from error
    node.context.on_shutdown(_HELD[node].release)
