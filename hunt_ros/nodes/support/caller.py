"""
Calls the services that an operator asks for, beside the node that he asks: the one way to call.

A client that has found a server may send its request; that the server has found the client too,
nobody tells. Until then the request may go unheard, and an answer is given up after 100 ms
(ros2/rmw_fastrtps #392, #390, #842: open in Jazzy). So what may be repeated is, and what may not
waits a moment.
"""

from __future__ import annotations

import getpass
import json
import os
import socket
import threading
import time
from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import NamedTuple

from rclpy.client import Client
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.qos import stream
from hunt_ros.services import SERVICES, Service, spoken

_LOOK_S = 0.02
#: A server that was found is taken to have found its client after this, s: the tests of the
#: nodes lose no answer with it.
INTRODUCED_S = 0.3
#: A request that may be repeated is repeated when no answer has come for so long, s, and made no
#: more often: a node that stands still will answer them all when it goes on. And so many calls of
#: one service are under way at once.
_AGAIN_S, _MOST = 1.0, 5


def _user() -> str:
    """Return who runs this process, user@machine."""
    try:
        name = getpass.getuser()
    except (KeyError, OSError):  # a user without a name
        name = str(os.getuid())
    return f'{name}@{socket.gethostname()}'


class Answer(NamedTuple):
    """Whether it was done, and what the service says; or why it was not `heard`."""

    success: bool
    message: str
    heard: bool = True


class Caller:
    """
    Calls the services of `SERVICES` by their words. A call never waits for one of another service.

    Parameters
    ----------
    node : SuiteNode
        Beside which it calls, until that closes.
    words : iterable of str
        Services that are looked for from the start: such a call does not wait for discovery.
    found_s, answer_s : float
        A service is looked for so long, and waited for so long at least, s.
    """

    def __init__(
        self,
        node: SuiteNode,
        words: Iterable[str] = SERVICES,
        found_s: float = 5.0,
        answer_s: float = 0.0,
    ) -> None:
        self._found_s, self._answer_s = found_s, answer_s
        #: Of each service its own threads: a key that is held down on one delays no stop.
        self._calls = {word: ThreadPoolExecutor(_MOST) for word in SERVICES}
        self._lock = threading.Lock()
        self._clients: dict[str, Client] = {}
        self._topics: dict[str, Publisher] = {}
        self._ready_s: dict[str, float] = {}  # since when each service is known to be there
        self._who = f'{_user()} ({node.get_name()})'

        def make(beside: Node) -> None:
            """Find what is to be called."""
            self._node = beside
            for word in words:
                self._client(word)
                self._topic(SERVICES[word])

        node.beside('caller', make)

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
        Future of Answer
        """
        if word in SERVICES:
            return self._calls[word].submit(self._call, word, spoken(words), time.monotonic())
        refused: Future[Answer] = Future()
        refused.set_result(Answer(False, f'{word[:40]!r} is no service', False))
        return refused

    def close(self) -> None:
        """Take no more calls."""
        for calls in self._calls.values():
            calls.shutdown(wait=False, cancel_futures=True)

    def _client(self, word: str) -> Client:
        service = SERVICES[word]
        with self._lock:
            if word not in self._clients:
                kind = SetBool if service.switch else Trigger
                self._clients[word] = self._node.create_client(kind, service.name)
            return self._clients[word]

    def _topic(self, service: Service) -> Publisher:
        """Return the publisher of what is said with a service."""
        name = f'{service.node}/calls'
        with self._lock:
            if name not in self._topics:
                self._topics[name] = self._node.create_publisher(String, name, stream(10))
            return self._topics[name]

    def _call(self, word: str, words: str, asked_s: float) -> Answer:
        service = SERVICES[word]
        client, topic = self._client(word), self._topic(service)
        if time.monotonic() - asked_s > self._found_s:  # nothing is done long after it was meant
            return Answer(False, f'{service.node} has not answered to calls before', False)
        while not (client.service_is_ready() and (not words or topic.get_subscription_count())):
            self._ready_s.pop(word, None)
            if time.monotonic() - asked_s > self._found_s:
                return Answer(False, self._nobody(service), False)
            time.sleep(_LOOK_S)
        since_s = self._ready_s.setdefault(word, time.monotonic())
        if not service.repeatable:
            time.sleep(max(0.0, since_s + INTRODUCED_S - time.monotonic()))
        said = {'service': word, 'who': self._who, 'words': words}
        topic.publish(String(data=json.dumps(said)))
        # It comes first; what has to be done at once does not wait for the name of who asks.
        if words or not service.repeatable:
            topic.wait_for_all_acked(Duration(seconds=1.0))
        request = SetBool.Request(data=service.switch == 'on') if service.switch else None
        answered: Future[Answer] = Future()

        def answer(reply: object) -> None:
            """Take the first answer; that of an earlier request may come after a later one."""
            said = reply.result()  # type: ignore[attr-defined]
            if not answered.done():
                answered.set_result(Answer(said.success, said.message))

        takes_s = max(service.takes_s, self._answer_s)
        gives_up_s = time.monotonic() + takes_s
        for left in reversed(range(_MOST if service.repeatable else 1)):
            client.call_async(request or Trigger.Request()).add_done_callback(answer)
            patience_s = gives_up_s - time.monotonic()
            wait([answered], min(_AGAIN_S, patience_s) if left else patience_s)
            if answered.done():
                return answered.result()
        return Answer(False, f'{service.node} has not answered for {takes_s:.0f} s', False)

    def _nobody(self, service: Service) -> str:
        """Say that nobody offers a service, and where else it is offered."""
        node = self._node
        full, end = node.resolve_service_name(service.name), f'/{service.name}'
        names = sorted({name for name, _ in node.get_service_names_and_types()} - {full})
        others = [n.removesuffix(end).strip('/') for n in names if n.endswith(end)]
        hint = ', '.join(f'--namespace {name}' for name in others)
        return f'{service.node} is not running: nobody offers {full}' + (
            f'; it is there under {hint}' if hint else ''
        )
