"""Transitions of a lifecycle node that fail with a reason: rclpy keeps it to itself."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from rclpy.lifecycle import State, TransitionCallbackReturn

from hunt_ros.nodes.support.diagnostics import one_line

_Node = TypeVar('_Node')


def says_why(
    transition: Callable[[_Node, State], TransitionCallbackReturn],
) -> Callable[[_Node, State], TransitionCallbackReturn]:
    """
    Log what a transition raises, and let it fail.

    Parameters
    ----------
    transition : callable
        Method of a lifecycle node, whose attribute `failure` gets the reason.
    """

    @wraps(transition)
    def told(node: Any, state: State) -> TransitionCallbackReturn:
        """Do it, and say why it cannot be done."""
        try:
            return transition(node, state)
        except Exception as error:  # of parameters, and of whatever a library wants
            node.failure = one_line(error)
            node.get_logger().error(node.failure)
            return TransitionCallbackReturn.FAILURE

    return told
