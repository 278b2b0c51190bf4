"""Damaged recordings: what is sound is saved, and nothing that was not there."""

from __future__ import annotations

import errno
import shutil
import sqlite3
from contextlib import closing, suppress
from pathlib import Path

import numpy as np
import pytest
from bags_made import chunks_of, compressed, make_record, write_mcap, write_messages, write_rosbags
from mcap.writer import CompressionType
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin

from hunt_ros.bag import Bag, BagWriter, read_record, write_record
from hunt_ros.bag.inspection import inspect
from hunt_ros.bag.mcap.file import McapFile, walked_places
from hunt_ros.bag.mcap.records import MESSAGE_PREFIX, expand_chunk
from hunt_ros.bag.messages import read_raw
from hunt_ros.bag.repair import BeingRecorded, finalise, finalise_left, repair
from hunt_ros.errors import BagError
from hunt_ros.samples import Record


def message_set(path: Path) -> set[tuple[str, int, bytes]]:
    with Bag(path) as bag:
        return {(m.topic, m.log_ns, m.data) for m in read_raw(bag, list(bag.topics))}


@pytest.fixture(scope='module', params=['', 'lz4', 'zstd'])
def small(request, tmp_path_factory) -> Path:
    folder, record = tmp_path_factory.mktemp('small'), make_record(seconds=0.05)
    with compressed(request.param), chunks_of(2000):
        return write_messages(folder / 'run', record)


