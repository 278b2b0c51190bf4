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

_HELD: WeakKeyDictionary[Node, socket.socket] = WeakKeyDictionary()


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
    held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        held.bind(f'\0hunt_ros/{key}')
    except OSError as error:
        held.close()
        raise ConfigError(
            f'{name} runs already on this machine in ROS domain {domain}:'
            ' choose another namespace or ROS_DOMAIN_ID'
        ) from error
    _HELD[node] = held
    node.context.on_shutdown(held.close)
