"""What happens, line by line; on a terminal below it how the rig is, over and over."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from hunt_ros.cli.support.screen import STYLES, event_line, printable, rows
from hunt_ros.dashboard.told import Told

#: It is drawn so often, s; and the end waits so long for a terminal that takes nothing, s.
_DRAWN_S, _STUCK_S = 0.2, 2.0
#: Each node tells its health once a second: where none is heard for so long, s, it is the console
#: that is silent. Who is silent is known again when it has listened for a while.
_DEAF_S, _LISTENED_S = 2.0, 4.0


class View:
    """
    Shows what the console node reports; a context manager.

    What happens is printed when it comes. On a terminal the rig is drawn below it, over and over,
    by a thread of its own: silence is seen although nothing comes, and a terminal that is held up
    holds up nothing else.

    Parameters
    ----------
    namespace : str
        Of the rig: what other rigs of the ROS domain say of themselves is not shown.
    speed_unit : str
        In which speeds are shown.
    """

    def __init__(self, namespace: str = 'rig', speed_unit: str = 'm/s') -> None:
        self._console = Console(file=sys.stdout, highlight=False, soft_wrap=True)
        self._live: Live | None = None
        self._told = Told(namespace, speed_unit)
        #: Lines that wait for the terminal.
        self._waiting: deque[tuple[str, str]] = deque()
        self._keys: tuple[str, ...] = ('Ctrl-C: quit',)
        self._ended = threading.Event()
        self._lock = threading.Lock()
        self._origin_ns = 0  # of the first stamp; none where nothing was received yet
        self._health: dict[str, str] = {}
        #: When a health was heard last, and since when without a break: steady clock.
        self._heard_s, self._listens_s = math.inf, -math.inf

    def __enter__(self) -> View:
        # Not `console.is_terminal`: that can be forced by the environment, for the colours.
        if sys.stdout.isatty() and not self._console.is_dumb_terminal:
            self._live = Live(
                console=self._console,
                transient=True,
                auto_refresh=False,
                get_renderable=self._block,
                vertical_overflow='crop',
                redirect_stdout=False,
                redirect_stderr=False,
            )
            self._live.start()
            self._drawer = threading.Thread(target=self._draw, args=(self._live,), daemon=True)
            self._drawer.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._live is not None:
            self._ended.set()
            self._drawer.join(_STUCK_S)
            self._live = None

    def _draw(self, live: Live) -> None:
        """Print what waits and draw the rig, until the end."""
        with suppress(OSError):  # the terminal is gone
            while not self._ended.wait(_DRAWN_S):
                self._print_waiting()
                live.refresh()
            live.stop()
            self._print_waiting()

    def _print_waiting(self) -> None:
        while self._waiting:
            self._print(*self._waiting.popleft())

    def show(self, line: dict[str, Any]) -> None:
        """Show one line of the console node."""
        topic, now_s = line['topic'], time.monotonic()
        if topic in ('hunting/status', 'hunting/events'):
            self._origin_ns = self._origin_ns or int(line['stamp_ns'])
        if topic == 'hunting/status':
            with self._lock:
                self._told.take_status(int(line['stamp_ns']), line, now_s)
        elif topic == 'speed/status':
            with self._lock:
                self._told.take_speed_status(line, now_s)
        elif topic == '/diagnostics':
            self._take_health(line, now_s)
        elif topic == 'hunting/events':
            self.say(event_line(line, self._origin_ns), STYLES.get(line.get('level', ''), ''))
        elif topic == 'process':
            self.say(line['data'], STYLES['ERROR'])
        elif topic == 'recording/closed':
            self.say(f'recorded {line["data"]}')
        elif topic == 'hunting/normal_form':
            self.say('a refitted normal form has come')  # it may have to be accepted
        elif topic == 'answer':
            text = line['message'] or ('done' if line['ok'] else 'refused')
            self.say(f'{line["service"]}: {text}', '' if line['ok'] else STYLES['WARN'])

    def say(self, text: str, style: str = '') -> None:
        """Say something in one line, or several; speeds in it are in m/s."""
        text = self._told.words.in_unit(text)
        if self._live is None:
            self._print(text, style)
        else:
            self._waiting.append((text, style))

    def drive_mps(self, name: str) -> float:
        """Return a speed that the drive tells, m/s; NaN where it is silent."""
        with self._lock:
            return self._told.drive_mps(name, time.monotonic())

    def offer(self, keys: Sequence[str]) -> None:
        """Say what each key does: at the foot of the terminal, as long as the view lasts."""
        if self._live is None:
            self.say(', '.join(['keys', *keys]))
        self._keys = tuple(keys)

    def _block(self) -> Group:
        with self._lock:
            sections = self._told.sections(time.monotonic())
        return Group(*rows(sections, self._keys, self._console.width))

    def _print(self, text: str, style: str) -> None:
        self._console.print(Text(printable(text), style=style))

    def _take_health(self, line: dict[str, Any], now_s: float) -> None:
        """Say when a node is unwell or silent, and when it is well again."""
        if now_s - self._heard_s > _DEAF_S:
            self._listens_s = now_s
        self._heard_s = now_s
        with self._lock:
            self._told.take_health(line, now_s)
            nodes = self._told.sections(now_s)['nodes']
        for node in nodes:
            name, level = node['name'], node['level']
            if node['silent'] and now_s - self._listens_s < _LISTENED_S:
                continue
            if level != self._health.get(name, 'OK'):
                self.say(f'{name}: {node["message"]}', STYLES.get(level, ''))
            self._health[name] = level
