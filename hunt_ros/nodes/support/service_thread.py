"""
Services whose answer may take long, in a thread of their own.

A callback of the node's executor that waits for a disk holds up every message. These
services are offered by a hidden node beside it, with the plain executor.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from hunt_ros.errors import HuntError
from hunt_ros.nodes.support.hidden_node import hidden_node


class ServiceThread:
    """
    Answers Trigger services, one after the other.

    Parameters
    ----------
    node : Node
        The node they belong to: its namespace and its log.
    answers : mapping of str to callable
        By relative name: does the work and returns the message of the answer; an
        error is the answer of a service that failed.
    """

    def __init__(self, node: Node, answers: Mapping[str, Callable[[], str]]) -> None:
        self._log = node.get_logger()
        self._node = hidden_node(f'_{node.get_name()}_services', node.get_namespace())
        for name, answer in answers.items():
            self._node.create_service(Trigger, name, self._callback(name, answer))
        self._running = True
        self._thread = threading.Thread(target=self._work, name='services', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Take no more calls; one that is being answered is left to itself."""
        self._running = False

    def _work(self) -> None:
        executor = SingleThreadedExecutor()
        executor.add_node(self._node)
        try:
            while self._running:
                executor.spin_once(timeout_sec=0.2)
        except ExternalShutdownException:
            pass

    def _callback(self, name: str, answer: Callable[[], str]) -> Callable[..., Trigger.Response]:
        """Return the callback of a service."""

        def answered(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            """Fill in the answer; what fails is the answer too."""
            try:
                response.success, response.message = True, answer()
            except HuntError as error:
                response.success, response.message = False, str(error)
            except Exception as error:  # any other would end the thread, and every service
                response.success = False
                response.message = f'{type(error).__name__}: {error}'
                self._log.error(f'{name}: {response.message}')
            return response

        return answered
