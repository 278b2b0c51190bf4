"""Whole recordings: what is forced is named, and is not taken for the hunting."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from hunt_ros.bag import write_record
from hunt_ros.cli.main import main
from hunt_ros.samples import Record, Series

TIME = np.arange(0.0, 30.0, 0.005)


def warnings_of(path: Path, lateral: np.ndarray, speed: np.ndarray, capsys) -> list[str]:
    """Replay displacements, m, and speeds, m/s, without a form; return the warnings."""
    stamps = np.round(TIME * 1e9).astype(np.int64)
    noise = 5e-6 * np.random.default_rng(3).normal(size=TIME.size)
    record = Record({'lateral': Series(stamps, lateral + noise), 'speed': Series(stamps, speed)})
    bag = write_record(path / 'bag', record)
    main(['replay', str(bag), '--json', '-'])
    found: list[str] = json.loads(capsys.readouterr().out)['warnings']
    return found


def hit(frequency: float, rate: float) -> np.ndarray:
    """A hit at 5 s of 1 mm that decays, or motion that grows to 1 mm at the end."""
    growth = np.exp(rate * (TIME - TIME[-1])) if rate > 0.0 else np.exp(rate * (TIME - 5.0))
    on = np.where((rate > 0.0) | (TIME > 5.0), growth, 0.0)
    swing: np.ndarray = 1e-3 * on * np.cos(2.0 * np.pi * frequency * TIME)
    return swing


@pytest.mark.parametrize('rate', [-0.5, 0.2])
@pytest.mark.parametrize('line', [2e-4, 4e-3])
def test_a_steady_line_beside_a_hit_is_not_the_hunting(tmp_path, capsys, rate, line) -> None:
    steady = line * np.sin(2.0 * np.pi * 19.4 * TIME)
    found = warnings_of(tmp_path, hit(2.9, rate) + steady, np.full(TIME.size, 7.0), capsys)
    assert not any('taken for the hunting' in words for words in found)
    assert any(words.startswith('a line at 19.4 Hz is forced') for words in found)


@pytest.mark.parametrize('rate', [-0.5, 0.2])
def test_a_hit_outside_the_usual_range_is_the_hunting(tmp_path, capsys, rate) -> None:
    steady = 2e-4 * np.sin(2.0 * np.pi * 19.4 * TIME)
    found = warnings_of(tmp_path, hit(8.0, rate) + steady, np.full(TIME.size, 7.0), capsys)
    (words,) = (words for words in found if 'taken for the hunting' in words)
    assert float(words.split(' Hz')[0].split()[-1]) == pytest.approx(8.0, rel=0.02)


def test_lines_over_the_steps_of_a_staircase_are_named(tmp_path, capsys) -> None:
    speed = np.interp(TIME, [0.0, 9.0, 10.0, 19.0, 20.0, 30.0], [5.0, 5.0, 6.0, 6.0, 7.2, 7.2])
    turning = 3e-4 * np.cos(2.0 * np.pi * 1.06 * np.cumsum(speed) * 0.005)
    fixed = 2e-4 * np.sin(2.0 * np.pi * 12.5 * TIME)
    found = warnings_of(tmp_path, turning + fixed, speed, capsys)
    assert 'a line at 1.06 v Hz is forced: it follows the speed' in found
    assert any(words.startswith('a line at 12.5 Hz is forced') for words in found)
    assert not any('taken for the hunting' in words for words in found)
