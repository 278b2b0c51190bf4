"""
How a node process hears that it is to end, from its first moment on.

The standard library only: it is set up before rclpy, numba and scipy are imported.
A signal handler of Python runs between two instructions of the main thread, so not
while that thread is inside a compiler, a driver or a full disk. Here the system writes
each signal into a pipe, and a thread reads the pipe: it ends the process where the
main thread does not come to it.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from typing import NoReturn

#: What the main thread has, from the signal on, to begin its end by itself, s.
_NOTICE_S = 1.0
#: What a node then has to close what it holds, s, unless it says another time.
CLOSING_S = 0.7
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Ending:
    """
    Listens for SIGINT and SIGTERM; to be made once, in the main thread.

    Parameters
    ----------
    name : str
        Of the node, before what is said of it.

    Attributes
    ----------
    asked : threading.Event
        Set when a signal has come.
    doing : str
        What the main thread is doing, for the operator.
    """

    def __init__(self, name: str) -> None:
        self.asked = threading.Event()
        self.doing = 'starting'
        self._name = name
        self._closing = threading.Event()
        self._closing_s = CLOSING_S
        self._pipe, wakeup = os.pipe()
        os.set_blocking(wakeup, False)
        signal.set_wakeup_fd(wakeup, warn_on_full_buffer=False)
        for number in _SIGNALS:
            signal.signal(number, lambda number, frame: None)
        threading.Thread(target=self._listen, name='ending', daemon=True).start()
        # Whoever started this process may have held them back until somebody listens.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)

    def say(self, text: str) -> None:
        """Say to the operator what the node is doing."""
        print(f'{self._name}: {text}', file=sys.stderr, flush=True)

    def close(self, within_s: float) -> None:
        """Take note that the main thread now closes what the node holds, and its time limit."""
        self.doing, self._closing_s = 'closing', within_s
        self._closing.set()

    def leave(self, code: int) -> NoReturn:
        """End the process without waiting for threads of the middleware and of compilers."""
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)

    def _listen(self) -> None:
        os.read(self._pipe, 1)
        self.asked.set()
        if self._closing.wait(_NOTICE_S):
            time.sleep(self._closing_s)
        self.say(f'ended while {self.doing}')
        self.leave(0)
