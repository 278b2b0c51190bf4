"""How topics and calls are heard: polled, many at a time, and what never came is counted."""

from __future__ import annotations

import json
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from hunt_ros.errors import HuntError, one_line
from hunt_ros.nodes.support.conversions import ChannelReader
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.qos import MEASUREMENTS, OVERRIDABLE, stream
from hunt_ros.samples import NANOSECONDS
from hunt_ros.services import SERVICES, spoken
from hunt_ros.suite import AGAIN

#: Sensor nodes that start together have all begun to publish this long after the first, s; beside
#: a node that is started again they are there, and it is blind for as long as it waits.
_TOGETHER_S, _THERE_S = 5.0, 1.0
#: Words that came longer ago than this do not belong to a call that comes now, s.
_FRESH_S = 5.0
#: A message that cannot be read is said, and others for so long are not, s.
_SAID_S = 60.0
#: In the name of a node that has just been found, or was killed: its own is not known.
UNNAMED = 'UNKNOWN_'
#: So many calls of one service are waited for at once, and what is said with them kept.
_CALLS = 5


def waiting(subscription: Subscription) -> Iterator[tuple[Any, dict[str, Any]]]:
    """
    Take what waits in the reader of a subscription, and no more than it holds.

    Parameters
    ----------
    subscription : Subscription
        Made by `create_polled_subscription`.

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
    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node, self._topic = node, topic
        self.count = 0  # messages that were missed
        self._last = 0  # number of the last message; 0: none yet

    def take(self, info: dict[str, Any]) -> int:
        """Get what `waiting` says of the next message; return how many are missing before it."""
        number = info['publication_sequence_number']
        missing = number - self._last - 1 if self._last else 0
        self._last = number
        # A publisher that was started again begins anew.
        if missing <= 0 or self._node.count_publishers(self._topic) != 1:
            return 0
        self.count += missing
        return missing


class Channels:
    """
    Hears the channels of a rig, and hands over their samples.

    It begins when all of them are there: a sensor that starts a second after another one is not
    silent. What is missing `_TOGETHER_S` or `_THERE_S` after the first is not waited for.

    Parameters
    ----------
    node : SuiteNode
        Gets the subscriptions.
    channels : sequence of str
        Topics: the names of the channels.
    quality : QoSProfile, optional
        For every publisher; by default reliable, which the parameters `qos_overrides` change.

    Attributes
    ----------
    received, unreadable : int
        Samples handed over; messages without the expected joint, or that cannot be read.
    """

    def __init__(
        self, node: SuiteNode, channels: Sequence[str], quality: QoSProfile | None = None
    ) -> None:
        self.received = self.unreadable = 0
        self._node = node
        self._readers = {channel: ChannelReader(channel) for channel in channels}
        self._heard = {
            channel: node.create_polled_subscription(
                reader.kind,
                channel,
                quality or stream(MEASUREMENTS),
                raw=True,
                qos_overriding_options=None if quality else OVERRIDABLE,
            )
            for channel, reader in self._readers.items()
        }
        self._missed = {name: Missed(node, each.topic_name) for name, each in self._heard.items()}
        self._began_s, self._absent = 0.0, set(self._heard)
        self._together_s = _THERE_S if AGAIN in os.environ else _TOGETHER_S

    @property
    def missed(self) -> int:
        """Messages that were lost on their way here."""
        return sum(each.count for each in self._missed.values())

    def begun(self) -> bool:
        """Return True once samples are handed over; those of before are left out."""
        if not self._absent:
            return True
        for channel, subscription in self._heard.items():
            if list(waiting(subscription)):
                self._absent.discard(channel)
                self._began_s = self._began_s or time.monotonic()
        if self._began_s and time.monotonic() - self._began_s > self._together_s:
            self._absent.clear()
        return not self._absent

    def take(self) -> Iterator[tuple[str, np.ndarray, np.ndarray, Sequence[int]]]:
        """Hand over what has come: channel, stamps (ns), values, and when it came (ns)."""
        for channel, subscription in self._heard.items():
            read, missed = self._readers[channel].read, self._missed[channel]
            samples = []
            for wire, info in waiting(subscription):
                missed.take(info)
                if (sample := read(wire)) is None:
                    self.unreadable += 1
                    said = f'{subscription.topic_name}: a message cannot be read as {channel}'
                    self._node.get_logger().warning(said, throttle_duration_sec=_SAID_S)
                else:
                    samples.append((*sample, info['received_timestamp'] or time.time_ns()))
            self.received += len(samples)
            if samples:
                stamps, values, came_ns = zip(*samples, strict=True)
                yield channel, np.array(stamps, dtype=np.int64), np.array(values), came_ns

    def publishers(self, channel: str) -> tuple[str, list[str]]:
        """
        Return the full names of the topic of a channel, and of the nodes that publish it.

        A killed node stays in the graph for 20 s, nameless or beside the one that was started in
        its place: each name counts once. Nodes of one name say so themselves (`diagnostics`).
        """
        topic = self._heard[channel].topic_name
        found = self._node.get_publishers_info_by_topic(topic)
        names = {f'{p.node_namespace.rstrip("/")}/{p.node_name}' for p in found}
        return topic, sorted({name for name in names if UNNAMED not in name} or names)

    def problem(self) -> str:
        """Return what is wrong with the publishers of the channels, and what to do; or ''."""
        return '; '.join(filter(None, map(self._problem, self._heard)))

    def _problem(self, channel: str) -> str:
        topic, names = self.publishers(channel)
        if len(names) > 1:
            return (
                f'{topic} has {len(names)} publishers ({", ".join(names)}), expected one: end the'
                ' others, or give the second rig another namespace'
            )
        found = self._node.get_publishers_info_by_topic(topic)
        ways = [self._heard[channel].qos_profile, *(each.qos_profile for each in found)]
        heard, *said = [way.reliability == ReliabilityPolicy.BEST_EFFORT for way in ways]
        if heard or not any(said):
            return ''
        return (
            f'{topic} is published with best effort and not heard: set the parameter'
            f' qos_overrides.{topic}.subscription.reliability to best_effort'
        )


class Said(NamedTuple):
    """Who called a service, and the words that went with it; '' where nobody said."""

    who: str = ''
    words: str = ''


class Calls:
    """
    The services that a node offers, and what was said with each call on its topic `NODE/calls`.

    Parameters
    ----------
    node : SuiteNode
    answers : mapping of str to callable
        Of each service, by its word in `SERVICES`, what does the work: it gets what was said, and
        returns the message of the answer; an error is the answer of a service that failed.
    beside : collection of str
        Those of them that are answered one by one in a thread of their own.
    """

    def __init__(
        self,
        node: SuiteNode,
        answers: Mapping[str, Callable[[Said], str]],
        beside: Collection[str] = (),
    ) -> None:
        topic = f'{node.get_name()}/calls'
        self._subscription = node.create_polled_subscription(String, topic, stream(10))
        self._answers, self._logger = answers, node.get_logger()
        self._said = {word: deque[tuple[int, Said]](maxlen=_CALLS) for word in answers}
        self._taking = threading.Lock()
        self._offer([word for word in answers if word not in beside], node)
        if beside:
            node.beside('services', partial(self._offer, beside))

    def _offer(self, offered: Iterable[str], node: Node) -> None:
        named: dict[str, dict[str, str]] = {}
        for word in offered:
            named.setdefault(SERVICES[word].name, {})[SERVICES[word].switch] = word
        for name, words in named.items():
            kind = Trigger if '' in words else SetBool
            node.create_service(kind, name, partial(self._answer, words))

    def _answer(self, words: Mapping[str, str], request: Any, response: Any) -> Any:
        """Fill in the answer; what fails is the answer too."""
        word = words['' if '' in words else 'on' if request.data else 'off']
        try:
            response.success, response.message = True, self._answers[word](self.take(word))
        except HuntError as error:
            response.success, response.message = False, str(error)
        except Exception as error:  # any other would end the thread, and every service
            response.success, response.message = False, one_line(error)
            self._logger.error(f'{word}: {response.message}')
        return response

    def take(self, service: str) -> Said:
        """Return what came last for a word of `SERVICES`, once; nothing if that is long ago."""
        with self._taking:
            for message, info in waiting(self._subscription):
                # Not all middleware says when it came; and anybody may publish anything.
                came_ns = info['received_timestamp'] or time.time_ns()
                with suppress(ValueError, TypeError, KeyError, RecursionError):
                    told = json.loads(message.data)
                    said = Said(*(spoken(str(told[name])) for name in Said._fields))
                    self._said[str(told['service'])].append((came_ns, said))
            # Of two that call at once each gets words: one call takes the last, and one the other.
            kept = self._said[service]
            came_ns, said = kept.pop() if kept else (0, Said())
        return said if (time.time_ns() - came_ns) / NANOSECONDS < _FRESH_S else Said()
