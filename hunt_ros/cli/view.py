"""The live view on the terminal: events scroll, the status stays as the last line."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

from hunt_ros.cli.narration import STYLES, event_line, status_line


class View:
    """
    Shows what the console node reports; a context manager.

    On a terminal the status is one line that changes in place; elsewhere only
    events and changes of a node's health are printed.
    """

    def __init__(self) -> None:
        self._console = Console(file=sys.stdout, highlight=False, soft_wrap=True)
        self._live: Live | None = None
        self._origin_ns: int | None = None
        self._health: dict[str, str] = {}

    def __enter__(self) -> View:
        if self._console.is_terminal:
            self._live = Live('', console=self._console, transient=True, auto_refresh=False)
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, line: dict[str, Any]) -> None:
        """Show one line of the console node."""
        topic = line['topic']
        if topic == 'hunting/events':
            self.say(event_line(line, self._origin(line)), STYLES.get(line.get('level', ''), ''))
        elif topic == 'hunting/status':
            self._origin(line)
            if self._live is not None:
                style = STYLES.get(line.get('level', ''), '')
                self._live.update(Text(status_line(line), style=style), refresh=True)
        elif topic == '/diagnostics':
            self._show_health(line)
        elif topic == 'progress':
            self.say(line['data'])
        elif topic == 'recording/closed':
            self.say(f'recorded {line["data"]}')
        elif topic == 'hunting/normal_form':
            self.say('a refitted normal form is in force')
        elif topic == 'answer':
            text = line['message'] or ('done' if line['ok'] else 'refused')
            self.say(f'{line["service"]}: {text}', '' if line['ok'] else STYLES['WARN'])

    def say(self, text: str, style: str = '') -> None:
        """Print a line above the status."""
        self._console.print(Text(text, style=style))

    def _origin(self, line: dict[str, Any]) -> int:
        stamp_ns = int(line['stamp_ns'])
        if self._origin_ns is None and stamp_ns > 0:  # 0: nothing was received yet
            self._origin_ns = stamp_ns
        return self._origin_ns or stamp_ns

    def _show_health(self, line: dict[str, Any]) -> None:
        """Say when a node is unwell, and when it is well again."""
        name, level = str(line['name']).rsplit('/', 1)[-1], line['level']
        before = self._health.get(name, 'OK')
        self._health[name] = level
        if level != before:
            self.say(f'{name}: {line["message"]}', STYLES.get(level, ''))
