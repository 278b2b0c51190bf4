"""The keys by which an operator commands a rig, while a verb shows it: one way for all verbs."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator
from types import TracebackType

from hunt_ros.cli.support.console_link import ConsoleLink, Line
from hunt_ros.cli.support.keys import Keys
from hunt_ros.cli.support.view import View
from hunt_ros.services import KEYS, QUIT_KEY, SERVICES

#: Keys are looked for so often, s.
_LOOK_S = 0.05


class KeyCommands:
    """
    Reads the lines of the console, and calls what keys ask for meanwhile; a context manager.

    Without a terminal no key ever comes, and it only reads the lines.

    Parameters
    ----------
    link : ConsoleLink
        The console.
    view : View
        Says what each key does.
    names : collection of str
        The nodes of the run: a key whose service none of them offers does nothing.
    """

    def __init__(self, link: ConsoleLink, view: View, names: Collection[str]) -> None:
        self._link = link
        self._view = view
        self._services = {
            key: SERVICES[word] for key, word in KEYS.items() if SERVICES[word].node in names
        }
        self._keys = Keys()

    def __enter__(self) -> KeyCommands:
        self._keys.__enter__()
        if self._keys.active:
            self._offer()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._keys.__exit__(kind, error, trace)

    def lines(self, timeout_s: float) -> Iterator[Line]:
        """
        Iterate over the lines that come within `timeout_s` seconds; see `ConsoleLink.lines`.

        Raises
        ------
        HuntError
            If a node ended by itself.
        KeyboardInterrupt
            If the key to quit was pressed: it is taken as Ctrl-C is.
        """
        deadline = time.monotonic() + timeout_s
        while True:
            self._obey()
            left_s = deadline - time.monotonic()
            if left_s <= 0.0:
                return
            yield from self._link.lines(min(left_s, _LOOK_S) if self._keys.active else left_s)

    def call(self, service: str) -> None:
        """Ask for a service, see `ConsoleLink.call`."""
        self._link.call(service)

    def _obey(self) -> None:
        """Do what the keys ask for that were pressed since."""
        for key in self._keys.pressed().lower():
            if key == QUIT_KEY:
                raise KeyboardInterrupt
            if key in self._services:
                self.call(self._services[key].name)
            else:
                self._offer()

    def _offer(self) -> None:
        """Say what each key does."""
        words = [f'{"space" if key == " " else key}: {KEYS[key]}' for key in self._services]
        self._view.offer([*words, f'{QUIT_KEY}: quit'])
