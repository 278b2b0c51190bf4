"""
The node that plays a recording to the running nodes, as if the rig were there.

It publishes the measurements and `/clock`, never an estimate and never a set
point: a recording must not drive a rig. For the same reason it refuses to start
where anybody else publishes one of these topics.
"""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock

from hunt_ros.bag import ChannelSource, read_record
from hunt_ros.bag.clocks import going_on
from hunt_ros.bag.record_writer import messages_of
from hunt_ros.errors import BagError, ConfigError
from hunt_ros.nodes.support.conversions import to_time
from hunt_ros.nodes.support.diagnostics import Health
from hunt_ros.nodes.support.hearing import UNNAMED, Calls, Said
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.parameters import declare
from hunt_ros.nodes.support.qos import announce
from hunt_ros.samples import NANOSECONDS, Record, Series
from hunt_ros.sensors import DISPLACEMENTS, MOTION
from hunt_ros.settings import Settings, fixed, setting
from hunt_ros.suite import PAGE

_CLOCK_S = 0.01
_LOOK_S, _DISCOVERY_ROUNDS = 0.1, 20
_LISTENERS_S = 20.0
#: They show and keep what is there, and judge nothing: a replay does not begin for them.
_ONLOOKERS = (PAGE, 'bag_recorder')
#: A longer gap between two looks at the clock is a process that was stopped.
_PAUSE_NS = NANOSECONDS


@dataclass(frozen=True)
class ReplayConfig(Settings):
    """Parameters of the replay."""

    bag: str = fixed('', 'Recording to play.')
    channels: tuple[str, ...] = fixed((), 'NAME=SOURCE for recordings with other topics.')
    rate: float = setting(1.0, 'Recorded seconds in a second.', low=0.1, high=50.0)
    from_s: float = fixed(0.0, 'Where to begin.', unit='s', low=0.0)
    to_s: float = fixed(math.inf, 'Where to end; inf: at the end.', unit='s', low=0.0)


class LiveReplayNode(SuiteNode):
    """Plays the channels of a recording, and `/clock`."""

    def __init__(self) -> None:
        super().__init__('live_replay')
        self._config = config = declare(self, ReplayConfig, partial(setattr, self, '_config'))
        if not config.bag:
            raise ConfigError('live_replay: the parameter bag names no recording')
        record = read_record(config.bag, [ChannelSource.parse(word) for word in config.channels])
        for told in filter(None, map(record.notes.get, ('bursts', 'problems'))):
            self.get_logger().warning(told)
        record = Record({n: Series(going_on(x.stamps_ns), x.values) for n, x in record.items()})
        if not set(DISPLACEMENTS) & set(record):
            raise BagError(f'{config.bag}: neither {" nor ".join(DISPLACEMENTS)} in it')
        self._began_ns, self._length_s = record.start_ns, record.duration_s
        to_s = min(config.to_s, record.duration_s)
        begin_ns = self._began_ns + round(config.from_s * NANOSECONDS)
        end_ns = self._began_ns + round(to_s * NANOSECONDS)
        part = record.between(begin_ns, end_ns + 1)
        if not any(map(len, part.values())):
            raise ConfigError(f'replay: no message from {config.from_s:g} s to {to_s:g} s')
        self._first_ns, self._last_ns = part.start_ns, part.end_ns
        self._at_ns, self._playing, self._finished = begin_ns, False, False
        self._names = tuple(record)
        for _ in range(_DISCOVERY_ROUNDS):
            time.sleep(_LOOK_S)
            if company := self._company(ours=0):
                raise ConfigError(company)
        self._clock_publisher = announce(self, '/clock')
        self._outputs: list[Publisher] = []
        self._messages = messages_of(part, self._output, '')
        self._heard = False
        Calls(self, {'pause-replay': self._pause, 'resume-replay': self._resume})
        self.work('replay', self._play)

    def _company(self, ours: int) -> str:
        """
        Return one line on another publisher of these topics; empty where there is none.

        Publishers are counted, not told apart by the names of their nodes: another replay
        has the same name. `ours` is how many of each are our own.
        """
        for topic in (*map(self.resolve_topic_name, self._names), '/clock'):
            if self.count_publishers(topic) > ours:
                return f'{topic} is published by another node: a recording must not mix with a rig'
        return ''

    def _output(self, topic: str, kind: str) -> int:
        """Publish a topic from now on; return its number."""
        self._outputs.append(announce(self, topic.lstrip('/')))
        return len(self._outputs) - 1

    def _somebody_listens(self) -> bool:
        """Return True if a node takes the motion for more than to show or to keep it."""
        return any(
            info.node_name not in _ONLOOKERS and UNNAMED not in info.node_name
            for name in MOTION
            for info in self.get_subscriptions_info_by_topic(name)
        )

    def _play(self, stopping: threading.Event) -> None:
        """Wait for listeners, then publish each message when it is due."""
        deadline = time.monotonic() + _LISTENERS_S
        while not (self._somebody_listens() or stopping.wait(_LOOK_S)):
            if time.monotonic() > deadline:
                self.get_logger().warning('nobody listens; playing all the same')
                break
        self._heard = True
        self._diagnostics.publish()  # who shows the first sample knows that it is a replay
        self._say_time(max(0, self._first_ns - 1))
        time.sleep(0.5)  # clocks of the listeners take the first time before the first sample
        self._playing, following = True, next(self._messages, None)
        checked_ns = before_ns = time.monotonic_ns()
        while not stopping.is_set():
            passed_ns = time.monotonic_ns() - before_ns
            before_ns += passed_ns
            if before_ns - checked_ns > NANOSECONDS:  # somebody may have come since
                checked_ns, self.failed = before_ns, self._company(ours=1)
                if self.failed:
                    return
            # Where the process was stopped it goes on, or all of it would come at once.
            if self._playing and passed_ns <= _PAUSE_NS:
                reached_ns = self._at_ns + round(passed_ns * self._config.rate)
                self._at_ns = min(reached_ns, self._last_ns)
            while following is not None and following[1] <= self._at_ns:
                self._outputs[following[0]].publish(following[2])
                following = next(self._messages, None)
            self._say_time(self._at_ns)
            if following is None:
                self._finished = True
                break
            ahead_s = (following[1] - self._at_ns) / NANOSECONDS
            time.sleep(max(1e-3, min(_CLOCK_S, ahead_s / self._config.rate)))
        self.get_logger().info('the recording has been played')

    def _say_time(self, stamp_ns: int) -> None:
        self._clock_publisher.publish(Clock(clock=to_time(stamp_ns)))

    def _pause(self, said: Said) -> str:
        self._playing = False
        return ''

    def _resume(self, said: Said) -> str:
        self._playing = True
        return ''

    def _health(self) -> Health:
        at_s, finished = (self._at_ns - self._began_ns) / NANOSECONDS, self._finished
        values: dict[str, object] = {
            'bag': Path(self._config.bag).name,
            'length_s': self._length_s,
            'finished': finished,
        }
        if finished:
            return 'OK', 'finished', values | {'position_s': values['length_s']}
        if not self._heard:
            return 'OK', 'waiting for a listener', values | {'listening': False}
        text = f'at {at_s:.1f} s' if self._playing else f'paused at {at_s:.1f} s'
        values |= {'playing': self._playing, 'rate': self._config.rate}
        return 'OK', text, values | {'position_s': at_s}


make_node = LiveReplayNode
