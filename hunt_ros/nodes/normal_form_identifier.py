"""
The node that refits the normal form from recordings as they close.

It reads the last recordings together, publishes the refitted form on
`hunting/normal_form`, and writes the parameter file beside them; earlier files
are kept, and `hunting/revert_normal_form` goes back to the one before, in the file,
on the topic, and in what the next refit rests on. The work runs in a thread, so that
services answer meanwhile.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue

from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from hunt_ros.bag.columns import read_record
from hunt_ros.errors import HuntError
from hunt_ros.identification import Identification, IdentificationSettings, update
from hunt_ros.nodes.diagnostics import Diagnostics, Health
from hunt_ros.nodes.form_files import FormFiles
from hunt_ros.nodes.parameters import declare, warn_unknown
from hunt_ros.nodes.qos import latched
from hunt_ros.samples import Record
from hunt_ros.settings import Settings, setting

#: Results that are remembered, to know what an earlier form rested on.
_REMEMBERED = 20


@dataclass(frozen=True)
class IdentifierConfig(Settings):
    """Parameters of the identifier."""

    directory: str = setting('./recordings', 'Where the parameter files go.', fixed=True)
    on_close: bool = setting(True, 'Identify whenever a recording is closed.')
    history: int = setting(
        8, 'Use so many of the last recordings together.', low=1, high=1000, fixed=True
    )


class NormalFormIdentifierNode(Node):
    """Recordings in, normal form out."""

    def __init__(self) -> None:
        super().__init__('normal_form_identifier')
        self._config = declare(self, IdentifierConfig)
        warn_unknown(self)
        self._files = FormFiles(Path(self._config.directory))
        self._seen: deque[Path] = deque(maxlen=1000)
        self._waiting: list[Path] = []
        #: Results behind the newest form and the ones before it, as far as known.
        self._results: deque[Identification | None] = deque(maxlen=_REMEMBERED)
        self._latest: Identification | None = None
        self._reverts = 0
        self._lock = threading.Lock()
        self._orders: SimpleQueue[None] = SimpleQueue()
        self._state = ('OK', 'no recording yet')
        self._forms = 0
        self._publisher = self.create_publisher(String, 'hunting/normal_form', latched())
        self.create_subscription(String, 'recording/closed', self._on_closed, latched())
        self.create_service(Trigger, 'identify', self._on_identify)
        self.create_service(Trigger, 'hunting/revert_normal_form', self._on_revert)
        self._diagnostics = Diagnostics(self, self._health)
        self._running = True
        self._thread = threading.Thread(target=self._work, name='identify', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop after the work in hand, if that is soon."""
        self._running = False
        self._thread.join(timeout=1.0)

    def _on_closed(self, message: String) -> None:
        path = Path(message.data)
        if path in self._seen:
            return
        with self._lock:
            self._seen.append(path)
            self._waiting.append(path)
        if self._config.on_close:
            self._orders.put(None)

    def _on_identify(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        response.success = bool(self._seen)
        response.message = (
            f'identifying from {self._recordings} recordings'
            if self._seen
            else 'no recording was closed yet'
        )
        if self._seen:
            self._orders.put(None)
        return response

    def _on_revert(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Go back to the form before the newest; it is the operator who wants it so."""
        with self._lock:
            try:
                text = self._files.go_back()
            except HuntError as error:
                response.success, response.message = False, str(error)
                return response
            # What came since the earlier form is what led away from it: it stays out.
            self._reverts += 1
            self._waiting.clear()
            if self._results:
                self._results.pop()
            self._latest = self._results[-1] if self._results else None
            self._publisher.publish(String(data=text))
            self._state = ('OK', 'back to the normal form before, by the operator')
        response.success, response.message = (
            True,
            f'{self._files.newest} is the earlier form again',
        )
        self.get_logger().warning(response.message)
        return response

    @property
    def _recordings(self) -> int:
        """Recordings that the next refit rests on."""
        before = 0 if self._latest is None else len(self._latest.records)
        return min(before + len(self._waiting), self._config.history)

    def _work(self) -> None:
        while self._running:
            try:
                self._orders.get(timeout=0.5)
            except Empty:
                continue
            try:
                self._identify()
            except HuntError as error:
                self._state = ('WARN', str(error))
                self.get_logger().warning(str(error))

    def _identify(self) -> None:
        with self._lock:
            paths, prior, reverts = list(self._waiting), self._latest, self._reverts
            self._state = ('OK', f'identifying from {self._recordings} recordings')
        begin = time.monotonic()
        records = self._read(paths)
        if not records and (prior is None or not prior.records):
            return
        result = update(prior, records, IdentificationSettings(), self._config.history)
        for warning in result.warnings:
            self.get_logger().warning(warning)
        with self._lock:
            if reverts != self._reverts:
                self.get_logger().warning('reverted meanwhile: this identification is dropped')
                return
            self._waiting = [path for path in self._waiting if path not in paths]
            self._latest = result
            if result.normal_form is None:
                self._state = ('WARN', 'the recordings do not determine a normal form')
                return
            text = result.normal_form.to_yaml()
            path = self._files.keep(text)
            self._results.append(result)
            self._forms += 1
            self._publisher.publish(String(data=text))
            self._state = ('OK', f'{path} from {len(result.records)} recordings')
        self.get_logger().info(
            f'normal form from {len(result.records)} recordings in'
            f' {time.monotonic() - begin:.1f} s: {path}'
        )

    def _read(self, paths: list[Path]) -> list[Record]:
        """Read recordings; one that cannot be read does not spoil the others."""
        records = []
        for path in paths:
            try:
                records.append(read_record(path))
            except HuntError as error:
                self.get_logger().warning(str(error))
                with self._lock:
                    self._waiting = [other for other in self._waiting if other != path]
        return records

    def _health(self) -> Health:
        level, text = self._state
        return level, text, {'recordings': self._recordings, 'forms': self._forms}


make_node = NormalFormIdentifierNode
