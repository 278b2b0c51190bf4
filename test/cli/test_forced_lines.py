"""Whole recordings: what is forced is named, and is not taken for the hunting."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from made import record_of, rig_settings, up_and_down

from hunt_ros.bag import write_record
from hunt_ros.cli.main import main
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import Kick, simulate
from hunt_ros.samples import Record, Series

TIME = np.arange(0.0, 30.0, 0.005)


def warnings_of(path: Path, lateral: np.ndarray, capsys) -> list[str]:
    """Replay displacements, m, at 7 m/s without a form; return the warnings."""
    noise = 5e-6 * np.random.default_rng(3).normal(size=TIME.size)
    record = record_of(TIME, lateral=lateral + noise, speed=7.0)
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
    found = warnings_of(tmp_path, hit(2.9, rate) + steady, capsys)
    assert not any('taken for the hunting' in words for words in found)
    assert any(words.startswith('line at 19.4 Hz: forced, not hunting') for words in found)


@pytest.mark.parametrize('rate', [-0.5, 0.2])
def test_a_hit_outside_the_usual_range_is_the_hunting(tmp_path, capsys, rate) -> None:
    steady = 2e-4 * np.sin(2.0 * np.pi * 19.4 * TIME)
    found = warnings_of(tmp_path, hit(8.0, rate) + steady, capsys)
    (words,) = (words for words in found if 'taken for the hunting' in words)
    assert float(words.split(' Hz')[0].split()[-1]) == pytest.approx(8.0, rel=0.02)


#: Turns of the roller in a metre of way: a diameter that nobody would assume.
DIAMETER = 0.36
TURNS = 1.0 / (np.pi * DIAMETER)


@pytest.fixture(scope='module')
def staircase() -> Record:
    """Up into the hysteresis and down, with a bump on the way; without roughness."""
    profile = up_and_down([5.6, 6.4, 7.2, 8.0], 20.0)
    settings = rig_settings(100.0, initial_speed=5.6)
    kicks = [Kick(50.0, lateral_m=5e-4)]
    return simulate(paper_rig(), settings, profile, profile.duration_s, kicks, seed=1)


def with_lines(
    record: Record, orders: dict[float, float], fixed: dict[float, float], angle: bool
) -> Record:
    """Add lines, order or frequency (Hz) to amplitude (m), and the roller's angle or none."""
    lateral, speed = record['lateral'], record['speed']
    time = (lateral.stamps_ns - lateral.stamps_ns[0]) * 1e-9
    running = np.interp(lateral.stamps_ns, speed.stamps_ns, speed.values)
    turned = np.concatenate([[0.0], np.cumsum(running[1:] * np.diff(time))]) * TURNS
    values = lateral.values.copy()
    for order, size in orders.items():
        values += size * np.cos(2.0 * np.pi * order * turned + order)
    for frequency, size in fixed.items():
        values += size * np.cos(2.0 * np.pi * frequency * time)
    channels = {'lateral': Series(lateral.stamps_ns, values), 'speed': speed}
    if angle:
        channels['roller'] = Series(lateral.stamps_ns, 2.0 * np.pi * turned)
    return Record(channels, record.source)


def assert_lines(named: list[str], expected: list[str]) -> None:
    """Compare lines in words: of one kind, and within a part in a hundred."""
    got, wanted = (
        sorted(words.split(':')[0].split(maxsplit=3)[2:] for words in lines)
        for lines in (named, expected)
    )
    assert [kind for _, kind in got] == [kind for _, kind in wanted]
    for (number, _), (truth, _) in zip(got, wanted, strict=True):
        assert float(number) == pytest.approx(float(truth), rel=0.01)


CASES = [
    # orders, fixed lines, angle?, options; what is named
    ({1.0: 1e-4, 1.7: 2e-4}, {}, True, [], ["line at 1.7 times the roller's turn"]),
    (
        {1.0: 1e-4, 1.7: 1e-4, DIAMETER / 0.15: 1e-4},
        {},
        False,
        ['wheel_diameter_m=0.15', 'roller_diameter_m=0.36', 'lines=[1]'],
        ["line at 1.7 times the roller's turn"],
    ),
    (
        {1.0: 1e-4, 1.7: 1e-4, DIAMETER / 0.15: 1e-4},
        {},
        False,
        ['roller_diameter_m=0.36', 'lines=[1]'],
        ["line at 1.7 times the roller's turn", "line at 2.4 times the roller's turn"],
    ),
    ({1.7: 3e-4}, {}, False, ['lines='], [f'line at {1.7 * TURNS:.3g} v Hz']),
    # Larger than the limit cycle, and near to it.
    ({}, {13.2: 2e-3}, True, [], ['line at 13.2 Hz']),
    ({}, {4.4: 1e-4}, True, [], ['line at 4.4 Hz']),
    ({}, {3.6: 8e-5}, True, [], ['line at 3.6 Hz']),
]


@pytest.mark.parametrize(('orders', 'fixed', 'angle', 'options', 'expected'), CASES)
def test_forced_lines_of_a_staircase_are_named_and_do_not_hunt(
    staircase, tmp_path, capsys, orders, fixed, angle, options, expected
) -> None:
    bag = write_record(tmp_path / 'bag', with_lines(staircase, orders, fixed, angle))
    options = [word for option in options for word in ('--set', option)]
    main(['identify', str(bag), *options, '--json', str(tmp_path / 'result.json')])
    said = [line for line in capsys.readouterr().out.splitlines() if 'forced' in line]
    document = json.loads((tmp_path / 'result.json').read_text())
    assert document['frequency_hz']['value'] == pytest.approx(2.83, rel=0.03)
    named = [words for words in document['warnings'] if 'forced, not hunting' in words]
    assert_lines(named, expected)
    assert said == [f'warning: {words}' for words in named]


def test_forced_lines_are_named_beside_a_normal_form(staircase, tmp_path, capsys) -> None:
    form = Path(__file__).parents[2] / 'bags' / 'paper.yaml'
    record = with_lines(staircase, {1.0: 1e-4, 1.7: 1e-4}, {4.4: 1e-4}, True)
    bag = write_record(tmp_path / 'bag', record)
    main(['replay', str(bag), '--normal-form', str(form), '--json', '-'])
    found = json.loads(capsys.readouterr().out)['warnings']
    named = [words for words in found if 'forced, not hunting' in words]
    assert_lines(named, ["line at 1.7 times the roller's turn", 'line at 4.4 Hz'])
