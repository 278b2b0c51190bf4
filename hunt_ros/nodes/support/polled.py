"""
Subscriptions that a node empties itself, many messages at a time.

An executor has an event for every message. At some thousand messages a second that is most of
what a node does, and on a machine that cannot keep up the events queue without a bound: a call
of a service, which has its place behind them, is never answered. Taken from the reader at the
node's own pace a message costs half as much, what waits is bounded by the depth of the reader,
and the executor is free for everything else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription


class Polling(Node):
    """
    A node of which some subscriptions are not for the executor.

    To stand first in the bases: executors ask a node for its `subscriptions`.
    """

    _polled: frozenset[Subscription] = frozenset()

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """The subscriptions that an executor waits for."""
        return (each for each in super().subscriptions if each not in self._polled)

    def create_polled_subscription(
        self, kind: type, topic: str, *args: Any, **keywords: Any
    ) -> Subscription:
        """Subscribe like `create_subscription`, without a callback: see `waiting`."""
        subscription = self.create_subscription(kind, topic, _never, *args, **keywords)
        self._polled |= {subscription}
        return subscription


def waiting(subscription: Subscription) -> Iterator[tuple[Any, dict[str, Any]]]:
    """
    Take what waits in the reader of a subscription, and no more than it holds.

    Parameters
    ----------
    subscription : Subscription
        Made by `create_polled_subscription`, or an ordinary one that must not lag behind.

    Yields
    ------
    message : bytes or message
        Bytes where the subscription is raw.
    info : dict
        `source_timestamp`, `received_timestamp` (ns) and `publication_sequence_number`. In the
        order of the messages no `received_timestamp` is before an earlier one: what came
        early waited for one that was sent again.
    """
    handle = subscription.handle
    received_ns = 0
    with handle:
        for _ in range(max(1, subscription.qos_profile.depth)):
            taken = handle.take_message(subscription.msg_type, subscription.raw)
            if taken is None:
                return
            # Since Kilted the middleware says when a message came in, not when it was its turn.
            received_ns = max(received_ns, taken[1]['received_timestamp'])
            taken[1]['received_timestamp'] = received_ns
            yield taken


class Missed:
    """
    Counts the messages of a topic that were published and never came.

    A writer keeps its last messages for readers that missed some; a reader that was held up for
    longer does not get them, and the middleware does not say so. Each publisher numbers its
    messages: where there are several, nothing is counted.

    Parameters
    ----------
    publishers : callable
        Returns how many publishers the topic has now.

    Attributes
    ----------
    count : int
        Messages that were missed.
    """

    def __init__(self, publishers: Callable[[], int]) -> None:
        self.count = 0
        self._publishers = publishers
        self.restart()

    def restart(self) -> None:
        """Take the next message for the first one: those before it were not asked for."""
        self._last = 0

    def take(self, info: dict[str, Any]) -> int:
        """Get what `waiting` says of the next message; return how many are missing before it."""
        number = info['publication_sequence_number']
        missing = number - self._last - 1 if self._last else 0
        self._last = number
        # A publisher that was started again begins anew.
        if missing <= 0 or self._publishers() != 1:
            return 0
        self.count += missing
        return missing


def _never(message: object) -> None:
    raise AssertionError('a polled subscription was given to an executor')
