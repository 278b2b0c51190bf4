"""Keys of a terminal while a rig is shown on it."""

from __future__ import annotations

import io
import os
import pty
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from hunt_ros.cli.support import console as module
from hunt_ros.cli.support.console import Console
from hunt_ros.cli.support.view import View
from hunt_ros.services import KEYS
from hunt_ros.suite import LISTENERS, SOURCES

START, RESUME, EMERGENCY = 'start-profile', 'resume-profile', 'emergency-stop'


class _Run:
    """Stands for the processes and the console: presses what comes at once, notes the calls."""

    def __init__(self, keyboard: int, bursts: list[str]) -> None:
        self._keyboard, self._bursts = keyboard, bursts
        self.stdin, self.stdout = io.StringIO(), ()

    def start(self, spec: object, attach: Callable[[object], None]) -> None:
        attach(self)

    def look(self) -> list[str]:
        if self._bursts:
            os.write(self._keyboard, self._bursts.pop(0).encode())
        return []


class _View:
    """Stands for the screen."""

    def __init__(self, speed_mps: float) -> None:
        self.speed_mps = speed_mps
        self.said: list[str] = []

    def drive_mps(self, name: str) -> float:
        return self.speed_mps

    def say(self, text: str, style: str = '') -> None:
        self.said.append(text)

    def offer(self, keys: list[str]) -> None:
        self.said.append('keys')


@pytest.fixture
def pressed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., tuple[list[str], _View]]]:
    """Return what presses keys, one burst after the other: it gives the calls and the screen."""
    keyboard, terminal = os.openpty()
    with os.fdopen(terminal) as stdin:
        monkeypatch.setattr('sys.stdin', stdin)
        monkeypatch.setattr(module, '_LOOK_S', 0.05)

        def press(*bursts: str, speed_mps: float = 0.0, names=(*LISTENERS, *SOURCES)):
            run, view = _Run(keyboard, list(bursts)), _View(speed_mps)
            with Console(run, view, names) as console:  # type: ignore[arg-type]
                list(console.lines(0.2 + 0.1 * len(bursts)))
            return run.stdin.getvalue().split(), view

        yield press
    os.close(keyboard)


def test_each_key_calls_its_service(pressed) -> None:
    calls, _ = pressed('e', 'a', ' ', 'm', 'x')
    words = ('emergency-stop', 'acknowledge', 'stop-profile', 'mark')
    assert calls == list(words)


def test_q_ends_the_run_as_ctrl_c_does(pressed) -> None:
    with pytest.raises(KeyboardInterrupt):
        pressed('q')


def test_what_sets_the_roller_going_wants_a_second_key(pressed) -> None:
    assert pressed('s')[0] == []
    calls, view = pressed('s', 'y', 'r', 'y')
    assert calls == [START, RESUME]
    assert 'press y to start the profile' in view.said
    assert pressed('s', 'x', 'y')[0] == [], 'another key takes it back'
    assert pressed('y')[0] == []
    assert pressed('s', 'e', 'y')[0] == [EMERGENCY]


def test_the_end_wants_a_second_key_while_the_roller_turns(pressed) -> None:
    calls, view = pressed('q', 'x', speed_mps=7.5)
    assert calls == []
    assert 'press y to end the run: the roller turns at 7.50 m/s' in view.said
    with pytest.raises(KeyboardInterrupt):
        pressed('q', 'y', speed_mps=7.5)


@pytest.mark.parametrize(
    'sequence',
    ['\x1bOS', '\x1bOR', '\x1bOQ', '\x1b[A', '\x1b[1;5A', '\x1b[15~', '\x1bs', '\x1b[M'],
    ids=['F4', 'F3', 'F2', 'up', 'Ctrl-up', 'F5', 'Alt-s', 'mouse'],
)
def test_keys_of_several_characters_do_nothing(pressed, sequence) -> None:
    assert pressed(sequence, sequence * 5, 'y')[0] == []


def test_capitals_and_a_pasted_text_do_nothing_and_a_held_key_is_one(pressed) -> None:
    assert pressed('S', 'E', 'A', 'Q')[0] == []
    assert pressed('rm -rf ~; echo yes', 'e')[0] == [], 'the end of what was pasted may be late'
    assert pressed('sy')[0] == []
    assert pressed('eeee')[0] == [EMERGENCY]


def test_a_key_of_a_node_that_was_not_started_does_nothing(pressed) -> None:
    assert pressed('s', 'y', 'e', 'm', names=LISTENERS)[0] == ['mark']


def test_the_keys_stand_in_the_page_of_the_terminal() -> None:
    page = (Path(__file__).parents[3] / 'docs/terminal.md').read_text(encoding='utf-8')
    for key, word in KEYS.items():
        assert f'`{"space" if key == " " else key}` {word}' in page


def test_a_terminal_that_takes_nothing_holds_up_no_end(monkeypatch) -> None:
    ours, theirs = os.openpty()
    ended = False
    with (
        suppress(OSError),  # of a terminal that is gone
        os.fdopen(theirs, 'r') as stdin,
        open(os.dup(theirs), 'w') as stdout,
    ):
        monkeypatch.setattr('sys.stdin', stdin)
        monkeypatch.setattr('sys.stdout', stdout)
        monkeypatch.setenv('TERM', 'xterm')
        view, keys = View().__enter__(), module.Keys().__enter__()
        fills = os.open(os.ttyname(theirs), os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
        with suppress(BlockingIOError):
            while True:
                os.write(fills, b' ' * 1024)
        os.close(fills)
        view.say('ending every node')
        time.sleep(0.5)  # it is being printed

        def end() -> None:
            """End as a run does."""
            keys.__exit__()
            view.__exit__()

        ending = threading.Thread(target=end, daemon=True)
        ending.start()
        ending.join(30.0)
        ended = not ending.is_alive()
        os.close(ours)  # lets go of whoever waits
        ending.join(30.0)
    assert ended


@pytest.mark.parametrize('place', ['&', ''])
def test_job_control_of_a_shell_stops_no_run(tmp_path: Path, place: str) -> None:
    """Ctrl-Z, and `hunt run &`: what has died would not be started again."""
    program = tmp_path / 'program.py'
    program.write_text(
        'import os, signal\n'
        'from pathlib import Path\n'
        'from hunt_ros.cli.support.console import Keys\n'
        'from hunt_ros.cli.support.supervisor import Supervisor\n'
        "with Supervisor('rig', Path('.'), False), Keys() as keys:\n"
        '    os.kill(os.getpid(), signal.SIGTSTP)\n'
        '    keys.pressed()\n'
        f'    Path({str(tmp_path / "came")!r}).write_text(str(keys.active))\n'
    )
    pid, terminal = pty.fork()
    if not pid:
        words = f'set -m; {sys.executable} {program} {place}\nsleep 30'
        os.execvp('sh', ['sh', '-c', words])
    threading.Thread(target=_drain, args=(terminal,), daemon=True).start()
    deadline = time.monotonic() + 30.0
    while not (came := tmp_path / 'came').exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(0.1)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    assert came.read_text() == ('False' if place else 'True'), 'the keys are those of the shell'


def _drain(terminal: int) -> None:
    with suppress(OSError):
        while os.read(terminal, 1024):
            pass
