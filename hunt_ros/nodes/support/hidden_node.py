"""
A node beside the node: for what must not wait for it, or must not make it wait.

Service clients crash the EventsExecutor of these wheels now and then, and a service that takes
long holds up every message: both belong to another node, in a thread with the plain executor.
"""

from __future__ import annotations

import rclpy
from rclpy.context import Context
from rclpy.node import Node


def hidden_node(name: str, namespace: str = '', context: Context | None = None) -> Node:
    """
    Return a node without parameters of its own, and without a log topic.

    Parameters
    ----------
    name : str
        Tools hide one that begins with an underscore.
    namespace : str
        Whose topics and services it finds by their relative names.
    context : Context, optional
        The default one where it is not given.
    """
    return rclpy.create_node(
        name,
        context=context,
        namespace=namespace,
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
    )
