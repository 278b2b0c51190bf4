"""`inspect` names what is wrong and where in time, and nothing in a sound recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hunt_ros.bag import write_record
from hunt_ros.bag.inspection import inspect
from hunt_ros.samples import Record, Series


def kinds(path: Path) -> list[tuple[str, float | None]]:
    return [(problem.kind, problem.time_s) for problem in inspect(path).problems]


def test_a_sound_recording_has_no_problems(bag: Path, record: Record) -> None:
    found = inspect(bag)
    assert found.problems == []
    assert found.messages == sum(map(len, record.values())) + 1
    rates = {topic.name: topic.rate_hz for topic in found.topics}
    assert abs(rates['/rig/lateral'] - 1000.0) < 1e-6
    assert found.notes['rig'] == 'the rig'
    assert found.to_json()['topics'][0]['name'] == '/rig/hunting/normal_form'


def test_gap_stop_and_missing_channel_are_found_at_their_time(new_record, tmp_path: Path) -> None:
    record = new_record(seconds=10.0)
    begin = record.start_ns
    lateral, yaw = record['lateral'], record['yaw']
    keep = (lateral.stamps_ns < begin + 3e9) | (lateral.stamps_ns > begin + 3.5e9)
    broken = Record(
        {
            'lateral': Series(lateral.stamps_ns[keep], lateral.values[keep]),
            'yaw': yaw.between(begin, begin + 6_000_000_000),
        }
    )
    found = dict(kinds(write_record(tmp_path / 'run', broken)))
    assert set(found) == {'gap', 'stopped', 'missing_channel'}
    assert abs(found['gap'] - 3.0) < 0.01
    assert abs(found['stopped'] - 6.0) < 0.01


def test_a_clock_that_jumps_back_is_found(tmp_path: Path) -> None:
    from hunt_ros.bag import BagWriter
    from hunt_ros.bag.record_rows import CHANNEL_FIELDS, serialise

    stamps = 10**18 + np.arange(400) * 10_000_000
    stamps[200:] -= 1_500_000_000
    with BagWriter(tmp_path / 'run', chunk_bytes=3000) as writer:
        for name in ('lateral', 'speed'):
            key = writer.topic(f'/rig/{name}', CHANNEL_FIELDS[name][0])
            messages = serialise(name, Series(stamps, np.zeros(400)))
            for at, message in zip(stamps.tolist(), messages, strict=True):
                writer.write(key, at, bytes(message))
    found = inspect(tmp_path / 'run').problems
    assert [problem.kind for problem in found] == ['clock_jump', 'clock_jump']
    assert '1.490 s' in found[0].text
    assert abs(found[0].time_s - 1.99) < 1e-6


def test_events_at_any_time_are_no_gaps(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    stamps = 10**18 + np.sort(rng.integers(0, 10**11, size=200))
    record = Record(
        {'lateral': Series(stamps, np.zeros(200)), 'speed': Series(stamps, np.zeros(200))}
    )
    assert kinds(write_record(tmp_path / 'run', record)) == []
