"""Single keys of a terminal, while a program runs on it."""

from __future__ import annotations

import os
import select
import sys
from types import TracebackType
from typing import Any


class Keys:
    """
    Reads keys without waiting for the end of a line; a context manager.

    Only where standard input is a terminal: elsewhere no key ever comes. The terminal is left
    as it was found, and Ctrl-C still interrupts.
    """

    def __init__(self) -> None:
        self._before: Any = None

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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._before is not None:
            import termios

            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)
            self._before = None

    def pressed(self) -> str:
        """Return the keys that were pressed since this was asked before; '' for none."""
        found = b''
        while self.active and select.select([sys.stdin], [], [], 0.0)[0]:
            read = os.read(sys.stdin.fileno(), 64)
            found += read
            if not read:  # the terminal is gone
                self._before = None
        return found.decode(errors='replace')
