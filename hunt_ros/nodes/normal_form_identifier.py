"""
The node that refits the normal form from recordings as they close.

It reads the last recordings together, publishes the refitted form on
`hunting/normal_form`, and writes the parameter file beside them; earlier files
are kept. The work runs in a thread, so that services answer meanwhile.
"""

from __future__ import annotations

import sys
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
from hunt_ros.identification import IdentificationSettings, identify
from hunt_ros.nodes.diagnostics import Diagnostics, Health
from hunt_ros.nodes.parameters import declare, warn_unknown
from hunt_ros.nodes.qos import latched
from hunt_ros.nodes.runtime import run
from hunt_ros.settings import Settings, setting

#: Name of the parameter file with the newest form; earlier ones carry a number.
NEWEST = 'normal_form.yaml'


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
        self._recordings: deque[Path] = deque(maxlen=self._config.history)
        self._orders: SimpleQueue[None] = SimpleQueue()
        self._state = ('OK', 'no recording yet')
        self._forms = 0
        self._publisher = self.create_publisher(String, 'hunting/normal_form', latched())
        self.create_subscription(String, 'recording/closed', self._on_closed, latched())
        self.create_service(Trigger, 'identify', self._on_identify)
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
        if path not in self._recordings:
            self._recordings.append(path)
        if self._config.on_close:
            self._orders.put(None)

    def _on_identify(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        response.success = bool(self._recordings)
        response.message = (
            f'identifying from {len(self._recordings)} recordings'
            if self._recordings
            else 'no recording was closed yet'
        )
        if self._recordings:
            self._orders.put(None)
        return response

    def _work(self) -> None:
        while self._running:
            try:
                self._orders.get(timeout=0.2)
            except Empty:
                continue
            try:
                self._identify()
            except HuntError as error:
                self._state = ('WARN', str(error))
                self.get_logger().warning(str(error))

    def _identify(self) -> None:
        recordings = list(self._recordings)
        self._state = ('OK', f'identifying from {len(recordings)} recordings')
        begin = time.monotonic()
        result = identify([read_record(path) for path in recordings], IdentificationSettings())
        for warning in result.warnings:
            self.get_logger().warning(warning)
        if result.normal_form is None:
            self._state = ('WARN', 'the recordings do not determine a normal form')
            return
        text = result.normal_form.to_yaml()
        path = self._keep(text)
        self._forms += 1
        self._publisher.publish(String(data=text))
        self._state = ('OK', f'{path} from {len(recordings)} recordings')
        self.get_logger().info(
            f'normal form from {len(recordings)} recordings in'
            f' {time.monotonic() - begin:.1f} s: {path}'
        )

    def _keep(self, text: str) -> Path:
        """Write the parameter file; the one before stays under a number."""
        directory = Path(self._config.directory)
        directory.mkdir(parents=True, exist_ok=True)
        newest = directory / NEWEST
        if newest.exists():
            number = 1
            while (earlier := newest.with_stem(f'{newest.stem}_{number:03d}')).exists():
                number += 1
            newest.rename(earlier)
        partial = newest.with_suffix('.part')
        partial.write_text(text, encoding='utf-8')
        partial.rename(newest)
        return newest

    def _health(self) -> Health:
        level, text = self._state
        return level, text, {'recordings': len(self._recordings), 'forms': self._forms}


def main() -> int:
    """Run the node."""
    return run(NormalFormIdentifierNode)


if __name__ == '__main__':
    sys.exit(main())
