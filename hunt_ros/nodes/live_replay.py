"""
The node that plays a recording to the running nodes, as if the rig were there.

It publishes the measurements and `/clock`, never an estimate and never a set
point: a recording must not drive a rig. For the same reason it refuses to start
where anybody else publishes one of these topics.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import TwistStamped
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from hunt_ros.bag import ChannelSource, read_record
from hunt_ros.bag.replay_schedule import ReplaySchedule
from hunt_ros.errors import BagError, ConfigError
from hunt_ros.nodes.conversions import joint_layout, to_time, twist_layout
from hunt_ros.nodes.diagnostics import Diagnostics, Health
from hunt_ros.nodes.parameters import declare, warn_unknown
from hunt_ros.nodes.qos import stream
from hunt_ros.samples import CHANNELS, NANOSECONDS
from hunt_ros.settings import Settings, setting

_CLOCK_S = 0.01
_DISCOVERY_S = 2.0
_LISTENERS_S = 20.0
_NAMELESS = '_NODE_NAME_UNKNOWN_'


@dataclass(frozen=True)
class ReplayConfig(Settings):
    """Parameters of the replay."""

    bag: str = setting('', 'Recording to play.', fixed=True)
    channels: tuple[str, ...] = setting(
        ('',), 'NAME=SOURCE for recordings with other topics.', fixed=True
    )
    rate: float = setting(1.0, 'Recorded seconds in a second.', low=0.1, high=50.0)
    from_s: float = setting(0.0, 'Where to begin.', unit='s', low=0.0, fixed=True)
    to_s: float = setting(-1.0, 'Where to end; negative: at the end.', unit='s', fixed=True)
    loop: bool = setting(False, 'Begin anew at the end.', fixed=True)
    wait_for_listener: bool = setting(
        True, 'Wait until somebody listens before playing.', fixed=True
    )
    seek_s: float = setting(0.0, 'Set it to go there, seconds from the start.', unit='s', low=0.0)
    frame_id: str = setting('roller_rig', 'frame_id of the messages.', fixed=True)


class LiveReplayNode(Node):
    """Plays `lateral`, `yaw`, `roller`, `speed` and `/clock`."""

    def __init__(self) -> None:
        super().__init__('live_replay')
        self._config = declare(self, ReplayConfig)
        warn_unknown(self)
        if not self._config.bag:
            raise ConfigError('live_replay: the parameter bag names no recording')
        self._read()
        end = None if self._config.to_s < 0.0 else self._config.to_s
        self._schedule = ReplaySchedule(
            self._stamps,
            rate=self._config.rate,
            from_s=self._config.from_s,
            to_s=end,
            loop=self._config.loop,
        )
        self._refuse_company()
        self._clock_publisher = self.create_publisher(Clock, '/clock', stream(100))
        self._outputs = [self._output(name) for name in self._names]
        self._lock = threading.Lock()
        self.finished = False
        self.failed = ''
        self._heard = False
        for name in ('pause', 'resume'):
            self.create_service(Trigger, f'replay/{name}', getattr(self, f'_on_{name}'))
        self.add_post_set_parameters_callback(self._on_parameters)
        self._diagnostics = Diagnostics(self, self._health)
        self._running = threading.Event()
        self._running.set()
        self._thread = threading.Thread(target=self._work, name='replay', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop playing."""
        self._running.clear()
        self._thread.join(timeout=2.0)

    def _read(self) -> None:
        """Read the measurements and put them into one order, that of their stamps."""
        sources = [ChannelSource.parse(word) for word in self._config.channels if word]
        record = read_record(self._config.bag, sources)
        self._names = [name for name in CHANNELS if name in record]
        if not {'lateral', 'yaw'} & set(self._names):
            raise BagError(f'{self._config.bag}: neither lateral nor yaw in it')
        stamps = np.concatenate([record[name].stamps_ns for name in self._names])
        values = np.concatenate([record[name].values for name in self._names])
        which = np.concatenate([np.full(len(record[n]), k) for k, n in enumerate(self._names)])
        order = np.argsort(stamps, kind='stable')
        self._stamps, self._values = stamps[order], values[order].tolist()
        self._which = which[order].tolist()

    def _refuse_company(self) -> None:
        """Fail where another publisher exists of what is about to be published."""
        deadline = time.monotonic() + _DISCOVERY_S
        while time.monotonic() < deadline:
            time.sleep(0.1)
            company = self._company()
            # A name may be discovered a moment after the publisher it belongs to.
            if company and ('another node' not in company or time.monotonic() > deadline - 0.5):
                raise ConfigError(company)

    def _company(self) -> str:
        """Return one line on another publisher of these topics; empty where there is none."""
        topics = [self.resolve_topic_name(name) for name in self._names] + ['/clock']
        for topic in topics:
            publishers = self.get_publishers_info_by_topic(topic)
            others = sorted({info.node_name for info in publishers} - {self.get_name()})
            if others:
                names = ', '.join(others).replace(_NAMELESS, 'another node')
                return (
                    f'{topic} is published by {names} already: a recording must not mix with a rig'
                )
        return ''

    def _output(self, name: str) -> Callable[[int, float], None]:
        """Return a function that publishes (stamp, value) of a channel."""
        if name == 'speed':
            publisher = self.create_publisher(TwistStamped, name, stream(1000))
            layout, rest = twist_layout(self._config.frame_id), (0.0,) * 5
        else:
            publisher = self.create_publisher(JointState, name, stream(2000))
            layout, rest = joint_layout([name], self._config.frame_id), ()
        return lambda stamp_ns, value: publisher.publish(layout.encode(stamp_ns, value, *rest))

    def _work(self) -> None:
        deadline = time.monotonic() + _LISTENERS_S
        while self._config.wait_for_listener and self._running.is_set():
            if any(self.count_subscribers(name) for name in ('lateral', 'yaw')):
                break
            if time.monotonic() > deadline:
                self.get_logger().warning('nobody listens; playing all the same')
                break
            time.sleep(0.1)
        self._heard = True
        self._clock_publisher.publish(Clock(clock=to_time(int(self._stamps[0]) - 1)))
        time.sleep(0.5)  # clocks of the listeners take the first time before the first sample
        with self._lock:
            self._schedule.play(time.monotonic_ns())
        stamps = self._stamps.tolist()
        checked_ns = 0
        while self._running.is_set() and not self._schedule.finished:
            now_ns = time.monotonic_ns()
            if now_ns - checked_ns > NANOSECONDS:  # somebody may have come since
                checked_ns, self.failed = now_ns, self._company()
                if self.failed:
                    return
            with self._lock:
                due = self._schedule.due(now_ns)
                reached_ns = self._schedule.time_ns(now_ns)
                wait_ns = self._schedule.wait_ns(now_ns)
            for i in range(due.begin, due.end):
                self._outputs[self._which[i]](stamps[i], self._values[i])
            self._clock_publisher.publish(Clock(clock=to_time(reached_ns)))
            pause_s = _CLOCK_S if wait_ns is None else min(_CLOCK_S, wait_ns / NANOSECONDS)
            time.sleep(max(1e-3, pause_s))
        self.finished = True
        self.get_logger().info('the recording has been played')

    def _on_pause(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self._lock:
            self._schedule.pause(time.monotonic_ns())
        response.success = True
        return response

    def _on_resume(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self._lock:
            self._schedule.play(time.monotonic_ns())
        response.success = True
        return response

    def _on_parameters(self, parameters) -> None:
        """Take a new rate or go to another place."""
        now_ns = time.monotonic_ns()
        with self._lock:
            for parameter in parameters:
                if parameter.name == 'rate':
                    self._schedule.set_rate(now_ns, parameter.value)
                elif parameter.name == 'seek_s':
                    self._schedule.seek(now_ns, parameter.value)

    def _health(self) -> Health:
        if self.finished:
            return 'OK', 'finished', {'finished': True}
        if not self._heard:
            return 'OK', 'waiting for a listener', {'listening': False}
        with self._lock:
            playing = self._schedule.playing
            at_s = (
                self._schedule.time_ns(time.monotonic_ns()) - int(self._stamps[0])
            ) / NANOSECONDS
        text = f'at {at_s:.1f} s' if playing else f'paused at {at_s:.1f} s'
        return 'OK', text, {'finished': False, 'position_s': at_s}


make_node = LiveReplayNode
