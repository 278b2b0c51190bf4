"""The replay of a recorded live run: its settings are those of the recording."""

from __future__ import annotations

import json
import struct
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from made import record_of

from hunt_ros.bag import BagWriter
from hunt_ros.bag.record_writer import messages_of
from hunt_ros.cli.main import main
from hunt_ros.detection import DetectorConfig, JournalEntry

UNKNOWN = 'settings of the recording that this version does not have: '


def _bag(path: Path, journal: list[JournalEntry]) -> str:
    """Write three quiet seconds with the journal of their live run."""
    noise = 1e-5 * np.random.default_rng(1).standard_normal(300)
    record = record_of(1.0 + np.arange(300) / 100.0, lateral=noise, speed=7.0)
    with BagWriter(path) as bag:
        lines = '\n'.join(entry.to_text() for entry in journal)
        raw = lines.encode() + b'\0'
        key = bag.topic('/rig/hunting/journal', 'std_msgs/msg/String', latched=True)
        bag.write(key, record.start_ns, b'\0\1\0\0' + struct.pack('<I', len(raw)) + raw)
        for message in messages_of(record, bag.topic, 'rig'):
            bag.write(*message)
    return str(path)


def _replayed(words: list[str], capsys: pytest.CaptureFixture[str]) -> dict:
    assert main(['replay', *words, '--json', '-']) == 0
    return json.loads(capsys.readouterr().out)


def test_settings_of_another_version_are_left_out_and_named(tmp_path, capsys) -> None:
    config = asdict(DetectorConfig(channels=('lateral', 'speed'), critical_speed_mps=6.0))
    old = {**config, 'roughness': [1, 2]}
    later = [
        JournalEntry('start', None, config=old),
        JournalEntry('settings', None, config={**old, 'whiteness': 3.0}),
    ]
    result = _replayed([_bag(tmp_path / 'journal', later)], capsys)
    assert UNKNOWN + 'roughness, whiteness' in result['warnings']
    assert result['summary']['region_time_s']['unstable'] > 2.0, 'the others are in force'

    now = _bag(tmp_path / 'now', [JournalEntry('start', None, config=config)])
    assert not [line for line in _replayed([now], capsys)['warnings'] if UNKNOWN in line]
    for words in (['--set', 'roughness=[1]'], ['--fresh', '--set', 'roughness=[1]']):
        assert main(['replay', now, *words]) == 2
        assert 'roughness' in capsys.readouterr().err


def test_what_ran_beside_the_detector_is_told_by_the_journal_too(tmp_path, capsys) -> None:
    config = asdict(DetectorConfig(channels=('lateral', 'speed')))
    told = {'criteria': ['cfr_213_333'], 'criteria_scale': 1e-4, 'forecast': 'off'}
    journal = [JournalEntry('start', None, config=config, companions=told)]
    result = _replayed([_bag(tmp_path / 'run', journal)], capsys)
    assert result['summary']['forecast'] is None
    assert [one['criterion'] for one in result['criteria']] == ['cfr_213_333']
