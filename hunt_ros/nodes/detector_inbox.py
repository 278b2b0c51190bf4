"""
What the detector node has heard and not yet handed over: one list of samples a channel.

Callbacks only take messages apart. When every channel has reached the next hand-over,
or one of them is well beyond it, the node is told that it is time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from geometry_msgs.msg import TwistStamped
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from hunt_ros.nodes.conversions import JointReader, SpeedReader
from hunt_ros.nodes.qos import OVERRIDABLE, mute_publishers, stream

#: A channel that lags by more than this is not waited for before the others are handed over.
_LAG_NS = 20_000_000
#: One second of the fastest sensor.
_DEPTH = 2000


class DetectorInbox:
    """
    Subscribes to the channels of the rig, as bytes, and collects their samples.

    Parameters
    ----------
    node : Node
        Gets the subscriptions.
    channels : sequence of str
        Topics: the names of the channels.
    hand_over_ns : int
        How often samples are handed over: most of what a hand-over costs does not depend on how
        many samples it takes.
    ready : callable
        Called when the samples of a hand-over have come: it empties the inbox.

    Attributes
    ----------
    received, unreadable : int
        Samples handed over; messages without the expected joint.
    """

    def __init__(
        self, node: Node, channels: Sequence[str], hand_over_ns: int, ready: Callable[[], None]
    ) -> None:
        self.received = 0
        self.unreadable = 0
        self._node = node
        self._hand_over_ns = hand_over_ns
        self._ready = ready
        self._samples: dict[str, tuple[list[int], list[float]]] = {
            name: ([], []) for name in channels
        }
        self._newest_ns = dict.fromkeys(channels, 0)
        self._next_ns = 0
        self._inputs: list[tuple[Subscription, Callable[[bytes], None]]] = []
        for channel in channels:
            if channel == 'speed':
                kind, reader = TwistStamped, SpeedReader()
            else:
                kind, reader = JointState, JointReader(channel)
            receive = self._receiver(channel, reader)
            subscription = node.create_subscription(
                kind,
                channel,
                receive,
                stream(_DEPTH),
                raw=True,
                qos_overriding_options=OVERRIDABLE,
            )
            self._inputs.append((subscription, receive))

    def mute(self) -> str:
        """Return what to do about publishers that these subscriptions cannot hear; or ''."""
        found = (mute_publishers(self._node, subscription) for subscription, _ in self._inputs)
        return '; '.join(filter(None, found))

    def clear(self) -> None:
        """Forget what has been heard."""
        for stamps, values in self._samples.values():
            stamps.clear()
            values.clear()

    def empty(self) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """Hand over what has been heard: channel, stamps (ns), values."""
        passed = max(self._newest_ns.values()) // self._hand_over_ns
        self._next_ns = (passed + 1) * self._hand_over_ns
        for channel, (stamps, values) in self._samples.items():
            if stamps:
                block = channel, np.array(stamps, dtype=np.int64), np.array(values)
                self.received += len(stamps)
                stamps.clear()
                values.clear()
                yield block

    def take_waiting(self) -> None:
        """
        Take what still waits in the readers, so that no backlog is mistaken for silence.

        The EventsExecutor takes one message an event: messages whose event was lost
        would stay in the reader, and everything after them would come late for ever.
        """
        for subscription, receive in self._inputs:
            with subscription.handle:
                while True:
                    taken = subscription.handle.take_message(subscription.msg_type, True)
                    if taken is None:
                        break
                    receive(taken[0])

    def _receiver(
        self, channel: str, reader: JointReader | SpeedReader
    ) -> Callable[[bytes], None]:
        stamps, values = self._samples[channel]
        newest = self._newest_ns

        def receive(wire: bytes) -> None:
            found = reader.read(wire)
            if found is None:
                self.unreadable += 1
                return
            stamp_ns, value = found
            stamps.append(stamp_ns)
            values.append(value)
            newest[channel] = stamp_ns
            if stamp_ns >= self._next_ns and (
                stamp_ns >= self._next_ns + _LAG_NS or min(newest.values()) >= self._next_ns
            ):
                self._ready()

        return receive
