"""A served page that is fed by hand: no ROS, and a clock of the test."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest
from told_made import FORM, STATUS

pytest.importorskip('tornado', reason='the extra dashboard is not installed')

from hunt_ros.dashboard.access import Access, access
from hunt_ros.dashboard.model import PageModel, PageSettings
from hunt_ros.dashboard.recordings import Recordings
from hunt_ros.dashboard.server import PageServer


class Live:
    """A page of a rig that is played by the test, 20 updates a second."""

    def __init__(self, rules: Access, folder: Path) -> None:
        self.folder = folder
        self.calls: list[tuple[str, str]] = []
        self.reply = (True, '')
        self.holds = False  # the answers, for the test to give
        self.held: list[Future[tuple[bool, str]]] = []
        self.status = STATUS | {'speed_mps': '7.0', 'amplitude_m': '1e-04'}
        self.drive: dict[str, str] = {}
        self.speaks = True
        self.rules = rules
        self.begin(0)
        self._running = True
        self._thread = threading.Thread(target=self._play, daemon=True)
        self._thread.start()

    def begin(self, port: int) -> None:
        """Start a server, as a node does that was started again."""
        self.model = PageModel(PageSettings(), FORM)
        own = Recordings(self.folder)
        self.server = PageServer('127.0.0.1', port, self.rules, self._call, 'rig', own)
        self.url = f'http://127.0.0.1:{self.server.site.port}/'

    def restart(self) -> Callable[[], None]:
        """End the server; return what starts it again at the same port."""
        port = self.server.site.port
        self.server.close()
        return lambda: self.begin(port)

    def close(self) -> None:
        self._running = False
        self._thread.join()
        self.server.close()

    def _call(self, word: str, words: str) -> Future[tuple[bool, str]]:
        self.calls.append((word, words))
        answer: Future[tuple[bool, str]] = Future()
        if self.holds:
            self.held.append(answer)
        else:
            answer.set_result(self.reply)
        return answer

    def _play(self) -> None:
        while self._running:
            now_s, stamp_ns = time.monotonic(), time.time_ns()
            if self.speaks:
                stamps = stamp_ns + np.arange(-50, 0) * 10**6
                values = 1e-4 * np.sin(2 * math.pi * 2.8e-9 * stamps)
                self.model.take_samples('lateral', stamps, values)
                self.model.take_status(stamp_ns, dict(self.status), now_s)
                if self.drive:
                    self.model.take_speed_status(dict(self.drive), now_s)
                self.model.take_health({'name': 'rig/hunting_detector', 'level': 'OK'}, now_s)
            self.server.publish(self.model.view(now_s))
            time.sleep(0.05)


@pytest.fixture
def live(tmp_path: Path) -> Iterator[Live]:
    page = Live(access('127.0.0.1', ''), tmp_path)
    yield page
    page.close()


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[Live]:
    """A page with a token that lets command, and one that lets view."""
    page = Live(Access((('command', 'b' * 16), ('view', 'a' * 16))), tmp_path)
    yield page
    page.close()
