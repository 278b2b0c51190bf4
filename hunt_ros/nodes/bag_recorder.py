"""
The node that records: everything the rig says, its parameters, and the operator's marks.

Messages are taken from raw subscriptions, many at a time, and stored as they were on the wire
in the order in which they came.
The topics of the design are subscribed from the start; others are picked up as
they appear. The estimates are left out unless asked for: a replay makes them again.
No subscription and no client is destroyed while the node spins: the EventsExecutor
can crash on what is gone (ros2/rclpy #1644).
"""

from __future__ import annotations

import shutil
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, fields
from datetime import datetime
from functools import partial
from importlib import import_module
from operator import itemgetter
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar, cast

from rclpy.clock import ROSClock
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.subscription import Subscription
from std_msgs.msg import String

from hunt_ros.bag.messages import DIAGNOSTIC_ARRAY, STRING
from hunt_ros.bag.recording import Recording, RecordingLimits, RecordingState
from hunt_ros.bag.repair import finalise_left
from hunt_ros.errors import BagError
from hunt_ros.nodes.support.call_words import CallWords
from hunt_ros.nodes.support.diagnostics import Diagnostics, Health, steady_clock
from hunt_ros.nodes.support.estimate_publishers import ESTIMATES
from hunt_ros.nodes.support.parameter_collector import ParameterCollector
from hunt_ros.nodes.support.parameters import declare, warn_unknown
from hunt_ros.nodes.support.polled import Missed, Polling, waiting
from hunt_ros.nodes.support.qos import JOURNAL, MEASUREMENTS, latched, stream
from hunt_ros.nodes.support.sole import hold_name
from hunt_ros.nodes.support.worker import Worker, answer_aside
from hunt_ros.rig import of_rig
from hunt_ros.sensors import CHANNEL_FIELDS, TWIST_STAMPED
from hunt_ros.services import SERVICES
from hunt_ros.settings import setting
from hunt_ros.suite import Awaited

#: What the operator wrote; the service of this name marks the moment of its call.
_MARK_TOPIC = 'recording/mark'
#: Subscribed before their publishers appear, so that their first message is in the bag.
DESIGN_TOPICS: dict[str, str] = {
    **{channel: kind for channel, (kind, _) in CHANNEL_FIELDS.items()},
    'speed/target': TWIST_STAMPED,
    'hunting/events': DIAGNOSTIC_ARRAY,
    'hunting/status': DIAGNOSTIC_ARRAY,
    _MARK_TOPIC: STRING,
    'hunting/acknowledged_by': STRING,
    '/diagnostics': DIAGNOSTIC_ARRAY,
}
#: What they offer that are latched; a late look at the graph corrects a wrong guess.
LATCHED_TOPICS: dict[str, str] = {
    'hunting/normal_form': STRING,
    'hunting/journal': STRING,
    'hunting/alarms': STRING,
    'speed/status': DIAGNOSTIC_ARRAY,
}
#: Of the whole graph, recorded beside the namespace of the rig.
GLOBAL_TOPICS = ('/diagnostics', '/parameter_events', '/rosout')
OWN_TOPIC = 'recording/closed'
#: Not recorded: it would name the recording in itself; and words, which the mark says.
_LEFT_OUT = (OWN_TOPIC, SERVICES['mark'].words_topic)

_WITHOUT_CLOCK = 2000
#: How many messages of a latched topic its publisher keeps for who comes late; of the log the
#: last lines. The graph does not tell it of a topic that is not of the design.
_LATCHED_KEPT = {
    **dict.fromkeys(LATCHED_TOPICS, 1),
    'hunting/journal': JOURNAL.depth,
    '/rosout': 100,
}
_FOREIGN_KEPT = 1000
#: What a reader missed is sent again after the heartbeat of its writer, every 3 s by default.
_RESENT_S = 3.5
#: The longest wait for what was published before a stop, s: clocks of hosts may differ.
_LATE_S = 6.0
_ROUND_S = 0.05
#: A recording that cannot be is tried again after this, s.
_AGAIN_S = 5.0

