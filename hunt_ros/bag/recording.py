"""
A live recording: takes messages without ever waiting, and writes them in a thread.

Between the two is a buffer with a bound. What does not fit is counted, never
waited for. Chunks are short, so that a kill, a crash or a full disk loses no more
than the last moment.
"""

from __future__ import annotations

import math
import shutil
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

from hunt_ros.bag.bag_writer import BagWriter
from hunt_ros.errors import BagError, HuntError, one_line
from hunt_ros.samples import NANOSECONDS
from hunt_ros.settings import Settings, setting

#: Something the writer thread is to do with the recording.
_Order: TypeAlias = Callable[[BagWriter], object]
_Message: TypeAlias = tuple[int, int, bytes]

_MEBIBYTE = 1 << 20
#: A file is no shorter than this where a person asks for the next, s.
_SPLIT_S = 1.0


@dataclass(frozen=True)
class RecordingLimits(Settings):
    """Bounds of a live recording."""

    split_s: float = setting(
        3600.0, 'Begin a new file after so long; 0 never.', unit='s', low=0.0, high=864000.0
    )
    split_mib: float = setting(
        2048.0, 'Begin a new file at this size; 0 never.', unit='MiB', low=0.0, high=1e6
    )
    buffer_mib: float = setting(
        64.0, 'What may wait for the disk; more is dropped and counted.', unit='MiB', low=0.1,
        high=8192.0,
    )  # fmt: skip
    chunk_s: float = setting(
        0.25, 'Longest time a message waits for its chunk to be written.', unit='s', low=0.02,
        high=0.9,
    )  # fmt: skip
    least_free_mib: float = setting(
        512.0, 'Stop and close when the disk has less than this.', unit='MiB', low=1.0, high=1e7
    )


@dataclass
class RecordingState:
    """
    What a recording has done so far.

    `dropped` are the messages that are not in it, by topic: the buffer was full, or they were
    lost on their way to the recorder.

    `problem` is '' while all is well; a recording that ended by itself (disk) has
    `running` False and says there why.
    """

    path: Path
    running: bool = True
    messages: int = 0
    bytes: int = 0
    files: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    waiting_bytes: int = 0
    problem: str = ''

    @property
    def dropped_count(self) -> int:
        """Messages dropped on all topics."""
        return self.dropped.total()


