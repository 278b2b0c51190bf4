"""The clips of a recorder: of each alarm that is heard one is cut out of its recording."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message

from hunt_ros.bag.clips import LATEST_S, Clips
from hunt_ros.bag.messages import read_raw
from hunt_ros.bag.reader import Bag
from hunt_ros.drivers.alarms import alarm_of
from hunt_ros.errors import BagError, HuntError, one_line
from hunt_ros.nodes.support.conversions import read_diagnostic
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.samples import NANOSECONDS

#: The thread looks so often, s, and gives way to others of the machine.
_LOOK_S, _NICE = 1.0, 10


class Clipper:
    """
    Cuts clips in a thread of its own, behind everything else that the machine does.

    Parameters
    ----------
    node : SuiteNode
        The recorder.
    running : callable
        Returns the recording that goes on, or None.
    least_free : callable
        Returns how many bytes of the disk are left free.
    """

    def __init__(
        self,
        node: SuiteNode,
        running: Callable[[], Path | None],
        least_free: Callable[[], int],
    ) -> None:
        self._logger, self._clock = node.get_logger(), node.get_clock()
        self._running, self._least_free = running, least_free
        self._heard: SimpleQueue[tuple[Path, int, str]] = SimpleQueue()
        self._clips = Clips()
        self._cutting = threading.Lock()  # of the thread, and of who closes
        node.work('clips', self._work)

    def hear(self, recording: Path, stamp_ns: int, raw: bytes) -> None:
        """Note an event, as it was on the wire, at its log time: an alarm is to have a clip."""
        try:
            told = read_diagnostic(deserialize_message(raw, DiagnosticArray))
        except RuntimeError as error:  # it is recorded as it came: whoever sent it
            self._logger.warning(f'no event, and no clip: {one_line(error)}')
            return
        said = (told.get(key, '') for key in ('event', 'level', 'test', 'cause'))
        alarm = alarm_of(*said)
        if alarm is not None and alarm.begins:
            self._heard.put((recording, stamp_ns, alarm.code))

    def recover(self, recording: Path, topic: str) -> None:
        """Hear again the events at the end of a recording: a kill may have cost their clips."""
        with suppress(BagError), Bag(recording) as bag:  # one without events has no such topic
            assert bag.span_ns is not None
            late_ns = bag.span_ns[1] - round(LATEST_S * NANOSECONDS)
            for message in read_raw(bag, [topic]):
                if message.log_ns > late_ns:
                    self.hear(recording, message.log_ns, message.data)

    def _work(self, stopping: threading.Event) -> None:
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
        while not stopping.wait(_LOOK_S):
            self.cut()

    def cut(self) -> None:
        """Cut the clips that are due; where no recording goes on, all that are left."""
        with self._cutting:
            for heard in [self._heard.get() for _ in range(self._heard.qsize())]:
                if not self._clips.take(*heard):
                    self._logger.warning(f'{heard[-1]}: no clip, this hour has had its share')
            for clip in self._clips.due(self._clock.now().nanoseconds, self._running()):
                clip.tries -= 1
                try:
                    if shutil.disk_usage(clip.path.parent).free < self._least_free():
                        raise BagError(f'{clip.path}: no clip, the disk is nearly full')
                    self._logger.info(f'clip of {clip.code}: {clip.cut()}')
                    clip.tries = 0
                except (HuntError, OSError) as error:
                    if not clip.tries:
                        self._logger.warning(str(error))