_Result = TypeVar('_Result')
#: When a message came and when it was published, ns.
_TIMES = itemgetter(0, 1)
#: When a message was published, ns, and which one of its publisher it is.
_Mark = tuple[int, int]


@dataclass(frozen=True)
class RecorderConfig(RecordingLimits):
    """Parameters of the recorder."""

    directory: str = setting('./recordings', 'Where the recordings go.', fixed=True)
    rig_name: str = of_rig('rig_name')
    operator: str = setting('', 'Who runs it, for the recording.')
    notes: str = setting('', 'Remarks, for the recording.')
    autostart: bool = setting(True, 'Record from the start.', fixed=True)
    prefix: str = setting('hunt', 'Beginning of the names of recordings.')
    compression: str = setting(
        'zstd', 'Of the chunks.', choices=('none', 'lz4', 'zstd'), fixed=True
    )
    record_estimates: bool = setting(
        False, 'Record the estimates too; a replay makes them again.', fixed=True
    )
    extra_topics: tuple[str, ...] = setting(
        (), 'Full names of topics outside of the namespace to record as well.', fixed=True
    )


class BagRecorderNode(Polling, Node):
    """Subscribes to what there is, and hands it to a `Recording`."""

    #: Writing what waits takes as long as the disk takes, s.
    closing_s = 60.0

    def __init__(self) -> None:
        super().__init__('bag_recorder')
        hold_name(self)
        self._config = declare(self, RecorderConfig, self._reconfigure)
        warn_unknown(self)
        self._recording: Recording | None = None
        self._finishing: Recording | None = None
        #: Work of services for the node's own thread.
        self._orders: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._heard: list[tuple[str, Subscription]] = []
        #: For how long the node has listened, s; a time in which it was held up is none.
        self._listened_s = 0.0
        #: By topic: when its newest message was published, system clock, ns, and `_listened_s`.
        self._newest: dict[str, tuple[int, float]] = {}
        #: Of topics that are subscribed in two ways: the last messages.
        self._twice: dict[str, dict[_Mark, None]] = {}
        self._missed: dict[str, Missed] = {}
        #: Ways in which a topic is subscribed: (reliable, latched).
        self._subscribed: dict[str, set[tuple[bool, bool]]] = {}
        self._kinds: dict[str, tuple[str, bool]] = {}
        self._keys: dict[str, int] = {}
        self._kept = {self._full(name): depth for name, depth in _LATCHED_KEPT.items()}
        #: What latched topics have said, for the recordings that begin later.
        self._said: dict[str, deque[bytes]] = {}
        self._early: deque[tuple[str, bytes]] = deque(maxlen=_WITHOUT_CLOCK)
        self._refused: set[str] = set()
        self._last = ('OK', 'no recording')
        self._closed = self.create_publisher(String, OWN_TOPIC, latched())
        self._mark = self.create_publisher(String, _MARK_TOPIC, stream(10))
        self._words = CallWords(self, SERVICES['mark'].words_topic)
        names = ('start', 'stop', 'split', 'mark')
        answers = {f'recording/{name}': getattr(self, f'_on_{name}') for name in names}
        self.create_timer(_ROUND_S, self._round, clock=steady_clock())
        self._diagnostics = Diagnostics(self, self._health)
        failed = self._diagnostics.failed
        self._answers = answer_aside(self, failed, answers)
        self.create_timer(0.25, self._look_around, clock=steady_clock())
        # A long repair of an earlier recording must not keep this one from beginning.
        Worker(failed, 'closing earlier recordings', self._finalise)
        self._collector = ParameterCollector(self, failed, self._note_parameters)
        #: A recording is wanted, and tried again at this time where it cannot be, steady clock.
        self._wanted, self._again_s = self._config.autostart, 0.0
        self._begin_if_wanted()

    def close(self) -> None:
        """Take what has arrived, and close the recording."""
        self._collector.close()
        self._answers.close(0.0)
        self._listen()
        try:
            if self._recording is not None:
                self._finish(self._take_away())
            elif self._finishing is not None:
                self._finishing.stop()  # a service is at it
        except BagError as error:
            self.get_logger().error(str(error))
        self._closed.wait_for_all_acked(Duration(seconds=0.5))

    def _reconfigure(self, config: RecorderConfig) -> None:
        """Take new settings, for the next recording."""
        self._config = config

    def _begin_if_wanted(self) -> None:
        """Begin the recording that is wanted; where it cannot be, say so and try again later."""
        if self._recording is not None or not self._wanted or time.monotonic() < self._again_s:
            return
        try:
            self._begin()
        except BagError as error:
            self._again_s = time.monotonic() + _AGAIN_S
            if self._last != ('ERROR', str(error)):
                self.get_logger().error(f'nothing is recorded: {error}; trying again')
            self._last = ('ERROR', str(error))

    def _begin(self) -> Path:
        """Start a recording; what latched topics have said stands at its beginning."""
        limits = {item.name: getattr(self._config, item.name) for item in fields(RecordingLimits)}
        notes = {name: getattr(self._config, name) for name in ('operator', 'notes')}
        notes['rig'] = self._config.rig_name
        notes['started'] = f'{datetime.now().astimezone():%Y-%m-%dT%H:%M:%S%z}'
        notes['namespace'] = self.get_namespace()
        path = self._new_path()
        compression = self._config.compression.removeprefix('none')
        self._recording = Recording(
            path, RecordingLimits(**limits), notes=notes, compression=compression
        )
        self._collector.ask_again()
        self._keys = {
            name: self._recording.topic(name, kind, latched=is_latched)
            for name, (kind, is_latched) in self._kinds.items()
        }
        for name, wires in self._said.items():
            for raw in wires:
                self._take(name, raw)
        for names, is_latched in ((DESIGN_TOPICS, False), (LATCHED_TOPICS, True)):
            for name, kind in names.items():
                self._subscribe(self._full(name), kind, reliable=True, is_latched=is_latched)
        self._look_around()
        self._began_s = time.monotonic()
        self.get_logger().info(f'recording {path}')
        return path

    def _take_away(self) -> Recording:
        """Let no more messages into the recording."""
        self._finishing, self._recording = self._running(), None
        self._early.clear()
        return self._finishing

    def _finish(self, recording: Recording) -> Path:
        """Close a recording that was taken away; waits for the disk."""
        try:
            path = recording.stop()
        except BagError as error:
            self._last = ('ERROR', str(error))
            raise
        finally:
            self._finishing = None
        state = recording.state
        self._last = ('OK', f'closed {path.name}: {state.messages} messages')
        self._closed.publish(String(data=str(path.resolve())))
        self.get_logger().info(f'closed {path}')
        return path

    def _new_path(self) -> Path:
        """Return a folder of the moment's name that is not there yet."""
        base = (
            Path(self._config.directory) / f'{self._config.prefix}_{datetime.now():%Y%m%d_%H%M%S}'
        )
        path, number = base, 1
        while path.exists() or path.with_name(path.name + '.active').exists():
            path, number = base.with_name(f'{base.name}_{number}'), number + 1
        return path

    def _full(self, name: str) -> str:
        return name if name.startswith('/') else f'{self.get_namespace().rstrip("/")}/{name}'

    def _wants(self, name: str) -> bool:
        """Return True if a topic is to be recorded."""
        if name in map(self._full, _LEFT_OUT):
            return False
        estimated = any(name == self._full(topic.name) for topic in ESTIMATES)
        if estimated and not self._config.record_estimates:
            return False
        inside = name.startswith(self.get_namespace().rstrip('/') + '/')
        alone = self.get_namespace() == '/'
        return (
            (inside and not alone)
            or (alone and name != '/clock')
            or name in GLOBAL_TOPICS
            or name in self._config.extra_topics
        )

    def _look_around(self) -> None:
        """Pick up new topics; begin the recording again that could not be."""
        self._begin_if_wanted()
        if self._recording is None or self._has_ended():
            return
        for name, kinds in self.get_topic_names_and_types():
            if not self._wants(name):
                continue
            publishers = self.get_publishers_info_by_topic(name)
            if not publishers:
                continue
            offers = [info.qos_profile for info in publishers]
            reliable = all(qos.reliability != ReliabilityPolicy.BEST_EFFORT for qos in offers)
            is_latched = all(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL for qos in offers)
            self._subscribe(name, kinds[0], reliable=reliable, is_latched=is_latched)

    def _has_ended(self) -> bool:
        """Close a recording that ended by itself, as when the disk is full."""
        problem = '' if self._recording is None else self._recording.state.problem
        if not problem:
            return False
        self.get_logger().error(problem)
        try:
            self._finish(self._take_away())  # it has ended: nothing is waited for
        except BagError as error:
            self.get_logger().error(str(error))
        self._last = ('ERROR', problem)
        self._again_s = time.monotonic() + _AGAIN_S
        return True

    def _subscribe(self, name: str, kind: str, *, reliable: bool, is_latched: bool) -> None:
        """Subscribe unless an earlier subscription hears such publishers as well."""
        ways = self._subscribed.setdefault(name, set())
        recording = self._recording
        if recording is None or name in self._refused or (reliable, is_latched) in ways:
            return
        message_class = _message_class(kind)
        if message_class is None:
            self._refused.add(name)
            self.get_logger().warning(f'{name}: type {kind} is not installed, not recorded')
            return
        if ways and (reliable, is_latched) != (False, False):
            return  # an earlier subscription hears this publisher as well
        ways.add((reliable, is_latched))
        qos = stream(MEASUREMENTS)
        if not reliable:
            qos.reliability = ReliabilityPolicy.BEST_EFFORT
        if is_latched:
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
            self._said.setdefault(name, deque(maxlen=self._kept.get(name, _FOREIGN_KEPT)))
        if name not in self._kinds:
            self._kinds[name] = (kind, is_latched)
            self._keys[name] = recording.topic(name, kind, latched=is_latched)
        if len(ways) == 2:
            self._twice[name] = {}

        subscription = self.create_polled_subscription(message_class, name, qos, raw=True)
        self._heard.append((name, subscription))

    def _listen(self) -> None:
        """Take what has come on all topics, in the order in which it came."""
        come = [
            (info['received_timestamp'], info['source_timestamp'], name, raw)
            for name, subscription in self._heard
            for raw, info in waiting(subscription)
            if self._is_new(name, info)
        ]
        for received_ns, published_ns, name, raw in sorted(come, key=_TIMES):
            self._newest[name] = published_ns, self._listened_s
            if name in self._said:
                self._said[name].append(raw)
            self._take(name, raw, received_ns)

    def _is_new(self, name: str, info: dict[str, Any]) -> bool:
        """Return True if a message has not come by another subscription already."""
        known = self._twice.get(name)
        if known is None:
            self._count_missed(name, info)
            return True
        return _first(known, (info['source_timestamp'], info['publication_sequence_number']))

    def _count_missed(self, name: str, info: dict[str, Any]) -> None:
        """Count what never came; of a latched topic only the newest is meant for everybody."""
        if name in self._said:
            return
        missed = self._missed.get(name)
        if missed is None:
            missed = self._missed[name] = Missed(partial(self.count_publishers, name))
        if (count := missed.take(info)) and self._recording is not None:
            self._recording.miss(self._keys[name], count)

    def _take(self, name: str, raw: bytes, received_ns: int = 0) -> None:
        """Hand a message over; with simulated time, not before there is a time."""
        if self._recording is None:
            return
        clock = cast(ROSClock, self.get_clock())
        # Some middleware does not say when a message came.
        now_ns = 0 if clock.ros_time_is_active else received_ns
        now_ns = now_ns or clock.now().nanoseconds
        if now_ns <= 0:
            self._early.append((name, raw))
            return
        while self._early:
            early_name, early = self._early.popleft()
            self._recording.offer(self._keys[early_name], now_ns, early)
        self._recording.offer(self._keys[name], now_ns, raw)

    def _note_parameters(self, node: str, text: str) -> None:
        """Write a node's parameters into the recording (in the collector's thread)."""
        recording = self._recording
        if recording is not None:
            recording.note('parameters', {node: text})

    def _finalise(self, stopping: threading.Event) -> None:
        """Close what a killed recorder left."""
        for done in finalise_left(Path(self._config.directory)):
            self.get_logger().warning(done)

    def _in_node(self, work: Callable[[], _Result]) -> _Result:
        """Have work done between two messages, in the node's own thread; wait for it."""
        done: Future[_Result] = Future()

        def order() -> None:
            """Do the work, and hand its result or its error to who waits."""
            try:
                done.set_result(work())
            except BaseException as error:
                done.set_exception(error)

        self._orders.put(order)
        return done.result()

    def _round(self) -> None:
        """Take what has come, then do what services ask for."""
        self._listened_s += _ROUND_S
        self._listen()
        while True:
            try:
                self._orders.get_nowait()()
            except Empty:
                return

    def _running(self) -> Recording:
        if self._recording is None:
            raise BagError('no recording is running')
        return self._recording

    def _on_start(self) -> str:
        def start() -> Path:
            self._wanted = True
            if self._recording is not None:
                raise BagError(f'already recording {self._recording.path}')
            try:
                return self._begin()
            except BagError as error:
                self._last = ('ERROR', str(error))
                raise

        return str(self._in_node(start))

    def _on_stop(self) -> str:
        """Close the recording when all that was published before is in it."""
        asked_ns, asked = time.time_ns(), time.monotonic()
        self._wanted = False
        self._in_node(self._running)
        while late := self._in_node(lambda: self._may_be_late(asked_ns)):
            if time.monotonic() - asked > _LATE_S:
                self.get_logger().warning(f'closed with messages of {late} perhaps on their way')
                break
            time.sleep(_ROUND_S)
        return str(self._finish(self._in_node(self._take_away)))

    def _may_be_late(self, stopped_ns: int) -> str:
        """
        Name a topic of which messages published before the stop may still be on their way.

        Those of one publisher come in order: all are here when one that was published
        later is, or when no more were sent again.
        """
        for name, (published_ns, heard_s) in self._newest.items():
            if published_ns <= stopped_ns and self._listened_s - heard_s < _RESENT_S:
                return name
        return ''

    def _on_split(self) -> str:
        self._in_node(self._running).split()
        return 'going on in a new file'

    def _on_mark(self) -> str:
        """Mark this moment, with the words that came just before the call."""

        def mark() -> str:
            """Publish the mark."""
            self._running()
            words = self._words.take()
            self._mark.publish(String(data=words or 'mark'))
            return f'marked{", with words" if words else ""}'

        return self._in_node(mark)

    def _health(self) -> Health:
        if self._recording is None:
            return *self._last, {}
        state = self._recording.state
        values = {
            'path': state.path,
            'messages': state.messages,
            'bytes': state.bytes,
            'files': state.files,
            'waiting_bytes': state.waiting_bytes,
            'recorded_s': time.monotonic() - self._began_s,
            'free_bytes': _free_bytes(state.path),
            'dropped': state.dropped_count,
            'topics': len(self._subscribed),
        }
        if not self.get_clock().now().nanoseconds:
            waits = 'use_sim_time is set, and no /clock comes: nothing is recorded'
            return Awaited('STALE'), waits, values
        return *_judged(state), values


def _free_bytes(path: Path) -> int | str:
    """Return the room on the disk of a recording; '' where nobody knows."""
    try:
        return shutil.disk_usage(path.parent).free
    except OSError:
        return ''


def _judged(state: RecordingState) -> tuple[str, str]:
    """Return level and text of a recording: the most serious first."""
    if state.problem:
        return 'ERROR', state.problem
    if not state.running:
        return 'ERROR', 'the recording has ended'
    if state.dropped_count:
        worst = max(state.dropped, key=lambda name: state.dropped[name])
        return 'WARN', f'{state.dropped_count} messages dropped, most of them on {worst}'
    return 'OK', f'recording {state.path.name}: {state.messages} messages'


def _first(known: dict[_Mark, None], mark: _Mark) -> bool:
    """Return True, and keep it among the last ones, if a message has not come already."""
    if mark in known:
        return False
    known[mark] = None
    if len(known) > MEASUREMENTS:
        del known[next(iter(known))]  # the oldest
    return True


def _message_class(kind: str) -> type | None:
    """Import a message type by its name; None where its package is not installed."""
    package, _, name = kind.partition('/msg/')
    try:
        return getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError):
        return None


make_node = BagRecorderNode
