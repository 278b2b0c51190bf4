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
import select
import signal
import sys
import threading
import time
from contextlib import suppress
from typing import NoReturn

#: What the main thread has, from the signal on, to begin its end by itself, s.
_NOTICE_S = 1.0
#: What a node then has to close what it holds, s, unless it says another time.
CLOSING_S = 0.7
#: The last comes where a terminal is closed: also to what `ros2 launch` has started in it.
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
#: Who presses Ctrl-C after this, s, does not want to wait; a group and its leader get it at once.
_AGAIN_S = 1.0
_PARENT = os.getppid()


def abandoned() -> bool:
    """Return True where the process that started this one has died."""
    return os.getppid() != _PARENT


class Ending:
    """
    Listens for the signals of an end; to be made once, in the main thread.

    Parameters
    ----------
    name : str
        Of the node, before what is said of it.
    unsafe_s : float
        Other than 0: until it closes, nobody knows that the rig is safe. Its start goes on for so
        long, so that it takes the rig to where it is safe, and another end is a failure.

    Attributes
    ----------
    asked : threading.Event
        Set when a signal has come.
    doing : str
        What the main thread is doing, for the operator.
    """

    def __init__(self, name: str, unsafe_s: float = 0.0) -> None:
        self.asked = threading.Event()
        self.doing = 'starting'
        self._name = name
        self._unsafe_s, self._patient = unsafe_s, not unsafe_s
        self._until_s = 0.0
        self._pipe, wakeup = os.pipe()
        os.set_blocking(wakeup, False)
        signal.set_wakeup_fd(wakeup, warn_on_full_buffer=False)
        for number in _SIGNALS:
            if number == signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN:
                continue  # as nohup leaves it
            signal.signal(number, lambda number, frame: None)
        threading.Thread(target=self._listen, name='ending', daemon=True).start()
        # Whoever started this process may have held them back until somebody listens.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)

    def say(self, text: str) -> None:
        """Say to the operator what the node is doing."""
        with suppress(OSError):  # a full disk
            print(f'{self._name}: {text}', file=sys.stderr, flush=True)

    def grant(self, doing: str, within_s: float, patient: bool = True) -> None:
        """
        Take note of what the main thread does before the end, and its time limit.

        Parameters
        ----------
        doing : str
            For the operator.
        within_s : float
            The process ends after so long, s.
        patient : bool
            False: Ctrl-C ends it at once.
        """
        self.doing, self._patient = doing, patient
        if patient:  # it is closing
            self._unsafe_s = 0.0
        self._until_s = time.monotonic() + within_s
        # The middleware may hang with the lock of Python, which the thread here needs.
        signal.setitimer(signal.ITIMER_REAL, within_s + _NOTICE_S)

    def leave(self, code: int) -> NoReturn:
        """End the process without waiting for threads of the middleware and of compilers."""
        with suppress(OSError):  # who reads it may be gone
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)

    def _listen(self) -> None:
        os.read(self._pipe, 1)
        asked_s = time.monotonic()
        self._until_s = asked_s + (self._unsafe_s or _NOTICE_S)
        self.asked.set()
        while (left_s := self._until_s - time.monotonic()) > 0.0:
            again = select.select([self._pipe], [], [], min(left_s, 0.2))[0]
            late = time.monotonic() - asked_s > _AGAIN_S
            pressed = again and signal.SIGINT in os.read(self._pipe, 64) and not abandoned()
            if pressed and late and not self._patient:
                break
        self.say(f'ended while {self.doing}')
        self.leave(1 if self._unsafe_s else 0)
