"""
Calls the services that an operator asks for, beside the node that he asks: the one way to call.

A client that has found a server may send its request; that the server has found the client too,
nobody tells. Until then the request may go unheard, and an answer is given up after 100 ms
(ros2/rmw_fastrtps #392, #390, #842: open in Jazzy). So what may be repeated is, and what may not
waits a moment.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

from rclpy.client import Client
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from hunt_ros.nodes.support.qos import stream
from hunt_ros.nodes.support.worker import Aside, Failed
from hunt_ros.services import SERVICES, Service, spoken

_LOOK_S = 0.02
#: A server that was found is taken to have found its client after this, s: the tests of the
#: nodes lose no answer with it.
INTRODUCED_S = 0.3
#: A request that may be repeated is repeated when no answer has come for so long, s, and made no
#: more often: a node that stands still will answer them all when it goes on.
_AGAIN_S, _MOST = 1.0, 5


class Answer(NamedTuple):
    """Whether it was done, and what the service says; or why it was not `heard`."""

    success: bool
    message: str
    heard: bool = True


@dataclass
class _Call:
    """A call that has no answer yet."""

    word: str
    service: Service
    words: str
    answer: Future[Answer] = field(default_factory=Future)
    began_s: float = field(default_factory=time.monotonic)
    asked_s: float = 0.0
    times: int = 0


class Caller:
    """
    Calls the services of `SERVICES` by their words. A call never waits for another.

    Parameters
    ----------
    node : Node
        Gives the namespace.
    failed : callable
        Told when the thread fails.
    words : iterable of str
        Services that are looked for from the start: such a call does not wait for discovery.
    found_s, answer_s : float
        A service is looked for so long, and waited for so long, s.
    """

    def __init__(
        self,
        node: Node,
        failed: Failed,
        words: Iterable[str] = SERVICES,
        found_s: float = 5.0,
        answer_s: float = 10.0,
    ) -> None:
        self._found_s, self._answer_s = found_s, answer_s
        self._lock = threading.Lock()
        self._open: list[_Call] = []
        self._clients: dict[str, Client] = {}
        self._topics: dict[str, Publisher] = {}
        self._ready_s: dict[str, float] = {}  # when each service was found
        self._aside = Aside(node, failed, 'caller', _LOOK_S, self._round)
        for word in words:
            self._client(word)

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
        service = SERVICES.get(word)
        if service is None:
            refused: Future[Answer] = Future()
            refused.set_result(Answer(False, f'{word[:40]!r} is no service', False))
            return refused
        call = _Call(word, service, spoken(words) if service.words_topic else '')
        with self._lock:
            self._open.append(call)
            if not call.words:
                self._advance(call)
        return call.answer

    def close(self) -> None:
        """Take no more calls."""
        self._aside.close()

    def _client(self, word: str) -> Client:
        if word not in self._clients:
            service = SERVICES[word]
            kind = SetBool if service.switch else Trigger
            self._clients[word] = self._aside.node.create_client(kind, service.name)
        return self._clients[word]

    def _topic(self, call: _Call) -> Publisher:
        """Return the publisher of the words that go with a call."""
        name = call.service.words_topic
        if name not in self._topics:
            self._topics[name] = self._aside.node.create_publisher(String, name, stream(10))
        return self._topics[name]

    def _round(self) -> None:
        """Go on with every call, and forget those that were answered."""
        with self._lock:
            self._open = [call for call in self._open if not call.answer.done()]
            for call in self._open:
                self._advance(call)

    def _advance(self, call: _Call) -> None:
        """Ask where the service is there, again where that does no harm, or give the call up."""
        now_s, service = time.monotonic(), call.service
        if not call.times:
            if self._introduced(call, now_s):
                self._ask(call, now_s)
            elif now_s - call.began_s > self._found_s:
                self._end(call, Answer(False, self._nobody(service), False))
        elif now_s - call.began_s > self._found_s + self._answer_s:
            said = f'{service.node} has not answered for {self._answer_s:.0f} s'
            self._end(call, Answer(False, said, False))
        elif service.repeatable and call.times < _MOST and now_s - call.asked_s > _AGAIN_S:
            self._ask(call, now_s)

    def _introduced(self, call: _Call, now_s: float) -> bool:
        """Return True if the service, and who takes the words, are there."""
        if not self._client(call.word).service_is_ready():
            self._ready_s.pop(call.word, None)
            return False
        since_s = self._ready_s.setdefault(call.word, now_s)
        if call.words and not self._topic(call).get_subscription_count():
            return False
        return call.service.repeatable or now_s - since_s >= INTRODUCED_S

    def _ask(self, call: _Call, now_s: float) -> None:
        """Send the words and the request."""
        if call.words:
            topic = self._topic(call)
            topic.publish(String(data=call.words))
            topic.wait_for_all_acked(Duration(seconds=1.0))  # the words come first
        call.times, call.asked_s = call.times + 1, now_s
        switch = call.service.switch
        request = SetBool.Request(data=switch == 'on') if switch else Trigger.Request()
        asked = self._client(call.word).call_async(request)
        asked.add_done_callback(partial(self._answered, call))

    def _answered(self, call: _Call, reply: Any) -> None:
        self._end(call, Answer(reply.result().success, reply.result().message))

    @staticmethod
    def _end(call: _Call, answer: Answer) -> None:
        """Hand over the first answer; that of an earlier request may come after a later one."""
        if not call.answer.done():
            call.answer.set_result(answer)

    def _nobody(self, service: Service) -> str:
        """Say that nobody offers a service, and where else it is offered."""
        node = self._aside.node
        full, end = node.resolve_service_name(service.name), f'/{service.name}'
        names = sorted({name for name, _ in node.get_service_names_and_types()} - {full})
        others = [n.removesuffix(end).strip('/') for n in names if n.endswith(end)]
        hint = ', '.join(f'--namespace {name}' for name in others)
        return f'{service.node} is not running: nobody offers {full}' + (
            f'; it is there under {hint}' if hint else ''
        )
