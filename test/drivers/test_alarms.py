"""Which alarms there are, and which call nobody for a time."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from hunt_ros.detection import health
from hunt_ros.detection.decision.limits import LIMITS
from hunt_ros.detection.regions import State
from hunt_ros.drivers.alarms import DETECTED, TRIPS
from hunt_ros.drivers.base import DriveBlock
from hunt_ros.drivers.command import DriveLimits
from hunt_ros.drivers.interlock import Heard, InterlockSettings
from hunt_ros.drivers.safety_state import SafetyState, read
from hunt_ros.drivers.speed_guard import SpeedGuard
from hunt_ros.dynamics.profile import Motion
from hunt_ros.errors import ConfigError
from hunt_ros.files import write_whole

S = 1_000_000_000
NOON = 1_800_000_000.0


def _guard(state: SafetyState | None = None) -> SpeedGuard:
    settings = InterlockSettings(amplitude_limit_m=1e-3)
    return SpeedGuard(DriveLimits(), settings, 0.3, state or SafetyState())


def test_the_page_says_of_every_alarm_what_it_means_and_what_to_do() -> None:
    page = (Path(__file__).parents[2] / 'docs/alarm.md').read_text(encoding='utf-8')
    _, _, table = page.partition('| code | cause | consequence | what to do | how soon |\n')
    rows = [line.split(' | ') for line in table.partition('\n\n')[0].splitlines()[1:]]
    assert [row[0].strip('|` ') for row in rows] == [*TRIPS, *DETECTED]
    assert {len(row) for row in rows} == {5}


def test_the_table_has_every_cause_of_the_detector() -> None:
    causes = {State.ESCAPING.label, State.LIMIT_CYCLE.label}
    causes |= {limit.setting for limit in LIMITS if limit.severity == 'alarm'}
    assert {health.SEVERE & bit for bit in health.CODES} == set(health.CODES)
    assert sum(health.CODES) == health.SEVERE
    assert causes | {f'CHANNEL_{code}' for code in health.CODES.values()} == set(DETECTED)


def test_the_table_has_every_cause_of_a_trip() -> None:
    interlock, found = _guard().interlock, []
    for step, told in enumerate(('hunting', 'amplitude', 'drive', 'inputs', 'detector')):
        level = {'hunting': 'ERROR', 'inputs': 'STALE'}.get(told, 'OK')
        motion = Motion(2e-3 if told == 'amplitude' else 1e-5)
        interlock.lost = 'gone' if told == 'drive' else ''
        interlock.hear(step * S, Heard(level, step, step * S, '', math.nan, motion))
        found.append(interlock.trouble(step * S + (told == 'detector') * S).code)
    interlock.displacement_m = 5e-3
    found.append(interlock.trouble(step * S).code)
    interlock.lost, interlock.fault = '', 'too fast'
    found.append(interlock.trouble(step * S).code)
    assert interlock.judge(step * S, 7.0).event == 'interlock_tripped', 'before all has been well'
    assert (interlock.goal_mps, interlock.cause) == (0.0, 'too fast')
    assert found[::-1] == [
        'speed',
        'displacement',
        'detector',
        'inputs',
        'drive',
        'amplitude',
        'hunting',
    ]
    assert found[::-1] == list(TRIPS), 'the gravest first'


def test_an_alarm_and_a_trip_outlive_the_process(tmp_path) -> None:
    guard = _guard()
    block = DriveBlock(np.array([1]), np.array([math.nan]), np.array([7.0]))
    guard.readings.take(0.0, block)
    for k in range(1, 200):
        guard.hear(k * S // 20, Heard('OK', k, k * S // 20))
        guard.watch(k * S // 20, 0)
    guard.hear(10 * S, Heard('ERROR', 200, 10 * S, 'limit cycle', alarm=True))
    assert guard.watch(10 * S, 0).event == 'interlock_tripped'
    assert guard.values()['interlock_code'] == 'hunting'
    write_whole(tmp_path / 'state.json', guard.unsaved(running=False))
    assert guard.unsaved(running=False) == '', 'written once'
    again = _guard(read(tmp_path / 'state.json'))
    assert again.interlock.state == 'tripped'
    assert again.values()['alarm_kept'] == 'limit cycle'


@pytest.mark.parametrize(
    'change',
    [
        ('{', '['),
        ('"running": true', '"running": 1'),
        ('"trip": "",', ''),
        ('"goal_mps": 0.0', '"goal_mps": NaN'),
        ('"goal_mps": 0.0', f'"goal_mps": 1{400 * "0"}'),
        ('"history": []', '"history": 3'),
        ('"history": []', '"history": ["why"]'),
    ],
)
def test_a_state_that_is_none_is_refused(tmp_path, change) -> None:
    path = tmp_path / 'state.json'
    state = SafetyState(running=True)
    assert read(path) is None
    write_whole(path, state.to_json())
    assert read(path) == state
    path.write_text(state.to_json().replace(*change))
    with pytest.raises(ConfigError, match=r'state\.json: cannot read the safety state'):
        read(path)
