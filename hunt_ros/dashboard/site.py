"""What is served, and to whom: files, rights, and the view that all open pages are sent."""

from __future__ import annotations

import asyncio
import hashlib
import json
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any, Protocol

from tornado.web import HTTPError

from hunt_ros.dashboard.access import Access
from hunt_ros.dashboard.recordings import Recordings
from hunt_ros.dashboard.view import View, changes
from hunt_ros.dashboard.words import Words
from hunt_ros.report.figures.style import palette_css

_STATIC = files('hunt_ros.dashboard') / 'static'

#: Gets the word of a command and the words that go with it; the answer is (done, message).
Command = Callable[[str, str], 'Future[Any]']


class Viewer(Protocol):
    """The connection of a page that shows the rig as it is."""

    def update(self, view: View) -> None:
        """Send what has changed."""

    def close(self, code: int | None = None, reason: str | None = None) -> None:
        """End it."""

    def on_close(self) -> None:
        """Give back what it holds."""


class Turns:
    """
    Bounds what is done at a time for all browsers; an asynchronous context manager.

    Parameters
    ----------
    at_once : int
        So many are served; more wait.
    most : int
        So many are served or wait; one more is refused, with the answer 503.
    """

    def __init__(self, at_once: int, most: int) -> None:
        self._free = asyncio.Semaphore(at_once)
        self._most = most
        self._inside = 0

    async def __aenter__(self) -> None:
        if self._inside >= self._most:
            raise HTTPError(503, reason='too many ask for this at a time: try again')
        self._inside += 1
        try:
            await self._free.acquire()
        except BaseException:
            self._inside -= 1
            raise

    async def __aexit__(self, *error: object) -> None:
        self._inside -= 1
        self._free.release()


class LivePages:
    """
    The pages that show the rig as it is, and what they are sent.

    Used in the thread of the server only.

    Attributes
    ----------
    viewers : set of Viewer
    view : View
        What was published last.
    dropped : int
        Viewers that took nothing any more.
    """

    def __init__(self) -> None:
        self.viewers: set[Viewer] = set()
        self.view = View()
        self.dropped = 0
        self._encoded: dict[int, bytes] = {}
        self._before: dict[int, View] = {}

    def publish(self, view: View) -> None:
        """Send each viewer the difference to what it has."""
        self.view = view
        self._encoded.clear()
        self._before.clear()
        for viewer in list(self.viewers):
            viewer.update(view)

    def since(self, before: View) -> bytes:
        """Return what has changed since a view, as the page gets it: encoded once for all."""
        key = id(before)
        if key not in self._encoded or self._before[key] is not before:
            self._before[key] = before  # kept alive: its id is its name
            text = json.dumps(changes(before, self.view), allow_nan=False, separators=(',', ':'))
            self._encoded[key] = text.encode()
        return self._encoded[key]


@dataclass
class Site:
    """
    What every request may need.

    Parameters
    ----------
    port : int
        TCP port.
    access : Access
        Who may do what.
    command : callable
        Does what an operator asks for.
    title : str
        Of the page: the name of the rig.
    recordings : Recordings
        What the second page shows.
    words : Words
        In which answers are told.

    Attributes
    ----------
    session_s : float
        How long after a token was typed it lets this browser view or command.
    live : LivePages
    reading, signing, asking : Turns
        Of who has the disk read, types a wrong token, waits for the answer of a command.
    files : dict of str to bytes
        By name; the same for everybody.
    version : str
        Of the files: a page of another version reloads itself.
    """

    port: int
    access: Access
    command: Command
    title: str
    recordings: Recordings
    words: Words
    session_s: float = 12 * 3600.0
    live: LivePages = field(default_factory=LivePages)
    reading: Turns = field(default_factory=lambda: Turns(4, 32))
    signing: Turns = field(default_factory=lambda: Turns(16, 16))
    asking: Turns = field(default_factory=lambda: Turns(16, 16))
    files: dict[str, bytes] = field(init=False)
    version: str = field(init=False)

    def __post_init__(self) -> None:
        self.files = {path.name: path.read_bytes() for path in _STATIC.iterdir() if path.is_file()}
        self.files['colours.css'] = (
            f':root {{ {palette_css(dark=False)} }}\n'
            f':root[data-scheme="night"] {{ {palette_css(dark=True)} }}\n'
        ).encode()
        whole = b''.join(content for _, content in sorted(self.files.items()))
        self.version = hashlib.sha256(whole).hexdigest()[:12]
