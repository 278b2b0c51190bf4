"""The keys by which an operator commands a rig, while a verb shows it: one way for all verbs."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator

from hunt_ros.cli.support.console_link import ConsoleLink, Line
from hunt_ros.cli.support.keys import Keys
from hunt_ros.cli.support.narration import STYLES
from hunt_ros.cli.support.view import View
from hunt_ros.services import CONFIRM_KEY, KEYS, MOVING_KEYS, QUIT_KEY, SERVICES

#: Keys are looked for so often, s.
_LOOK_S = 0.05
#: So long a key waits for its second one, s.
_CONFIRM_S = 5.0


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

    What sets the roller going, or ends the run while it turns, wants a second key.
    """

    def __init__(self, link: ConsoleLink, view: View, names: Collection[str]) -> None:
        self._link = link
        self._view = view
        self._services = {key: word for key, word in KEYS.items() if SERVICES[word].node in names}
        self._keys = Keys()
        #: The key that waits for its second one, and until when.
        self._unconfirmed, self._until_s = '', 0.0

    def __enter__(self) -> KeyCommands:
        self._keys.__enter__()
        if self._keys.active:
            self._offer()
        return self

    def __exit__(self, *error: object) -> None:
        self._keys.__exit__(*error)

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

    def call(self, word: str) -> None:
        """Ask for a service, see `ConsoleLink.call`."""
        self._link.call(word)

    def _obey(self) -> None:
        """Do what the key asks for that was pressed since."""
        key = self._keys.pressed()
        if not key:
            return
        waits = self._unconfirmed if time.monotonic() < self._until_s else ''
        self._unconfirmed = ''
        if waits and key == CONFIRM_KEY:
            self._do(waits)
        elif key in self._services or key == QUIT_KEY:
            if not (does := self._weighty(key)):
                self._do(key)
                return
            self._unconfirmed, self._until_s = key, time.monotonic() + _CONFIRM_S
            self._view.say(f'press {CONFIRM_KEY} to {does}', STYLES['WARN'])
        elif waits:
            self._view.say('nothing is done')
        else:
            self._offer()

    def _weighty(self, key: str) -> str:
        """Return what a key does that wants a second one; '' for others."""
        turns = self._view.drive.get('speed_mps')
        if key == QUIT_KEY and turns:
            return f'end the run: the roller turns at {turns:.2f} m/s'
        return KEYS[key].replace('-', ' the ') if key in MOVING_KEYS else ''

    def _do(self, key: str) -> None:
        if key == QUIT_KEY:
            raise KeyboardInterrupt
        self.call(self._services[key])

    def _offer(self) -> None:
        """Say what each key does."""
        words = [f'{"space" if key == " " else key}: {KEYS[key]}' for key in self._services]
        self._view.offer([*words, f'{QUIT_KEY}: quit'])
