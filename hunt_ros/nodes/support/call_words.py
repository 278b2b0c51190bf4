"""
Words that go with the call of a service: a name, a remark.

A Trigger request carries none. Who calls publishes them on a topic first, and the node that
offers the service takes them from there when it is called.
"""

from __future__ import annotations

import time

from std_msgs.msg import String

from hunt_ros.nodes.support.polled import Polling, waiting
from hunt_ros.nodes.support.qos import stream
from hunt_ros.samples import NANOSECONDS
from hunt_ros.services import spoken

#: Words that came longer ago than this do not belong to a call that comes now, s.
_FRESH_S = 5.0


class CallWords:
    """
    Listens to the words of one service.

    Parameters
    ----------
    node : Polling
        Which offers the service.
    topic : str
        std_msgs/String, below the namespace.
    """

    def __init__(self, node: Polling, topic: str) -> None:
        self._subscription = node.create_polled_subscription(String, topic, stream(10))

    def take(self) -> str:
        """
        Take what has come since the last call, in the thread of the node.

        Returns
        -------
        str
            The last of it in one line; '' where nothing came, or too long ago.
        """
        words = ''
        for message, info in waiting(self._subscription):
            came_ns = info['received_timestamp'] or time.time_ns()  # not all middleware says when
            age_s = (time.time_ns() - came_ns) / NANOSECONDS
            words = spoken(message.data) if age_s < _FRESH_S else ''
        return words
