"""Keys of a terminal while a rig is shown on it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from hunt_ros.cli.main import main
from hunt_ros.cli.support import processes, suite
from hunt_ros.services import KEYS, SERVICES


class _Link:
    """Stands for the console: presses keys, and notes the calls."""

    def __init__(self, keyboard: int, keys: bytes) -> None:
        self._keyboard, self._keys = keyboard, keys
        self.calls: list[str] = []
        self.rounds = 0

    def lines(self, timeout_s: float) -> Iterator[dict[str, str]]:
        self.rounds += 1
        assert self.rounds < 100, 'q did not end it'
        os.write(self._keyboard, self._keys[:1])
        self._keys = self._keys[1:]
        return iter(())

    def call(self, service: str) -> None:
        self.calls.append(service)


@pytest.fixture
def pressed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    pytest.importorskip('termios')
    monkeypatch.setattr(processes, 'require_ros', lambda: None)
    monkeypatch.setattr(suite, 'start_nodes', lambda *given: None)

    def run(keys: str, *words: str) -> list[str]:
        keyboard, terminal = os.openpty()
        link = _Link(keyboard, keys.encode())
        monkeypatch.setattr(suite, 'start_console', lambda *given: link)
        with os.fdopen(terminal) as stdin:
            monkeypatch.setattr('sys.stdin', stdin)
            assert main(['run', *words, '--directory', str(tmp_path)]) == 0
        os.close(keyboard)
        return link.calls

    return run


def test_each_key_calls_its_service_and_q_ends_the_run(pressed) -> None:
    calls = pressed('sEa rm xq', '--simulated')
    words = ('start-profile', 'emergency-stop', 'acknowledge', 'stop-profile', 'resume-profile')
    last = ('recording/mark', 'speed/stop_profile')
    assert calls == [*(SERVICES[word].name for word in words), *last]


def test_a_key_of_a_node_that_was_not_started_does_nothing(pressed) -> None:
    assert pressed('semq', '--listen') == ['recording/mark']


def test_the_keys_stand_in_the_readme() -> None:
    readme = (Path(__file__).parents[3] / 'README.md').read_text(encoding='utf-8')
    for key, word in KEYS.items():
        assert f'`{"space" if key == " " else key}` {word}' in readme