def test_every_prefix_is_read_inspected_and_repaired(small: Path, tmp_path: Path) -> None:
    whole = message_set(small)
    data = (small / 'run_0.mcap').read_bytes()
    file = tmp_path / 'cut.mcap'
    best = 0
    step = max(1, len(data) // 120)
    for length in [*range(0, len(data), step), len(data) - 1]:
        file.write_bytes(data[:length])
        target = tmp_path / f'saved_{length}'
        try:
            report = repair(file, target)
        except BagError:
            # Nothing is saved only where not even one message is whole.
            assert best == 0
            continue
        saved = message_set(target)
        assert saved <= whole
        assert report.messages == len(saved) >= best
        best = len(saved)
        assert message_set(file) == saved  # the copy holds what can be read
        assert {p.kind for p in inspect(target).problems} <= {'missing_channel'}
        kinds = {problem.kind for problem in inspect(file).problems}
        assert 'not_closed' in kinds
        shutil.rmtree(target)
    assert best == len(whole)


def test_a_chunk_that_was_cut_counts_as_lost(small: Path, tmp_path: Path) -> None:
    with Bag(small) as bag:
        last = bag.files[0].chunks[-1]
    file = tmp_path / 'cut.mcap'
    file.write_bytes((small / 'run_0.mcap').read_bytes()[: last.end - 1])
    assert repair(file, tmp_path / 'saved').lost_bytes == last.end - 1 - last.offset


def test_a_chunk_with_a_wrong_crc_is_named_and_left_out(small: Path, tmp_path: Path) -> None:
    with Bag(small) as bag:
        chunks = bag.files[0].chunks
    data = bytearray((small / 'run_0.mcap').read_bytes())
    bad = chunks[len(chunks) // 2]
    data[bad.data + bad.stored // 2] ^= 0x10
    file = tmp_path / 'bad.mcap'
    file.write_bytes(data)
    with pytest.raises(BagError, match=rf'chunk at byte {bad.offset}'):
        read_record(file)
    found = inspect(file)
    assert [problem.kind for problem in found.problems] == ['damaged_chunk']
    report = repair(file, tmp_path / 'saved')
    assert message_set(tmp_path / 'saved') < message_set(small)
    assert report.lost_spans_ns == [(bad.first_ns, bad.last_ns)]
    assert report.lost_bytes >= bad.stored
    assert found.messages == report.messages
    with AnyReader([tmp_path / 'saved']) as reader:
        assert sum(1 for _ in reader.messages()) == report.messages


def test_zeros_in_a_frame_without_a_crc_are_never_read_as_numbers(tmp_path: Path) -> None:
    """What zstd makes of them is of the right length; nothing but the index knows better."""
    record = make_record(seconds=0.4)
    file, spoilt = write_mcap(tmp_path / 'a.mcap', record, enable_crcs=False), tmp_path / 'b.mcap'
    with closing(McapFile(file)) as opened:
        chunk = opened.chunks[1]
    told = 0
    for at in range(chunk.data + 12, chunk.end - 64, 61):
        data = bytearray(file.read_bytes())
        data[at : at + 64] = bytes(64)
        spoilt.write_bytes(data)
        with pytest.raises(BagError) as error:
            read_record(spoilt)
        told += 'not those of its index' in str(error.value)
        with suppress(BagError):
            saved = repair(spoilt, tmp_path / f'saved{at}').path
            assert message_set(saved) < message_set(file)
    assert told > 3


def test_damage_to_a_length_loses_that_chunk_and_no_other(small: Path, tmp_path: Path) -> None:
    with Bag(small) as bag:
        chunks = bag.files[0].chunks
    data = bytearray((small / 'run_0.mcap').read_bytes())
    bad = chunks[1]
    data[bad.offset + 1 : bad.offset + 9] = (1 << 63).to_bytes(8, 'little')  # 8 EiB
    file = tmp_path / 'bad.mcap'
    file.write_bytes(data)
    repair(file, tmp_path / 'saved')
    saved, whole = message_set(tmp_path / 'saved'), message_set(small)
    assert message_set(file) == saved  # reading goes on behind it as well
    lost = whole - saved
    assert saved < whole
    assert all(bad.first_ns <= log_ns <= bad.last_ns for _, log_ns, _ in lost)


@pytest.mark.parametrize('compression', ['', 'lz4', 'zstd'])
def test_a_chunk_that_claims_8_eib_is_refused(tmp_path: Path, compression) -> None:
    with compressed(compression):
        path = write_messages(tmp_path / 'run', make_record(seconds=0.05))
    (file,) = path.glob('*.mcap')
    with Bag(path) as bag:
        (chunk,) = bag.files[0].chunks
    data = bytearray(file.read_bytes())
    at = chunk.offset + 9 + 16
    data[at : at + 8] = ((1 << 63) - 1).to_bytes(8, 'little')
    file.write_bytes(data)
    with pytest.raises(BagError, match='claims to hold 9223372036854775807 bytes'):
        read_record(path)
    with pytest.raises(BagError, match='nothing to save'):
        repair(path, tmp_path / 'saved')
    assert not (tmp_path / 'saved').exists()


def test_a_missing_index_is_made_good(small: Path, tmp_path: Path) -> None:
    """An index that contradicts its chunk is not believed: the chunk is walked."""
    with Bag(small) as bag:
        layout = bag.files[0]
        places = [place for index in layout.indexes.values() for place in index.values()]
    data = bytearray((small / 'run_0.mcap').read_bytes())
    for offset, count in places:
        data[offset + 8 : offset + 16] = (3).to_bytes(8, 'little')
        assert count
    file = tmp_path / 'bad.mcap'
    file.write_bytes(data)
    assert message_set(file) == message_set(small)
    assert {problem.kind for problem in inspect(file).problems} == {'bad_index'}


def test_a_damaged_sqlite_bag_is_left_to_sqlite(tmp_path: Path) -> None:
    lateral = Record({'lateral': make_record(seconds=2.0)['lateral']})
    file = write_rosbags(tmp_path / 'peer', lateral)
    data = bytearray(file.read_bytes())
    middle = len(data) * 6 // 10 // 4096 * 4096
    data[middle : middle + 4096] = bytes(4096)
    file.write_bytes(data)
    with pytest.raises(BagError, match=r'SQLite.*sqlite3 FILE \.recover'):
        read_record(file)
    with pytest.raises(BagError, match=r'sqlite3 FILE \.recover'):
        repair(tmp_path / 'peer', tmp_path / 'saved')
    assert not (tmp_path / 'saved').exists()


def test_an_sqlite_bag_with_damage_that_nobody_here_reads_is_not_sound(
    tmp_path: Path,
) -> None:
    lateral = Record({'lateral': make_record(seconds=20.0)['lateral']})
    file = write_rosbags(tmp_path / 'peer', lateral)
    base = sqlite3.connect(file)
    query = "SELECT rootpage FROM sqlite_master WHERE name = 'timestamp_idx'"
    ((page,),) = base.execute(query)
    base.close()
    assert not inspect(tmp_path / 'peer').problems[1:]  # it has no speed
    data = bytearray(file.read_bytes())
    data[4096 * (page - 1) : 4096 * page] = bytes(4096)
    file.write_bytes(data)
    np.testing.assert_array_equal(read_record(file)['lateral'].values, lateral['lateral'].values)
    kinds = [problem.kind for problem in inspect(tmp_path / 'peer').problems]
    assert 'damaged_chunk' in kinds


@pytest.mark.parametrize('missing', [20, 500, 4096, 100_000])
def test_an_sqlite_bag_that_was_cut_is_never_read_to_zeros(tmp_path: Path, missing: int) -> None:
    lateral = Record({'lateral': make_record(seconds=20.0)['lateral']})
    file = write_rosbags(tmp_path / 'peer', lateral)
    file.write_bytes(file.read_bytes()[:-missing])
    with pytest.raises(BagError, match=r'SQLite.*sqlite3 FILE \.recover'):
        read_record(file)


def active_copy(small: Path, tmp_path: Path, share: float = 0.9) -> Path:
    """Leave a recording as a recorder does that is killed at a share of it."""
    active = tmp_path / 'run.active'
    active.mkdir()
    data = (small / 'run_0.mcap').read_bytes()
    (active / 'run_0.mcap').write_bytes(data[: int(share * len(data))])
    return active


@pytest.mark.parametrize('share', np.linspace(0.5, 0.999, 4))
def test_what_a_dead_recorder_left_is_read_as_it_is_and_closed(
    small: Path, tmp_path: Path, share: float
) -> None:
    active = active_copy(small, tmp_path, share)
    before = message_set(active)
    assert before
    # Found under its final name, too.
    assert message_set(tmp_path / 'run') == before
    assert 'not closed' in read_record(active).notes['problems']
    (active / 'run_0.mcap.part').touch()  # of one that was killed while it closed
    ((closed, said),) = finalise_left(tmp_path)
    assert closed == tmp_path / 'run'
    assert said == f'{closed}: closed, its recorder had ended without doing so'
    assert not active.exists()
    assert before <= message_set(closed) <= message_set(small)
    assert inspect(closed).problems == []
    assert not list(closed.glob('*.part'))
    assert not list(finalise_left(tmp_path))


def test_a_file_that_was_closed_before_the_kill_is_not_written_again(
    small: Path, tmp_path: Path
) -> None:
    active = active_copy(small, tmp_path)
    first = shutil.copy(small / 'run_0.mcap', active / 'run_1.mcap')
    before = first.stat().st_ino
    assert (finalise(active) / 'run_1.mcap').stat().st_ino == before


def test_what_no_disk_has_room_to_close_stays_as_it_is(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, 'No space left on device')

    active = active_copy(small, tmp_path)
    before = message_set(active)
    monkeypatch.setattr('hunt_ros.bag.mcap.writer._write', full)
    ((closed, line),) = finalise_left(tmp_path)
    assert closed is None
    assert 'No space left on device' in line
    assert [name.name for name in active.iterdir()] == ['run_0.mcap']
    assert message_set(active) == before


def test_a_running_recording_is_left_alone(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'run') as writer:
        key = writer.topic('/a', 'std_msgs/msg/String')
        writer.write(key, 1, b'\x00\x01\x00\x00\x02\x00\x00\x00x\x00')
        writer.flush()
        with pytest.raises(BeingRecorded):
            finalise(tmp_path / 'run.active')
        assert not list(finalise_left(tmp_path))
    assert len(message_set(tmp_path / 'run')) == 1


def test_a_closed_recording_is_not_overwritten_by_what_was_left(
    small: Path, tmp_path: Path
) -> None:
    shutil.copytree(small, tmp_path / 'run')
    before = message_set(tmp_path / 'run')
    active_copy(small, tmp_path)
    assert finalise(tmp_path / 'run.active') == tmp_path / 'run_1'
    assert message_set(tmp_path / 'run') == before


def test_a_folder_without_a_message_is_reported_and_kept(tmp_path: Path) -> None:
    (tmp_path / 'run.active').mkdir()
    (tmp_path / 'run.active' / 'run_0.mcap').touch()
    ((closed, line),) = finalise_left(tmp_path)
    assert closed is None
    assert 'no whole message' in line
    assert (tmp_path / 'run.active').exists()


def test_unchunked_files_and_split_folders_are_repaired(tmp_path: Path) -> None:
    record = make_record(seconds=0.2)
    path = write_record(tmp_path / 'run', record)
    (file,) = path.glob('*.mcap')
    shutil.copy(file, path / 'run_1.mcap')
    (path / 'run_2.mcap').write_bytes(file.read_bytes()[:-3000])
    assert 'run_1.mcap is not named in metadata.yaml' in read_record(path).notes['problems']
    report = repair(path, tmp_path / 'out')
    assert len(list((tmp_path / 'out').glob('*.mcap'))) == 3
    assert report.messages > 2 * sum(map(len, record.values()))


@pytest.mark.parametrize('what', ['a length', 'the head'])
def test_a_message_that_no_command_can_read_is_not_saved(tmp_path: Path, what: str) -> None:
    """Without a CRC damage shows in the message alone; one used to cost the whole copy."""
    record = make_record(seconds=0.2)
    file = write_rosbags(tmp_path / 'run', record, plugin=StoragePlugin.MCAP)
    data = bytearray(file.read_bytes())
    at = data.rindex(b'lateral\0')
    if what == 'a length':
        data[at - 4 : at] = b'\xff\xff\xff\x7f'  # of the joint's name
    else:  # that says it is CDR, in front of stamp, frame and number of names
        assert data[at - 28 : at - 24] == b'\0\1\0\0'
        data[at - 28] = 8
    file.write_bytes(data)
    assert '/rig/lateral: 1 messages cannot be read' in read_record(file).notes['problems']
    report = repair(file, tmp_path / 'out')
    assert report.problems[-1].endswith('1 messages that are not as their type says are left out')
    assert len(read_record(report.path)['lateral']) == len(record['lateral']) - 1
    assert {problem.kind for problem in inspect(report.path).problems} <= {'missing_channel'}


def test_a_message_that_damage_has_swallowed_is_missed(tmp_path: Path) -> None:
    """Where there is no CRC the copy cannot tell what is wrong, but which are not there."""
    file = write_rosbags(tmp_path / 'run', make_record(seconds=0.2), plugin=StoragePlugin.MCAP)
    data = bytearray(file.read_bytes())
    with closing(McapFile(file)) as sound:
        total = sound.counts.total()
        (chunk,) = sound.chunks
        places = walked_places(expand_chunk(sound.view, chunk))
        data[chunk.data + int(places[1].starts[7]) - MESSAGE_PREFIX] = 0
    file.write_bytes(data)
    report = repair(file, tmp_path / 'out')
    assert report.messages == total - 1
    told = '1 messages that are not those of their index are left out'
    assert report.problems[-1].endswith(told)


@pytest.mark.parametrize('what', ['the length', 'the topic', 'the log time', 'the kind'])
def test_damage_to_a_chunk_without_a_crc_costs_its_messages_alone(tmp_path: Path, what) -> None:
    """A length that was damaged cost all messages of the chunk; a time or a topic was kept."""
    file = write_mcap(
        tmp_path / 'a.mcap', make_record(seconds=0.4), enable_crcs=False,
        compression=CompressionType.NONE,
    )  # fmt: skip
    sound, data = message_set(file), bytearray(file.read_bytes())
    place = {'the kind': 0, 'the length': 3, 'the topic': 10, 'the log time': 20}
    with closing(McapFile(file)) as opened:
        chunks = opened.chunks
        for chunk in chunks:
            starts = walked_places(expand_chunk(opened.view, chunk)).popitem()[1].starts
            at = chunk.data + int(starts[3]) - MESSAGE_PREFIX
            data[at + place[what]] ^= 85
    file.write_bytes(data)
    report = repair(file, tmp_path / 'out')
    assert message_set(report.path) < sound
    assert report.messages == len(sound) - len(chunks)
    told = f'{len(chunks)} messages that are not those of their index are left out'
    assert any(told in problem for problem in report.problems)
