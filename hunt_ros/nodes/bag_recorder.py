"""
The node that records: everything the rig says, its parameters, and the operator's marks.

Messages are taken from raw subscriptions, many at a time, and stored as they were on the wire
in the order in which they came. The topics of the design are subscribed from the start; others
are picked up as they appear. The estimates are left out unless asked for: a replay makes them
again. No subscription is destroyed while the node spins: the EventsExecutor can crash on what is
gone (ros2/rclpy #1644). Of each alarm a clip is cut out of the recording, in a thread of its own.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any, cast

from rclpy.clock import ROSClock
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from std_msgs.msg import String

from hunt_ros.bag.recording import Recording, RecordingLimits, RecordingState
from hunt_ros.bag.repair import finalise_left
from hunt_ros.errors import BagError
from hunt_ros.files import PART
from hunt_ros.nodes.support.clipper import Clipper
from hunt_ros.nodes.support.conversions import message_class
from hunt_ros.nodes.support.diagnostics import Health, steady_clock
from hunt_ros.nodes.support.estimate_publishers import ESTIMATES
from hunt_ros.nodes.support.hearing import Calls, Missed, Said, waiting
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.parameters import declare
from hunt_ros.nodes.support.qos import MEASUREMENTS, TOPICS, announce, latched, stream
from hunt_ros.rig import of_rig
from hunt_ros.services import SERVICES
from hunt_ros.settings import fixed, setting
from hunt_ros.suite import Awaited

#: A latched topic keeps so many messages of those that are none of the suite's.
_FOREIGN_KEPT = 1000
#: Of the whole graph, recorded beside the namespace of the rig.
GLOBAL_TOPICS = ('/diagnostics', '/parameter_events', '/rosout')
OWN_TOPIC = 'recording/closed'
#: Not recorded: it would name the recording in itself; parameters, which stand beside the
#: messages; and what is said with calls, for what comes of it is, and who calls waits until the
#: node that is meant hears it, not a recorder.
_LEFT_OUT = (OWN_TOPIC, 'parameters', *{f'{service.node}/calls' for service in SERVICES.values()})
#: So many nodes may tell their parameters at once.
_NODES = 100
#: What a reader missed is sent again after the heartbeat of its writer, every 3 s by default. One
#: may be lost, or come late where the machine is busy: two are waited for, s, counted while the
#: node listens.
_RESENT_S = 6.5
_ROUND_S, _LOOK_S = 0.05, 0.25
#: What fails, on `/diagnostics`.
_TASK = 'recording'
#: A recording that cannot be is tried again after this, s.
_AGAIN_S = 5.0


@dataclass(frozen=True)
class RecorderConfig(RecordingLimits):
    """Parameters of the recorder."""

    directory: str = fixed('./recordings', 'Where the recordings go.')
    rig_name: str = of_rig('rig_name')
    operator: str = setting('', 'Who runs it, for the recording.')
    notes: str = setting('', 'Remarks, for the recording.')
    autostart: bool = fixed(True, 'Record from the start.')
    record_estimates: bool = fixed(False, 'Record the estimates too; a replay makes them again.')
    extra_topics: tuple[str, ...] = fixed(
        (), 'Full names of topics outside of the namespace to record as well.'
    )


class _Topic:
    """
    A topic that is heard: in the way in which its first publisher offers it, and in one that hears
    every publisher where another one comes that the first way does not hear.
    """

    def __init__(self, node: Node, name: str, kind: str, is_latched: bool, kept: int) -> None:
        self.name, self.kind, self.is_latched = name, kind, is_latched
        #: What it has said, for the recordings that begin later, if it is latched.
        self.said: deque[bytes] = deque(maxlen=kept if is_latched else 0)
        self.key = 0  # in the recording
        #: When its newest message was published, system clock, ns, and heard, listened time, s.
        self.newest_ns, self.heard_s = 0, 0.0
        self.ways: list[tuple[bool, bool, Subscription]] = []  # reliable, latched
        #: Of one that is heard in two ways: when its last messages were published, and which.
        self._known: dict[tuple[int, int], None] = {}
        self._missed = Missed(node, name)

    def is_heard(self, reliable: bool, is_latched: bool) -> bool:
        """Return True if a way hears publishers that offer this."""
        return any(way[0] <= reliable and way[1] <= is_latched for way in self.ways)

    def take(self) -> Iterator[tuple[int, int, int, bytes]]:
        """Yield what is new: when it came and was sent, ns, what is missing before it, and it."""
        for *_, subscription in self.ways:
            for raw, info in waiting(subscription):
                missing, sent_ns = 0, info['source_timestamp']
                if len(self.ways) > 1:
                    mark = sent_ns, info['publication_sequence_number']
                    if mark in self._known:
                        continue
                    self._known[mark] = None
                    if len(self._known) > MEASUREMENTS:
                        del self._known[next(iter(self._known))]  # the oldest
                elif not self.is_latched:  # of those only the newest is meant for everybody
                    missing = self._missed.take(info)
                self.newest_ns = max(self.newest_ns, sent_ns)
                if self.is_latched:
                    self.said.append(raw)
                yield info['received_timestamp'], sent_ns, missing, raw


class BagRecorderNode(SuiteNode):
    """Subscribes to what there is, and hands it to a `Recording`."""

    #: Writing what waits takes as long as the disk takes, s.
    closing_s = 60.0

    def __init__(self) -> None:
        super().__init__('bag_recorder')
        self._config = declare(self, RecorderConfig, partial(setattr, self, '_config'))
        self._recording: Recording | None = None
        self._finishing: Recording | None = None
        self._busy = threading.RLock()  # held while the recording is used or changed
        self._topics: dict[str, _Topic] = {}
        #: For how long the node has listened, s; a time in which it was held up is none.
        self._listened_s = 0.0
        self._refused: set[str] = set()
        full = {self._full(name): topic for name, topic in TOPICS.items()}
        self._known = {name: topic for name, topic in full.items() if self._wants(name)}
        self._last = 'no recording'
        self._closed = announce(self, OWN_TOPIC)
        self._mark = announce(self, 'recording/mark')
        self._parameter_files: dict[str, str] = {}  # by full name of the node
        self.create_subscription(String, 'parameters', self._on_parameters, latched(_NODES))
        #: A recording is wanted, and tried again at this time where it cannot be, steady clock.
        self._wanted, self._again_s = self._config.autostart, 0.0
        self._events_name = self._full('hunting/events')
        least_free = lambda: int(self._config.least_free_mib * 2**20)  # noqa: E731
        self._clipper = Clipper(self, self._goes_on, least_free)
        self._look_around()  # who sees that it listens may count on the recording
        # Before their publishers appear, so that their first message is in the bag.
        for name, (kind, quality) in self._known.items():
            self._subscribe(name, kind, True, _is_latched(quality))
        answers = {
            'start-recording': self._on_start,
            'stop-recording': self._on_stop,
            'split-recording': self._on_split,
            'mark': self._on_mark,
        }
        Calls(self, answers, beside=answers)
        # A long repair of an earlier recording must not keep this one from beginning.
        self.work('closing earlier recordings', self._finalise, 0.0)
        self.create_timer(_ROUND_S, self._round, clock=steady_clock())
        self.create_timer(_LOOK_S, self._look_around, clock=steady_clock())

    def close(self) -> None:
        """Take what has arrived, and close the recording."""
        super().close()
        try:
            with self._busy:  # a service has taken it away before this, or finds none
                if self._recording is not None:
                    self._finish()
            if (finishing := self._finishing) is not None:
                finishing.stop()  # a service is at it
        except BagError as error:
            self.get_logger().error(str(error))
        self._clipper.cut()  # what was on when the recording ended has a clip too
        self._closed.wait_for_all_acked(Duration(seconds=0.5))

    def _begin(self) -> Path:
        """Start a recording; what latched topics have said stands at its beginning."""
        config = self._config
        notes = {
            'operator': config.operator,
            'notes': config.notes,
            'rig': config.rig_name,
            'started': f'{datetime.now().astimezone():%Y-%m-%dT%H:%M:%S%z}',
            'namespace': self.get_namespace(),
        }
        path = self._new_path()
        try:
            recording = Recording(path, config, notes=notes)
        except BagError as error:
            self._fail(error)
            raise
        self._diagnostics.done(_TASK)
        self._recording, self._began_s = recording, time.monotonic()
        recording.note('parameters', self._parameter_files)
        for topic in self._topics.values():
            topic.key = recording.topic(topic.name, topic.kind, latched=topic.is_latched)
            for raw in topic.said:
                recording.offer(topic.key, self._now_ns(), raw)
        self.get_logger().info(f'recording {path}')
        return path

    def _fail(self, problem: BagError) -> None:
        """Say what is wrong, and try again later."""
        self._diagnostics.failed(_TASK, problem)
        self._again_s = time.monotonic() + _AGAIN_S

    def _finish(self) -> Path:
        """Let no more messages into the recording, and close it; waits for the disk."""
        with self._busy:
            self._listen()
            recording = self._finishing = self._running()
            self._recording = None
        try:
            path = recording.stop()
        except BagError as error:
            self._fail(error)
            raise
        finally:
            self._finishing = None
        self._last = f'closed {path.name}: {recording.state.messages} messages'
        self._closed.publish(String(data=str(path.resolve())))
        self.get_logger().info(f'closed {path}')
        return path

    def _new_path(self) -> Path:
        """Return a folder of the moment's name that is not there yet."""
        base = Path(self._config.directory) / f'hunt_{datetime.now():%Y%m%d_%H%M%S}'
        path, number = base, 1
        while path.exists() or path.with_name(path.name + '.active').exists():
            path, number = base.with_name(f'{base.name}_{number}'), number + 1
        return path

    def _full(self, name: str) -> str:
        return name if name.startswith('/') else f'{self.get_namespace().rstrip("/")}/{name}'

    def _wants(self, name: str) -> bool:
        """Return True if a topic is to be recorded."""
        estimates = () if self._config.record_estimates else [topic.name for topic in ESTIMATES]
        if name in map(self._full, (*_LEFT_OUT, *estimates)):
            return False
        if name in GLOBAL_TOPICS or name in self._config.extra_topics:
            return True
        namespace = self.get_namespace().rstrip('/')
        return name.startswith(f'{namespace}/') and (bool(namespace) or name != '/clock')

    def _look_around(self) -> None:
        """Pick up new topics; close what ended by itself, and begin again what is wanted."""
        with self._busy:
            if self._recording is not None and (problem := self._recording.state.problem):
                with suppress(BagError):
                    self._finish()  # it has ended: nothing is waited for
                self._fail(BagError(problem))  # as when the disk is full
                self._diagnostics.publish()
                self._again_s = self._began_s + _AGAIN_S  # what had lasted goes on at once
            if self._recording is None and self._wanted and time.monotonic() >= self._again_s:
                with suppress(BagError):  # it is said
                    self._begin()
        for name, kinds in self.get_topic_names_and_types():
            offers = [info.qos_profile for info in self._offers(name)]
            if offers:
                reliable = all(q.reliability != ReliabilityPolicy.BEST_EFFORT for q in offers)
                self._subscribe(name, kinds[0], reliable, all(map(_is_latched, offers)))

    def _offers(self, name: str) -> Sequence[Any]:
        return self.get_publishers_info_by_topic(name) if self._wants(name) else ()

    def _subscribe(self, name: str, kind: str, reliable: bool, is_latched: bool) -> None:
        """Subscribe unless an earlier subscription hears such publishers as well."""
        topic = self._topics.get(name)
        if name in self._refused or (topic is not None and topic.is_heard(reliable, is_latched)):
            return
        if (type_of := message_class(kind)) is None:
            self._refused.add(name)
            self.get_logger().warning(f'{name}: type {kind} is not installed, not recorded')
            return
        with self._busy:
            if topic is None:
                kept = self._known[name][1].depth if name in self._known else _FOREIGN_KEPT
                topic = self._topics[name] = _Topic(self, name, kind, is_latched, kept)
                if self._recording is not None:
                    topic.key = self._recording.topic(name, kind, latched=is_latched)
            else:
                reliable = is_latched = False
            qos: QoSProfile = latched(MEASUREMENTS) if is_latched else stream(MEASUREMENTS)
            if not reliable:
                qos.reliability = ReliabilityPolicy.BEST_EFFORT
            subscription = self.create_polled_subscription(type_of, name, qos, raw=True)
            topic.ways.append((reliable, is_latched, subscription))

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds

    def _round(self) -> None:
        self._listened_s += _ROUND_S
        self._listen()

    def _listen(self) -> None:
        """Take what has come on all topics, in the order in which it came."""
        if not self._now_ns():
            return  # of a simulated rig, which has no time yet: it waits in the readers
        with self._busy:
            come: list[tuple[int, int, int, bytes, _Topic]] = []
            for topic in self._topics.values():
                before = len(come)
                come += [(*each, topic) for each in topic.take()]
                if len(come) > before:
                    topic.heard_s = self._listened_s
            if (recording := self._recording) is None:
                return
            # Some middleware does not say when a message came.
            now_ns = self._now_ns()
            simulated = cast(ROSClock, self.get_clock()).ros_time_is_active
            for received_ns, _, missing, raw, topic in sorted(come, key=itemgetter(0, 1)):
                if missing:
                    recording.miss(topic.key, missing)
                stamp_ns = now_ns if simulated else received_ns or now_ns
                recording.offer(topic.key, stamp_ns, raw)
                if topic.name == self._events_name:
                    self._clipper.hear(recording.path, stamp_ns, raw)

    def _goes_on(self) -> Path | None:
        """Return the recording that is not closed yet."""
        with self._busy:
            recording = self._recording or self._finishing
            return recording.path if recording else None

    def _on_parameters(self, message: String) -> None:
        """Keep what a node tells of its parameters, for this recording and later ones."""
        node = message.data.partition(':')[0]
        with self._busy:
            self._parameter_files[node] = message.data
            if self._recording is not None:
                self._recording.note('parameters', {node: message.data})

    def _finalise(self, stopping: threading.Event) -> None:
        """Close what a killed recorder left."""
        for part in Path(self._config.directory).glob(f'clip_*{PART}'):
            part.unlink(missing_ok=True)
        for closed, said in finalise_left(Path(self._config.directory)):
            self.get_logger().warning(said)
            if closed is not None:
                self._clipper.recover(closed, self._events_name)

    def _running(self) -> Recording:
        if self._recording is None:
            raise BagError('no recording is running')
        return self._recording

    def _on_start(self, said: Said) -> str:
        with self._busy:
            self._wanted = True
            if self._recording is not None:
                raise BagError(f'already recording {self._recording.path}')
            return str(self._begin())

    def _on_stop(self, said: Said) -> str:
        """Close the recording when all that was published before is in it."""
        asked_ns, asked_s = time.time_ns(), self._listened_s
        self._wanted = False
        self._running()
        while late := self._late(asked_ns):
            # The clock of a publisher may be behind: whatever it says, two heartbeats are over.
            # Nobody can tell that from a backlog that still comes.
            if self._listened_s - asked_s > _RESENT_S:
                why = 'its clock is behind, or messages are on their way'
                self.get_logger().warning(f'closed though {late} is older than the stop: {why}')
                break
            time.sleep(_ROUND_S)
        return str(self._finish())

    def _late(self, stopped_ns: int) -> str:
        """
        Name a topic of which messages published before the stop may still be on their way.

        Those of one publisher come in order: all are here when one that was published
        later is, or when no more were sent again.
        """
        with self._busy:
            self._listen()
            for topic in self._topics.values():
                waited_s = self._listened_s - topic.heard_s
                if 0 < topic.newest_ns <= stopped_ns and waited_s < _RESENT_S:
                    return topic.name
        return ''

    def _on_split(self, said: Said) -> str:
        self._running().split()
        return 'going on in a new file'

    def _on_mark(self, said: Said) -> str:
        """Mark this moment, with the words that came just before the call."""
        self._running()
        self._mark.publish(String(data=said.words or 'mark'))
        return f'marked{", with words" if said.words else ""}'

    def _health(self) -> Health:
        if (recording := self._recording) is None:
            return 'OK', self._last, {}
        state = recording.state
        values = {
            'path': state.path,
            'messages': state.messages,
            'bytes': state.bytes,
            'files': state.files,
            'waiting_bytes': state.waiting_bytes,
            'recorded_s': time.monotonic() - self._began_s,
            'free_bytes': _free_bytes(state.path),
            'dropped': state.dropped_count,
            'topics': len(self._topics),
        }
        if not self._now_ns():
            waits = 'use_sim_time is set, and no /clock comes: nothing is recorded'
            return Awaited('STALE'), waits, values
        return *_judged(state), values


def _is_latched(quality: QoSProfile) -> bool:
    return quality.durability == DurabilityPolicy.TRANSIENT_LOCAL


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


make_node = BagRecorderNode
