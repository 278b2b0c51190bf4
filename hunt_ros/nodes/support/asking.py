"""
Asking a service once: the one that is asked may not know yet who asks.

A client that has found a server may send its request; that the server has found the client too,
nobody tells. Until then the request may go unheard, and an answer is given up after 100 ms
(ros2/rmw_fastrtps #392, #390, #842: open in Jazzy). `ros2 service call` then waits for ever.
"""

from __future__ import annotations

import time
from typing import Any

import rclpy
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future

#: A server that was found is taken to have found its client after this, s: the tests of the
#: nodes lose no answer with it.
INTRODUCED_S = 0.3
#: A request that may be repeated is repeated when no answer has come for so long, s, and made no
#: more often: a node that stands still will answer them all when it goes on.
_AGAIN_S, _MOST = 1.0, 5


def ask(
    node: Node, client: Client, request: object, timeout_s: float, *, repeatable: bool = False
) -> Any | None:
    """
    Ask a service that was found, and wait for its answer.

    Parameters
    ----------
    node : Node
        Of the client; spun here.
    client : Client
        Its service is ready.
    request : service request
        What is asked.
    timeout_s : float
        How long to wait, s.
    repeatable : bool
        Ask again where no answer comes; else once: `INTRODUCED_S` after the server was found, if
        the answer is not to be lost.

    Returns
    -------
    service response or None
        None where no answer has come.
    """
    answer = Future()

    def answered(reply: Future) -> None:
        """Take the first answer; that of an earlier request may come after a later request."""
        if not answer.done():
            answer.set_result(reply.result())

    deadline_s = time.monotonic() + timeout_s
    times = _MOST if repeatable else 1
    while not answer.done() and (left_s := deadline_s - time.monotonic()) > 0.0:
        client.call_async(request).add_done_callback(answered)
        times -= 1
        wait_s = min(_AGAIN_S, left_s) if times else left_s
        rclpy.spin_until_future_complete(node, answer, timeout_sec=wait_s)
    return answer.result() if answer.done() else None
