"""`hunt run` and `hunt demo` on a terminal: what they show, their keys, how they leave it."""

from __future__ import annotations

import fcntl
import os
import re
import signal
import struct
import subprocess
import termios
import threading
from collections.abc import Callable, Iterator

import pytest
from processes import HUNT, children

from hunt_ros.bag import read_record

pytestmark = pytest.mark.slow

#: Where a drawing begins: the rows of the one before are gone.
_ANEW = re.compile(r'\r\x1b\[2K(?:\x1b\[1A\x1b\[2K)*')
_CODES = re.compile(r'\x1b\[[0-9;?]*[A-Za-z]')


class Terminal:
    """A pseudo-terminal with a program on it, as a person has one."""

    def __init__(self, words: list[str], machine) -> None:
        self._machine = machine
        self.ours, self.theirs = os.openpty()
        self.before = termios.tcgetattr(self.theirs)
        self.resize(80, 24)
        self._bytes, self._pressed = b'', 0
        inherited = {k: v for k, v in os.environ.items() if k not in ('COLUMNS', 'LINES')}
        self.program = subprocess.Popen(
            words,
            stdin=self.theirs,
            stdout=self.theirs,
            stderr=self.theirs,
            env={**inherited, 'TERM': 'xterm-256color', 'PYTHONUTF8': '1'},
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        while True:
            try:
                self._bytes += os.read(self.ours, 65536)
            except OSError:
                return

    def resize(self, width: int, height: int) -> None:
        fcntl.ioctl(self.theirs, termios.TIOCSWINSZ, struct.pack('4H', height, width, 0, 0))

    def press(self, keys: str) -> None:
        self._pressed = len(self.text)
        os.write(self.ours, keys.encode())

    @property
    def text(self) -> str:
        return self._bytes.decode(errors='replace')

    def drawing(self) -> list[str]:
        """Return the rows of the last whole drawing, and the log above; empty before the first."""
        drawings = _ANEW.split(self.text)
        return _CODES.sub('', drawings[-2]).split('\r\n') if len(drawings) > 2 else []

    def wait(self, *words: str, timeout_s: float = 30.0) -> None:
        """Wait until all of these are in one drawing."""

        def shown() -> bool:
            assert self.program.poll() is None, self.text[-3000:]
            return all(word in '\n'.join(self.drawing()) for word in words)

        self._machine.until(shown, timeout_s, lambda: (words, self.drawing()))

    def said(self, words: str) -> None:
        """Wait until this has been printed since a key was pressed."""
        self._machine.until(lambda: words in self.text[self._pressed :], told=self.drawing)

    def left(self) -> str:
        """Return what the terminal has shown; it is as it was found."""
        assert termios.tcgetattr(self.theirs) == self.before
        assert '\x1b[?25h' in self.text.rpartition('\x1b[?25l')[2], 'the cursor is shown again'
        assert 'Traceback' not in self.text
        return _CODES.sub('', self.text)


@pytest.fixture
def on_terminal(machine, domain) -> Iterator[Callable[..., Terminal]]:
    """Return a function that runs `hunt` with these words on a terminal."""
    started: list[Terminal] = []

    def start(*words: str) -> Terminal:
        started.append(Terminal([*HUNT, *words], machine))
        return started[-1]

    yield start
    for made in started:
        if made.program.poll() is None:
            os.killpg(made.program.pid, signal.SIGKILL)
            made.program.wait()
        os.close(made.ours)
        os.close(made.theirs)


def test_level_changes_are_seen_silence_is_loud_and_ctrl_c_restores_it(
    on_terminal, machine, tmp_path
) -> None:
    words = ['run', '--simulated', '--one-process', '--directory', str(tmp_path)]
    terminal = on_terminal(*words)
    wait = terminal.wait
    wait('STALE', 'NO WORD FROM THE DETECTOR', 'q: quit', timeout_s=60.0)
    # Silence trips the interlock once all has been well for a while.
    wait('WARN', 'no normal form', 'no reason to trip', timeout_s=90.0)
    terminal.press('e')
    wait('EMERGENCY STOP IS IN FORCE')
    # Answered when the encoder confirms it.
    machine.until(lambda: 'speed/emergency_stop' in terminal.text, told=terminal.drawing)
    terminal.resize(60, 12)

    def fits() -> bool:
        rows = terminal.drawing()
        return 1 < len(rows) <= 12 and max(map(len, rows)) <= 60

    machine.until(fits, told=terminal.drawing)
    wait('EMERGENCY STOP IS IN FORCE', 'WARN')
    (suite,) = children(terminal.program.pid, 'hunting_detector')
    os.kill(suite, signal.SIGSTOP)
    wait('STALE', 'NO WORD FROM THE DETECTOR', 'INTERLOCK TRIPPED')
    wait('WARN', timeout_s=90.0)  # a suite that does not answer is ended and started again
    terminal.press('\x03')
    assert machine.wait_for(terminal.program, 30.0) == 0
    after = terminal.left()
    assert 'speed/emergency_stop' in after, 'what has happened stays on the terminal'
    assert 'ending every node' in after


def test_the_keys_of_the_demo_hold_the_sweep_go_on_stop_it_and_quit(
    on_terminal, machine, tmp_path
) -> None:
    terminal = on_terminal('demo', '--pace', '1', '--out', str(tmp_path))
    wait = terminal.wait
    wait('profile up and down: running', 'q: quit', timeout_s=120.0)
    terminal.press(' ')
    wait('profile up and down: paused')
    terminal.press('r')
    terminal.said('press y to resume the profile')
    terminal.press('y')
    terminal.said('speed/resume_profile: ')
    wait('profile up and down: running')
    terminal.press('m')
    terminal.said('recording/mark: ')
    terminal.press('e')
    terminal.said('The sweep has ended early')
    wait('EMERGENCY STOP IS IN FORCE')
    terminal.press('q')
    terminal.said('press y to end the run')
    terminal.press('y')
    assert machine.wait_for(terminal.program, 60.0) == 130
    assert 'what was recorded is in' in terminal.left()
    (folder,) = tmp_path.glob('demo_*')
    assert not list(folder.glob('*.active')), 'the recording was closed'
    (bag,) = folder.glob('hunt_*')
    assert set(read_record(bag)) == {'lateral', 'yaw', 'roller', 'speed'}
