"""
The console of a run: what the console node prints is shown, and keys are calls to services.

One way for all verbs that start nodes.
"""

from __future__ import annotations

import json
import os
import re
import select
import subprocess
import sys
import threading
import time
from collections.abc import Collection, Iterator
from contextlib import suppress
from queue import Empty, Queue
from typing import Any

from hunt_ros.cli.support.processes import NodeSpec
from hunt_ros.cli.support.screen import STYLES
from hunt_ros.cli.support.supervisor import Supervisor
from hunt_ros.cli.support.view import View
from hunt_ros.errors import HuntError
from hunt_ros.services import CONFIRM_KEY, KEYS, MOVING_KEYS, QUIT_KEY, SERVICES

Line = dict[str, Any]

#: It is looked so often whether a node has ended, and for keys, s.
_LOOK_S, _KEYS_S = 0.25, 0.05
#: The most that nodes take to come up on a busy machine, s.
_READY_S = 60.0
#: So long a key waits for its second one, s.
_CONFIRM_S = 5.0
#: What a key of several characters sends: CSI (arrows, functions), SS3 (F1 to F4), or with Alt.
_SEQUENCE = re.compile(r'\x1b(\[[0-?]*[ -/]*[@-~]|O.|.)?', re.DOTALL)
#: Characters that come within this are of one key, or pasted, s: nobody types so fast.
_BURST_S = 0.03
#: It is read so long at most, s; what follows a pasted text so soon may be its end, s.
_LONGEST_S, _DEAF_S = 0.3, 0.3


class Console:
    """
    Shows what the console node prints, and calls what keys ask for meanwhile; a context manager.

    Without a terminal no key ever comes, and it only reads the lines.

    Parameters
    ----------
    supervisor : Supervisor
        Starts the console node, again and again if it must: nothing depends on it.
    view : View
        Shows every line, and what each key does.
    names : collection of str
        The nodes of the run: a key whose service none of them offers does nothing.

    What sets the roller going, or ends the run while it turns, wants a second key.
    """

    def __init__(self, supervisor: Supervisor, view: View, names: Collection[str] = ()) -> None:
        self._supervisor = supervisor
        self._view = view
        self._lines: Queue[Line] = Queue()
        self._look_at = 0.0
        self._services = {key: word for key, word in KEYS.items() if SERVICES[word].node in names}
        self._keys = Keys()
        #: Topics that are not shown any more.
        self.hidden: tuple[str, ...] = ()
        #: The key that waits for its second one, and until when.
        self._unconfirmed, self._until_s = '', 0.0
        supervisor.start(NodeSpec('console', piped=True), self._attach)

    def __enter__(self) -> Console:
        if self._services:
            self._keys.__enter__()
        if self._keys.active:
            self._offer()
        return self

    def __exit__(self, *error: object) -> None:
        self._keys.__exit__(*error)

    def _attach(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        threading.Thread(target=self._read, args=(process,), daemon=True).start()

    def _read(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        for text in process.stdout:
            with suppress(ValueError):  # a warning of some library
                self._lines.put(json.loads(text))

    def lines(self, timeout_s: float) -> Iterator[Line]:
        """
        Show the lines that come within `timeout_s` seconds, and iterate over them.

        What becomes of the processes of the run comes as lines of the topic `process`.

        Raises
        ------
        HuntError
            If a node ended and is not started again.
        KeyboardInterrupt
            If the key to quit was pressed: it is taken as Ctrl-C is.
        """
        deadline = time.monotonic() + timeout_s
        while (left_s := deadline - time.monotonic()) > 0.0:
            self._obey()
            for line in self._come(min(left_s, _KEYS_S if self._keys.active else _LOOK_S)):
                if line['topic'] not in self.hidden:
                    self._view.show(line)
                yield line

    def _come(self, wait_s: float) -> Iterator[Line]:
        """Yield what has become of the processes, and the next line if one comes."""
        if time.monotonic() >= self._look_at:
            self._look_at = time.monotonic() + _LOOK_S
            for text in self._supervisor.look():
                yield {'topic': 'process', 'data': text}
        with suppress(Empty):
            line = self._lines.get(timeout=wait_s)
            if line['topic'] == '/diagnostics':
                self._supervisor.heard(str(line['name']))
            yield line

    def wait_until_up(self, names: Collection[str]) -> None:
        """
        Wait until each node has reported its health.

        Raises
        ------
        HuntError
            Naming the nodes that did not come up, or the one that ended.
        """
        missing = set(names)
        for line in self.lines(_READY_S):
            if line['topic'] == '/diagnostics':
                missing.discard(str(line['name']).rsplit('/', 1)[-1])
            if not missing:
                return
        raise HuntError(f'not up after {_READY_S:.0f} s: {", ".join(sorted(missing))}')

    def call(self, word: str) -> None:
        """Ask for a service by its word of `hunt call`; the answer comes as a line."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f'{word}\n')
            self._process.stdin.flush()
        except OSError:
            said = {'ok': False, 'message': 'not asked: the console is being started again'}
            self._lines.put({'topic': 'answer', 'service': SERVICES[word].name, **said})

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
        if key == QUIT_KEY and (turns := self._view.drive_mps('speed_mps')) > 0.0:
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


class Keys:
    """
    Reads single keys without waiting for the end of a line; a context manager.

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
        if sys.stdin is not None and sys.stdin.isatty() and _in_front(sys.stdin.fileno()):
            import termios
            import tty

            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(self, *error: object) -> None:
        if self._before is not None:
            import termios

            with suppress(OSError, termios.error):  # the terminal is gone
                termios.tcsetattr(sys.stdin, termios.TCSANOW, self._before)
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
            read = b''
            with suppress(OSError):
                read = os.read(sys.stdin.fileno(), 1024)
            found += read
            if not read:  # the terminal is gone, or the shell's
                self._before = None
            if time.monotonic() > until_s:
                break
        keys = set(_SEQUENCE.sub('', found.decode(errors='replace')))
        if len(keys) == 1 and time.monotonic() > self._deaf_s:
            return keys.pop()
        if len(keys) > 1:
            self._deaf_s = time.monotonic() + _DEAF_S
        return ''


def _in_front(terminal: int) -> bool:
    """Return True unless what is typed there is for the shell, as after `hunt run &`."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:  # no shell has it
        return True
