"""Single keys of a terminal, while a program runs on it."""

from __future__ import annotations

import os
import re
import select
import sys
import time
from contextlib import suppress
from typing import Any

#: What a key of several characters sends: CSI (arrows, functions), SS3 (F1 to F4), or with Alt.
_SEQUENCE = re.compile(r'\x1b(\[[0-?]*[ -/]*[@-~]|O.|.)?', re.DOTALL)
#: Characters that come within this are of one key, or pasted, s: nobody types so fast.
_BURST_S = 0.03
#: It is read so long at most, s; what follows a pasted text so soon may be its end, s.
_LONGEST_S, _DEAF_S = 0.3, 0.3


class Keys:
    """
    Reads keys without waiting for the end of a line; a context manager.

    Only where standard input is a terminal: elsewhere no key ever comes. The terminal is left
    as it was found, and Ctrl-C still interrupts.
    """

    def __init__(self) -> None:
        self._before: Any = None
        self._deaf_s = 0.0

    @property
    def active(self) -> bool:
        """True where keys may come."""
        return self._before is not None

    def __enter__(self) -> Keys:
        if sys.stdin is not None and sys.stdin.isatty():
            import termios
            import tty

            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(self, *error: object) -> None:
        if self._before is not None:
            import termios

            with suppress(OSError, termios.error):  # the terminal is gone
                termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)
            self._before = None

    def pressed(self) -> str:
        """
        Return the key that was pressed since this was asked before; '' for none.

        Keys of several characters (arrows, functions, the wheel of a mouse) are none, and neither
        is a text that was pasted; a key that is held down is one.
        """
        found = b''
        until_s = time.monotonic() + _LONGEST_S
        while self.active and select.select([sys.stdin], [], [], _BURST_S if found else 0.0)[0]:
            read = os.read(sys.stdin.fileno(), 1024)
            found += read
            if not read:  # the terminal is gone
                self._before = None
            if time.monotonic() > until_s:
                break
        keys = set(_SEQUENCE.sub('', found.decode(errors='replace')))
        if len(keys) == 1 and time.monotonic() > self._deaf_s:
            return keys.pop()
        if len(keys) > 1:
            self._deaf_s = time.monotonic() + _DEAF_S
        return ''
