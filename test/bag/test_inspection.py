"""`inspect` names what is wrong and where in time, and nothing in a sound recording."""

from __future__ import annotations

import sqlite3
import struct
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from bags_made import make_record, write_mcap, write_rosbags

from hunt_ros.bag import read_record, write_record
from hunt_ros.bag.inspection import inspect
from hunt_ros.bag.mcap.file import McapFile
from hunt_ros.bag.mcap.records import FOOTER_SIZE, MESSAGE_PREFIX, RECORD
from hunt_ros.samples import Record, Series


@pytest.fixture(scope='module')
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_record(tmp_path_factory.mktemp('small') / 'run', make_record(seconds=2.0))


def kinds(path: Path) -> list[tuple[str, float | None]]:
    return [(problem.kind, problem.time_s) for problem in inspect(path).problems]


def test_gap_stop_and_missing_channel_are_found_at_their_time(tmp_path: Path) -> None:
    record = make_record(seconds=10.0)
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


def test_events_at_any_time_are_no_gaps(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    stamps = 10**18 + np.sort(rng.integers(0, 10**11, size=200))
    still = Series(stamps, np.zeros(200))
    record = Record({'lateral': still, 'speed': still})
    assert kinds(write_record(tmp_path / 'run', record)) == []


def test_messages_that_a_file_without_an_index_has_lost_are_missed(tmp_path) -> None:
    """Its statistics say how many there were."""
    file = write_mcap(tmp_path / 'a.mcap', make_record(seconds=0.1), use_chunking=False)
    whole = bytearray(file.read_bytes())
    with closing(McapFile(file)) as opened:
        place = int(next(iter(opened.loose.values())).starts[7]) - MESSAGE_PREFIX
    length = int.from_bytes(whole[place + 1 : place + 9], 'little')
    del whole[place : place + 9 + length]
    moved = len(whole) - FOOTER_SIZE + 9
    begin = int.from_bytes(whole[moved : moved + 8], 'little') - 9 - length
    whole[moved : moved + 8] = begin.to_bytes(8, 'little')
    whole[moved + 8 : moved + 16] = bytes(8)
    whole[-12:-8] = bytes(4)
    file.write_bytes(whole)
    (problem,) = inspect(file).problems
    assert problem.kind == 'damaged_file'
    assert 'messages are in it' in problem.text


def test_what_no_other_command_can_read_is_not_sound(small, tmp_path) -> None:
    """A recording without checksums, sound as a file, whose message contradicts its type."""
    file = write_rosbags(tmp_path / 'other', read_record(small))
    with closing(sqlite3.connect(file)) as base:
        base.execute('UPDATE messages SET data = substr(data, 1, 20) WHERE id = 9')
        base.commit()
    record = read_record(file)
    assert len(record['lateral']) == len(read_record(small)['lateral']) - 1
    assert 'topic /rig/lateral: 1 messages cannot be read' in record.notes['problems']
    assert [kind for kind, _ in kinds(file)] == ['damaged_message']


@pytest.mark.parametrize('off_s', [(0.2, 0.0), (0.0, -0.2), (-3e4, 0.0)], ids=str)
def test_times_in_the_head_of_a_chunk_change_no_time_of_a_message(tmp_path, off_s) -> None:
    record = make_record(seconds=2.0)
    file = write_mcap(tmp_path / 'run.mcap', record, chunk_size=1 << 20)
    raw = bytearray(file.read_bytes())
    with closing(McapFile(file)) as opened:
        place = opened.chunks[0].offset + RECORD.size
    times = struct.unpack_from('<QQ', raw, place)
    moved = [at + round(1e9 * off) for at, off in zip(times, off_s, strict=True)]
    struct.pack_into('<QQ', raw, place, *moved)
    file.write_bytes(raw)
    found = inspect(file)
    assert (found.problems, found.duration_s) == ([], pytest.approx(record.duration_s))
    assert found.start_ns == record.start_ns


def test_a_channel_without_a_number_is_not_sound(tmp_path) -> None:
    record = make_record(seconds=1.0)
    lateral = Series(record['lateral'].stamps_ns, np.full(len(record['lateral']), np.nan))
    write_record(tmp_path / 'run', Record({**record, 'lateral': lateral}))
    (problem,) = inspect(tmp_path / 'run').problems
    count = len(lateral)
    told = f'channel lateral: none of {count} readings is a number'
    assert (problem.kind, problem.text) == ('damaged_message', told)


def test_a_chunk_shorter_than_a_message_is_told_in_words_of_a_recording(small, tmp_path) -> None:
    (file,) = small.glob('*.mcap')
    with closing(McapFile(file)) as opened:
        key, *_ = opened.channels
        described = bytes(opened.view[: opened.chunks[0].offset])
    body = struct.pack('<QQQIIQ', 1, 1, 3, 0, 0, 3) + b'abc'
    index = struct.pack('<HIQQ', key, 16, 1, 0)
    records = RECORD.pack(6, len(body)) + body + RECORD.pack(7, len(index)) + index
    short = tmp_path / 'a.mcap'
    short.write_bytes(described + records + RECORD.pack(15, 4) + bytes(4))
    told = [problem.text for problem in inspect(short).problems]
    assert told[-1].endswith('1 messages that are not those of their index are left out')
    assert len(told) == 2, 'the end of the file is missing'
