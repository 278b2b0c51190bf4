"""
Calls the services that an operator asks for, beside the node that he asks.

They are called from a `hidden_node` in a thread of its own. A call never waits for another.
"""

from __future__ import annotations

import threading
import time
from concurrent.futures import Future
from typing import Any

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from hunt_ros.nodes.support.diagnostics import Diagnostics
from hunt_ros.nodes.support.hidden_node import hidden_node
from hunt_ros.nodes.support.qos import stream
from hunt_ros.nodes.support.worker import Worker
from hunt_ros.services import SERVICES

#: Who does not answer within this may not have heard, s; closing a recording takes longest.
_ANSWER_S = 10.0
_LOOK_S = 0.05
#: A service that nobody offers is looked for so long, s: who has just started is found soon.
_FOUND_S = 2.0

Answer = tuple[bool, str]


class Caller:
    """
    Calls the services of `SERVICES` by their words.

    Parameters
    ----------
    node : Node
        Gives the namespace.
    diagnostics : Diagnostics
        Told when the thread fails.
    """

    def __init__(self, node: Node, diagnostics: Diagnostics) -> None:
        self._node = hidden_node(f'_{node.get_name()}_caller', node.get_namespace())
        self._clients_of = {
            word: self._node.create_client(SetBool if service.switch else Trigger, service.name)
            for word, service in SERVICES.items()
        }
        topics = {service.words_topic for service in SERVICES.values()} - {''}
        self._words = {
            topic: self._node.create_publisher(String, topic, stream(10)) for topic in topics
        }
        self._lock = threading.Lock()
        self._open: list[tuple[float, str, Future[Answer]]] = []
        #: Calls whose service has not been found yet: until when, word, words.
        self._sought: list[tuple[float, str, str, Future[Answer]]] = []
        self._worker = Worker(diagnostics, 'caller', self._work)

    def call(self, word: str, words: str = '') -> Future[Answer]:
        """
        Call a service; from any thread.

        Parameters
        ----------
        word : str
            Of `SERVICES`.
        words : str
            What goes with it: a name, a mark.

        Returns
        -------
        Future of (bool, str)
            Whether it was done, and what the service says, or why it was not asked.
        """
        answer: Future[Answer] = Future()
        service = SERVICES.get(word)
        if service is None:
            answer.set_result((False, f'{word[:40]!r} is no service'))
            return answer
        said = ' '.join(words.split())[:200] if service.words_topic else ''
        if self._clients_of[word].service_is_ready():
            self._ask(word, said, answer)
        else:
            with self._lock:
                self._sought.append((time.monotonic() + _FOUND_S, word, said, answer))
        return answer

    def _ask(self, word: str, said: str, answer: Future[Answer]) -> None:
        """Send the words and the request to a service that was found."""
        service = SERVICES[word]
        if said:
            self._words[service.words_topic].publish(String(data=said))

        def answered(reply: Any) -> None:
            self._end(answer, (reply.result().success, reply.result().message))

        with self._lock:
            self._open.append((time.monotonic() + _ANSWER_S, service.node, answer))
        switch = service.switch
        request = SetBool.Request(data=switch == 'on') if switch else Trigger.Request()
        self._clients_of[word].call_async(request).add_done_callback(answered)

    def _look(self) -> None:
        """Ask the services that have been found meanwhile."""
        with self._lock:
            sought, self._sought = self._sought, []
        for until_s, word, said, answer in sought:
            service = SERVICES[word]
            if self._clients_of[word].service_is_ready():
                self._ask(word, said, answer)
            elif time.monotonic() > until_s:
                none = f'{service.node} is not running: nobody offers {service.name}'
                answer.set_result((False, none))
            else:
                with self._lock:
                    self._sought.append((until_s, word, said, answer))

    def close(self) -> None:
        """Take no more calls."""
        self._worker.stop()
        self._node.destroy_node()

    def _end(self, answer: Future[Answer], result: Answer) -> None:
        with self._lock:
            self._open = [each for each in self._open if each[2] is not answer]
            if not answer.done():
                answer.set_result(result)

    def _work(self, stopping: threading.Event) -> None:
        """Spin the hidden node, and give up calls that are not answered in time."""
        executor = SingleThreadedExecutor()
        executor.add_node(self._node)
        try:
            while not stopping.is_set():
                executor.spin_once(timeout_sec=_LOOK_S)
                self._look()
                now = time.monotonic()
                late = [each for each in self._open if each[0] < now]
                for _, node, answer in late:
                    self._end(answer, (False, f'{node} has not answered for {_ANSWER_S:.0f} s'))
        except ExternalShutdownException:
            pass
        finally:
            executor.shutdown()