class Recording:
    """
    A recording that is running.

    Every method may be called from any thread, and none waits for the disk, but for
    `stop`.

    Parameters
    ----------
    path : str or Path
        Folder to make; `<path>.active` until `stop`.
    limits : RecordingLimits
    notes : mapping of str to str
        Rig, operator, remarks.

    Raises
    ------
    BagError
        If the folder exists or cannot be made, or the disk is too full to begin.
    """

    def __init__(
        self,
        path: str | Path,
        limits: RecordingLimits | None = None,
        *,
        notes: Mapping[str, str] | None = None,
    ) -> None:
        self.limits = limits or RecordingLimits()
        self.path = Path(path)
        self._bag = BagWriter(path, notes=notes)
        self._names: list[str] = []  # the number of a topic is its place, from 1
        self._lock = threading.Lock()
        self._split_s = -math.inf  # when a new file was asked for, steady clock
        self._begun_ns: int | None = None  # the first log time of the file at hand
        self._queue: list[_Message | _Order] = []
        self._taken: deque[_Message | _Order] = deque()  # out of it, by the thread
        self._state = RecordingState(self.path)
        self._ending = False
        self._closed: Path | None = None
        self._wake = threading.Event()
        try:
            self._check_disk()
        except BagError:
            self._bag.abandon()
            shutil.rmtree(self._bag.active, ignore_errors=True)
            raise
        self._thread = threading.Thread(target=self._work, name='recording', daemon=True)
        self._thread.start()

    def topic(self, name: str, message_type: str, *, latched: bool = False) -> int:
        """Describe a topic; returns its number for `offer`. Asking again is harmless."""
        with self._lock:
            if name in self._names:
                return self._names.index(name) + 1
            self._names.append(name)
            self._queue.append(lambda bag: bag.topic(name, message_type, latched=latched))
            return len(self._names)

    def offer(self, topic: int, log_ns: int, message: bytes) -> bool:
        """
        Hand over one message as it was on the wire.

        Returns
        -------
        bool
            False where it was dropped (and counted): the buffer is full, or the
            recording has ended.
        """
        with self._lock:
            full = self._state.waiting_bytes + len(message) > self.limits.buffer_mib * _MEBIBYTE
            if full or self._ending or self._state.problem:
                self._state.dropped[self._names[topic - 1]] += 1
                return False
            self._queue.append((topic, log_ns, message))
            self._state.waiting_bytes += len(message)
        return True

    def miss(self, topic: int, count: int) -> None:
        """Count messages of a topic that never came here: they are not in the recording."""
        with self._lock:
            self._state.dropped[self._names[topic - 1]] += count

    def note(self, name: str, strings: Mapping[str, str]) -> None:
        """Write named strings beside the messages: parameters, the normal form in force."""
        copy = dict(strings)
        with self._lock:
            self._queue.append(lambda bag: bag.note(name, copy))

    def split(self) -> None:
        """Go on in a new file; raises BagError where that of the last call is a moment old."""
        before_s, self._split_s = self._split_s, time.monotonic()
        if self._split_s - before_s < _SPLIT_S:  # a folder of thousands is read slowly
            raise BagError(f'the file at hand was begun less than {_SPLIT_S:g} s ago')
        with self._lock:
            self._queue.append(self._go_on)
        self._wake.set()

    @property
    def state(self) -> RecordingState:
        """What it has done so far."""
        with self._lock:
            return replace(
                self._state,
                path=self._closed or self.path,
                running=self._thread.is_alive() and not self._state.problem,
                files=self._bag.file_count,
                dropped=self._state.dropped.copy(),
            )

    def stop(self, timeout_s: float = 60.0) -> Path:
        """
        Write what is waiting, close the recording and give it its final name.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        BagError
            If it could not be closed: what is written stays under the `.active` name.
        """
        with self._lock:
            self._ending = True
        self._wake.set()
        self._thread.join(timeout_s)
        if self._closed is None:
            reason = self._state.problem or f'the disk has not answered for {timeout_s:.0f} s'
            raise BagError(f'{self.path}: not closed ({reason})')
        return self._closed

    def _work(self) -> None:
        """Write what waits until the recording ends (in the thread of the writer)."""
        period = min(0.1, self.limits.chunk_s / 2)
        flushed = checked = time.monotonic()
        try:
            while True:
                self._wake.wait(period)
                self._wake.clear()
                ending = self._ending  # read before the queue: what came before it is written
                self._drain()
                now = time.monotonic()
                if now - flushed >= self.limits.chunk_s - period:
                    self._bag.flush()
                    flushed = now
                if now - checked >= 1.0:
                    self._check_disk()
                    self._bag.sync()
                    checked = now
                if ending:
                    break
        except Exception as error:  # it ends the recording, closed, and is never without a word
            with self._lock:  # what waits and what comes now is lost, and counted
                self._state.problem = one_line(error)
                lost = (each for each in (*self._taken, *self._queue) if isinstance(each, tuple))
                self._state.dropped.update(self._names[topic - 1] for topic, *_ in lost)
                self._queue, self._state.waiting_bytes = [], 0
        self._finish()

    def _drain(self) -> None:
        """Write all that waits, and begin a new file where it is due."""
        with self._lock:
            self._taken, self._queue = deque(self._queue), []
        while self._taken:
            item = self._taken[0]
            if not isinstance(item, tuple):
                item(self._bag)
                self._taken.popleft()
                continue
            self._bag.write(*item)
            _, log_ns, message = item
            size = len(message)
            with self._lock:
                self._taken.popleft()
                self._state.waiting_bytes -= size
                self._state.messages += 1
                self._state.bytes += size
            if self._begun_ns is None:
                self._begun_ns = log_ns
            most, most_ns = self.limits.split_mib * _MEBIBYTE, self.limits.split_s * NANOSECONDS
            # As long, or its clock was set back so far.
            long = abs(log_ns - self._begun_ns) >= most_ns > 0.0
            if long or self._bag.file_bytes >= most > 0.0:
                self._go_on(self._bag)

    def _go_on(self, bag: BagWriter) -> None:
        """Go on in a new file."""
        bag.split()
        self._begun_ns = None

    def _check_disk(self) -> None:
        free = shutil.disk_usage(self._bag.active).free
        least = self.limits.least_free_mib * _MEBIBYTE
        if free < least:
            raise BagError(
                f'{self._bag.active}: {free // _MEBIBYTE} MiB are free on the disk, expected at'
                f' least {self.limits.least_free_mib:g}'
            )

    def _finish(self) -> None:
        try:
            self._closed = self._bag.close()
        except HuntError as error:
            self._state.problem = self._state.problem or str(error)
            self._bag.abandon()
