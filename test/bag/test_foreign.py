"""Recordings as others make, merge and break them: nothing is read or copied wrong in silence."""

from __future__ import annotations

import os
import sqlite3
import struct
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
import yaml
import zstandard
from bags_made import BEGIN_NS, Peer, assert_same, write_rosbags
from mcap.reader import make_reader
from mcap.writer import CompressionType
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_typestore

from hunt_ros.bag import Bag, read_columns, read_record, write_record
from hunt_ros.bag.bag_writer import quality_of_service
from hunt_ros.bag.inspection import inspect
from hunt_ros.bag.interchange.exporters import export_file
from hunt_ros.bag.messages import read_raw
from hunt_ros.bag.record_writer import serialise
from hunt_ros.bag.repair import repair
from hunt_ros.cli.main import main
from hunt_ros.errors import BagError
from hunt_ros.samples import Record, Series
from hunt_ros.sensors import CHANNEL_FIELDS

JOINT_STATE = CHANNEL_FIELDS['lateral'][0]
STORE = get_typestore(Stores.ROS2_JAZZY)
CDR = b'\x00\x01\x00\x00'


def problems(path: Path) -> list[str]:
    """What is wrong but the size of the values, which count the messages here."""
    found = inspect(path).problems
    return [f'{one.kind}: {one.text}' for one in found if one.kind != 'wrong_unit']


def counted(count: int) -> Record:
    """Two channels whose values are their numbers."""
    stamps = BEGIN_NS + np.arange(count) * 10_000_000
    series = Series(stamps, np.arange(float(count)))
    return Record({'lateral': series, 'speed': series})


def joint_states(count: int, name: str = 'lateral', first: float = 0.0) -> list[bytes]:
    stamps = BEGIN_NS + np.arange(count) * 10_000_000
    rows = serialise(name, Series(stamps, first + np.arange(float(count))))
    return [bytes(row) for row in rows]


def recorded(
    path: Path, lateral: int | list[bytes], speed: bool = False, **options: object
) -> Path:
    """Return a file of another recorder: these messages of `lateral`, or so many, and `speed`."""
    messages = joint_states(lateral) if isinstance(lateral, int) else lateral
    with Peer(path, **options) as peer:
        peer.add(peer.channel('/rig/lateral'), messages)
        if speed:
            moving = joint_states(len(messages), 'speed')
            peer.add(peer.channel('/rig/speed', CHANNEL_FIELDS['speed'][0]), moving)
    return path


def renamed(messages: list[bytes], name: str) -> list[bytes]:
    """JointStates of another joint."""
    found = []
    for raw in messages:
        message = STORE.deserialize_cdr(raw, JOINT_STATE)
        message.name = [name]
        found.append(bytes(STORE.serialize_cdr(message, JOINT_STATE)))
    return found


@pytest.fixture
def merged(tmp_path: Path) -> Path:
    """Two days in one file: a type that grew in between, other encodings, an attachment."""
    path = tmp_path / 'two.mcap'
    with Peer(path, chunk_size=3000) as peer:
        latched = quality_of_service(True)  # as version 8 of the metadata has it, and version 9
        newer = latched.replace('durability: 1', 'durability: transient_local')
        kind, text = 'my_msgs/msg/Pos', 'float64 x\nfloat64 y\n'
        old = peer.channel('/old', kind, text, offered_qos_profiles=latched)
        new = peer.channel('/new', kind, f'int64 id\n{text}', offered_qos_profiles=newer)
        proto = peer.writer.register_schema('lab.Point', 'protobuf', bytes(range(128, 256)))
        odd = peer.writer.register_channel('/proto', 'protobuf', proto)
        bare = peer.writer.register_channel('/json', 'json', 0)
        peer.add(old, [CDR + struct.pack('<dd', row, 2.0) for row in range(200)])
        peer.add(new, [CDR + struct.pack('<qdd', 7, row, 3.0) for row in range(200)])
        peer.add(odd, [b'\x01\x02'] * 10)
        peer.add(bare, [b'{}'] * 10)
        peer.writer.add_attachment(BEGIN_NS, BEGIN_NS, 'photo.png', 'image/png', b'picture')
    return path


def content(path: Path) -> tuple[set, set, set]:
    """Messages, descriptions and attachments as the library of the format sees them."""
    with path.open('rb') as file:
        reader = make_reader(file, validate_crcs=True)
        rows = {
            (channel.topic, message.log_time, message.publish_time, message.sequence, message.data)
            for _, channel, message in reader.iter_messages()
        }
        summary = reader.get_summary()
        described = {
            (
                channel.topic, channel.message_encoding, tuple(channel.metadata.items()),
                *((s.name, s.encoding, s.data) if (s := summary.schemas.get(channel.schema_id))
                  else ()),
            )
            for channel in summary.channels.values()
        }  # fmt: skip
        attached = {(part.name, part.data) for part in reader.iter_attachments()}
        assert summary.statistics.message_count == len(rows)
    return rows, described, attached


@pytest.mark.parametrize('cut', [0, 2500])
def test_a_repaired_copy_holds_the_same_messages_types_and_attachments(merged, tmp_path, cut):
    """Types of one name, publish times, sequence numbers, bytes of schemas: all as they were."""
    whole = content(merged)
    damaged = tmp_path / 'damaged.mcap'
    damaged.write_bytes(merged.read_bytes()[: -cut or None])
    report = repair(damaged, tmp_path / 'fixed')
    found = content(next((tmp_path / 'fixed').glob('*.mcap')))
    assert found[0] <= whole[0]
    assert found[1] <= whole[1]
    if not cut:
        assert found == whole
        assert report.lost_bytes == 0
    values = read_columns(tmp_path / 'fixed', {'a': '/old.x', 'b': '/new.x'})
    for name in 'ab':
        np.testing.assert_array_equal(values[name].values, np.arange(len(values[name])))
    assert len(values['a']) > 50
    info = yaml.safe_load((tmp_path / 'fixed' / 'metadata.yaml').read_text())
    topics = {
        entry['topic_metadata']['name']: entry['topic_metadata']
        for entry in info['rosbag2_bagfile_information']['topics_with_message_count']
    }
    assert topics['/old']['serialization_format'] == 'cdr'
    for name in topics.keys() & {'/old', '/new'}:
        (offered,) = yaml.safe_load(topics[name]['offered_qos_profiles'])
        assert offered['durability'] == 1, 'latched, as it was'
    if not cut:
        assert topics['/proto']['serialization_format'] == 'protobuf'


@pytest.mark.parametrize('share', [0.3, 0.9])
def test_a_disk_that_refuses_ends_the_repair(tmp_path, monkeypatch, capsys, share) -> None:
    """What could not be written is not what could not be read: the original stays needed."""
    from hunt_ros.bag.mcap import writer as module

    folder = tmp_path / 'run'
    folder.mkdir()
    for number in range(3):
        recorded(folder / f'run_{number}.mcap', 500)
    room = int(share * sum(file.stat().st_size for file in folder.iterdir()))
    write = module._write
    left = [room]

    def refuse(file, raw, end):
        left[0] -= len(raw)
        if left[0] < 0:
            raise OSError(28, 'No space left on device')
        write(file, raw, end)

    monkeypatch.setattr(module, '_write', refuse)
    assert main(['info', str(folder), '--repair', str(tmp_path / 'saved')]) == 2
    assert 'No space left' in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ['run']


def test_a_repair_that_leaves_a_file_out_says_so_with_its_exit_code(tmp_path) -> None:
    folder = tmp_path / 'run'
    folder.mkdir()
    recorded(folder / 'run_0.mcap', 50)
    (folder / 'run_1.mcap').write_bytes(b'no recording at all')
    assert main(['info', str(folder), '--repair', str(tmp_path / 'saved')]) == 1


@pytest.mark.parametrize('plugin', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_messages_compressed_one_by_one_need_no_description(tmp_path, plugin) -> None:
    """A recorder that was killed leaves them without its metadata.yaml."""
    path = tmp_path / 'peer'
    file = write_rosbags(path, counted(30), 8, plugin, CompressionMode.MESSAGE)
    (path / 'metadata.yaml').unlink()
    found = read_record(file)
    np.testing.assert_array_equal(found['lateral'].values, np.arange(30.0))
    assert problems(file) == []
    if plugin == StoragePlugin.SQLITE3:
        return
    assert repair(path, tmp_path / 'saved').messages == 60
    with AnyReader([tmp_path / 'saved']) as reader:
        found_there = [reader.deserialize(raw, kind.msgtype) for kind, _, raw in reader.messages()]
    assert len(found_there) == 60
    np.testing.assert_array_equal(
        read_record(tmp_path / 'saved')['speed'].values, found['speed'].values
    )


@pytest.mark.parametrize('plugin', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_damaged_message_that_was_compressed_alone_is_told_and_no_other(tmp_path, plugin):
    file = write_rosbags(tmp_path / 'peer', counted(30), 8, plugin, CompressionMode.MESSAGE)
    frames = file.read_bytes().split(b'\x28\xb5\x2f\xfd')
    frames[10] = frames[10][:6] + bytes(20) + frames[10][26:]
    file.write_bytes(b'\x28\xb5\x2f\xfd'.join(frames))
    found = inspect(file)
    assert sum(topic.messages for topic in found.topics) == 59
    (text,) = [one.text for one in found.problems if one.kind == 'damaged_chunk']
    assert 'a message at' in text
    assert 'zstd' in text
    with pytest.raises(BagError, match='a message at'):
        read_columns(file, ['a=/rig/lateral', 'b=/rig/speed'])


def test_a_database_in_a_folder_that_nobody_may_write_to_is_read(tmp_path, monkeypatch) -> None:
    """SQLite makes files beside one that has ever had a write-ahead log, if only to read it."""
    file = write_rosbags(tmp_path / 'peer', counted(30))
    base = sqlite3.connect(file)
    base.execute('PRAGMA journal_mode=WAL')
    base.close()
    before = sorted(tmp_path.rglob('*'))
    monkeypatch.setattr('os.access', lambda path, mode: mode != os.W_OK)
    with Bag(tmp_path / 'peer') as bag:
        assert bag.topics['/rig/lateral'].messages == 30
        assert sorted(tmp_path.rglob('*')) == before
    Path(f'{file}-wal').write_bytes(b'what is in it cannot be read here')
    file.write_bytes(file.read_bytes()[:6000])
    with pytest.raises(BagError, match='-wal file in a folder that may be written: copy both'):
        Bag(file)


def test_a_file_that_was_expanded_beside_itself_is_read_once(tmp_path) -> None:
    record = counted(50)
    mode = CompressionMode.FILE
    file = write_rosbags(tmp_path / 'peer', record, 8, StoragePlugin.SQLITE3, mode)
    with open(file, 'rb') as packed, open(file.with_suffix(''), 'wb') as out:
        zstandard.ZstdDecompressor().copy_stream(packed, out)
    assert_same(read_record(tmp_path / 'peer'), record)


def test_a_file_that_was_compressed_whole_and_cut_is_named_itself(tmp_path) -> None:
    file = write_rosbags(
        tmp_path / 'peer', counted(2000), 8, StoragePlugin.SQLITE3, CompressionMode.FILE
    )
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(BagError, match=f'^{file}: not a sound SQLite recording'):
        read_record(file)


def test_a_topic_of_two_publishers_has_no_jump_of_the_clock(tmp_path) -> None:
    with Peer(tmp_path / 'a.mcap') as peer:
        both = [peer.channel('/rig/lateral', publisher=str(number)) for number in range(2)]
        speed = peer.channel('/rig/speed', CHANNEL_FIELDS['speed'][0])
        rows = zip(joint_states(300), joint_states(300, 'speed'), strict=True)
        for row, (lateral, moving) in enumerate(rows):
            at = BEGIN_NS + row * 10_000_000
            peer.writer.add_message(both[row % 2], at, lateral, at)
            peer.writer.add_message(speed, at, moving, at)
    assert problems(tmp_path / 'a.mcap') == []
    np.testing.assert_array_equal(
        read_record(tmp_path / 'a.mcap')['lateral'].values, np.arange(300.0)
    )


def without_channels(path: Path, topic: bytes) -> None:
    """Take the description of a topic out of an unchunked file, which then has no summary."""
    data, out, position = path.read_bytes(), bytearray(b'\x89MCAP0\r\n'), 8
    while data[position] != 0x0F:
        (length,) = struct.unpack_from('<Q', data, position + 1)
        record = data[position : position + 9 + length]
        if not (record[0] == 4 and topic in record):
            out += record
        position += 9 + length
    out += struct.pack('<BQI', 0x0F, 4, 0) + struct.pack('<BQQQI', 2, 20, 0, 0, 0)
    path.write_bytes(out + b'\x89MCAP0\r\n')


def test_messages_that_nothing_describes_are_missed(tmp_path) -> None:
    file = recorded(tmp_path / 'a.mcap', 50, speed=True, use_chunking=False)
    without_channels(file, b'/rig/speed')
    assert any('50 messages' in text and 'described nowhere' in text for text in problems(file))
    without_channels(file, b'/rig/lateral')
    assert any('100 messages' in text for text in problems(file))


@pytest.mark.parametrize('damaged', [(0, 8), (0, 300), (60, 200)])
def test_a_damaged_beginning_costs_its_messages_and_no_topic(tmp_path, damaged) -> None:
    # It describes a topic in its first chunk alone.
    file = recorded(tmp_path / 'a.mcap', 500, chunk_size=2000)
    raw = bytearray(file.read_bytes())
    first, last = damaged
    raw[first:last] = bytes(last - first)
    file.write_bytes(raw)
    assert problems(file)
    there = read_record(file)['lateral'].values
    assert there.size > 450
    assert there[-1] == 499.0
    repair(file, tmp_path / 'saved')
    np.testing.assert_array_equal(read_record(tmp_path / 'saved')['lateral'].values, there)
    assert 'damaged' not in ' '.join(problems(tmp_path / 'saved'))


def change(file: Path, *orders: str) -> None:
    with sqlite3.connect(file) as base:
        for order in orders:
            base.execute(order)
    base.close()


def test_messages_of_an_sqlite_topic_that_is_gone_are_missed(tmp_path) -> None:
    file = write_rosbags(tmp_path / 'peer', counted(50))
    change(file, "DELETE FROM topics WHERE name = '/rig/speed'")
    assert any('50 messages' in text and 'described nowhere' in text for text in problems(file))


@pytest.mark.parametrize('claimed', [5, 4000])
def test_a_count_that_differs_from_the_description_is_told(tmp_path, claimed) -> None:
    file = write_rosbags(tmp_path / 'peer', counted(50))
    about = file.parent / 'metadata.yaml'
    about.write_text(about.read_text().replace('message_count: 100', f'message_count: {claimed}'))
    (problem,) = problems(file.parent)
    assert '100 messages' in problem
    assert str(claimed) in problem


@pytest.mark.parametrize('field', ['', '.position[lateral]'])
def test_joints_of_several_publishers_on_one_topic_are_told_apart(tmp_path, field) -> None:
    with Peer(tmp_path / 'a.mcap') as peer:
        key = peer.channel('/joint_states')
        lateral, yaw = joint_states(60), renamed(joint_states(60, first=1000.0), 'yaw')
        mixed = [part for pair in zip(lateral, yaw, strict=True) for part in pair]
        peer.add(key, mixed, step_ns=5_000_000)
    found = read_columns(tmp_path / 'a.mcap', {'lateral': f'/joint_states{field}'})['lateral']
    np.testing.assert_array_equal(found.values, np.arange(60.0))
    with pytest.raises(BagError, match=r"no joint 'roll', .*yaw"):
        read_columns(tmp_path / 'a.mcap', {'x': '/joint_states.position[roll]'})


@pytest.mark.parametrize('field', ['', '.position[lateral]'])
def test_messages_of_velocities_alone_are_passed_over_and_told(tmp_path, field) -> None:
    still = STORE.deserialize_cdr(joint_states(1)[0], JOINT_STATE)
    still.velocity, still.position = still.position, still.velocity
    speeds = [bytes(STORE.serialize_cdr(still, JOINT_STATE))] * 60
    with Peer(tmp_path / 'a.mcap') as peer:
        both = [part for pair in zip(joint_states(60), speeds, strict=True) for part in pair]
        peer.add(peer.channel('/mixed'), both)
        peer.add(peer.channel('/speeds'), speeds)
    told = read_record(tmp_path / 'a.mcap', {'lateral': f'/mixed{field}'})
    np.testing.assert_array_equal(told['lateral'].values, np.arange(60.0))
    assert 'topic /mixed: 60 messages hold no position' in told.notes['problems']
    with pytest.raises(BagError, match="/speeds: its messages hold no position of 'lateral'"):
        read_columns(tmp_path / 'a.mcap', {'lateral': f'/speeds{field}'})


def test_messages_without_the_position_of_a_channel_are_no_sound_recording(tmp_path) -> None:
    empty = STORE.deserialize_cdr(joint_states(1)[0], JOINT_STATE)
    empty.position = np.zeros(0)
    messages = joint_states(60)
    messages[7] = messages[9] = bytes(STORE.serialize_cdr(empty, JOINT_STATE))
    file = recorded(tmp_path / 'a.mcap', messages, speed=True)
    (told,) = problems(file)
    assert told.startswith('damaged_message: topic /rig/lateral: 2 messages hold no position')


@pytest.mark.parametrize('options', [{}, {'use_chunking': False}], ids=['chunks', 'none'])
def test_one_message_with_an_impossible_time_closes_no_channel(tmp_path, options) -> None:
    bare = {'compression': CompressionType.NONE, 'enable_crcs': False}
    file = recorded(tmp_path / 'a.mcap', 90, speed=True, **bare, **options)
    data = bytearray(file.read_bytes())
    stamp = struct.pack('<QQ', BEGIN_NS + 420_000_000, BEGIN_NS + 420_000_017)
    at = data.index(stamp)
    data[at : at + 8] = ((1 << 63) + 5).to_bytes(8, 'little')
    file.write_bytes(data)
    values = read_record(file)['lateral'].values
    if options:  # by its header nothing is lost
        np.testing.assert_array_equal(values, np.arange(90.0))
        assert any('impossible time' in text for text in problems(file))
    else:
        np.testing.assert_array_equal(values, np.delete(np.arange(90.0), 42))
        assert any('not those of their index' in text for text in problems(file))


def test_a_chunk_that_claims_two_gigabytes_is_damaged_once(tmp_path) -> None:
    file = recorded(tmp_path / 'a.mcap', 900, speed=True, chunk_size=20_000)
    with Bag(file) as bag:
        chunks = [chunk.offset for chunk in bag.files[0].chunks]
    data = bytearray(file.read_bytes())
    struct.pack_into('<Q', data, chunks[1] + 1, 1 << 31)
    file.write_bytes(data)
    with Bag(file) as bag:
        (told,) = (one.text for one in bag.problems if 'bytes' in one.text)
    assert f'bytes {chunks[1]} to {chunks[2]}: ' in told


def test_a_chunk_without_messages_does_not_begin_the_recording_in_1970(tmp_path) -> None:
    file = recorded(tmp_path / 'a.mcap', 50, compression=CompressionType.NONE)
    data = file.read_bytes()
    head = struct.unpack_from('<Q', data, 9)[0] + 17
    text = b'float64 x\n'
    schema = struct.pack('<HI', 9, 1) + b'a' + struct.pack('<I', 0) + struct.pack('<I', len(text))
    inner = struct.pack('<BQ', 3, len(schema + text)) + schema + text
    body = struct.pack('<QQQIIQ', 0, 0, len(inner), zlib.crc32(inner), 0, len(inner)) + inner
    chunk = struct.pack('<BQ', 6, len(body)) + body
    file.write_bytes(data[:head] + chunk + data[head:])
    with Bag(file) as bag:
        assert bag.span_ns == (BEGIN_NS, BEGIN_NS + 490_000_000)


def test_files_named_in_a_folder_below_are_found(tmp_path) -> None:
    folder = write_record(tmp_path / 'run', read_record(recorded(tmp_path / 'a.mcap', 50)))
    (folder / 'data').mkdir()
    (folder / 'run_0.mcap').rename(folder / 'data' / 'run_0.mcap')
    about = folder / 'metadata.yaml'
    about.write_text(about.read_text().replace('run_0.mcap', 'data/run_0.mcap'))
    assert len(read_record(folder)['lateral']) == 50


def empty_headers(messages: list[bytes], rows: list[int], stamp: bytes = bytes(8)) -> list[bytes]:
    return [
        message[:4] + stamp + message[12:] if row in rows else message
        for row, message in enumerate(messages)
    ]


def test_an_empty_stamp_is_the_log_time_of_its_message(tmp_path) -> None:
    """A sensor that publishes before its clock is there."""
    lateral = empty_headers(joint_states(90), [0, 1, 2])
    found = read_record(recorded(tmp_path / 'a.mcap', lateral, speed=True))
    expected = BEGIN_NS + np.arange(90) * 10_000_000
    np.testing.assert_array_equal(found['lateral'].stamps_ns, expected)
    assert found.duration_s == pytest.approx(0.89)


def test_a_record_far_longer_than_it_was_recorded_is_refused(tmp_path) -> None:
    lateral = empty_headers(joint_states(90), [40, 41], struct.pack('<iI', 7, 0))
    recorded(tmp_path / 'a.mcap', lateral, speed=True)
    for channels in ({}, {'speed': 6.0}):
        with pytest.raises(BagError, match='lateral: a stamp of 7'):
            read_record(tmp_path / 'a.mcap', channels)
    assert any('lateral: a stamp of 7' in text for text in problems(tmp_path / 'a.mcap'))


@pytest.mark.parametrize('stamp', [(7, 0), (2**31 - 1, 0), (-5, 0)], ids=str)
def test_a_damaged_stamp_costs_its_message_alone(tmp_path, stamp: tuple[int, int]) -> None:
    lateral = empty_headers(joint_states(90), [40], struct.pack('<iI', *stamp))
    record = read_record(recorded(tmp_path / 'a.mcap', lateral, speed=True), {'yaw': 0.1})
    np.testing.assert_array_equal(record['lateral'].values, np.delete(np.arange(90.0), 40))
    assert record.duration_s == pytest.approx(0.89)
    told = 'topic /rig/lateral: 1 messages are of an impossible time, and are passed over'
    assert record.notes['problems'] == told
    assert problems(tmp_path / 'a.mcap') == [f'damaged_message: {told}']


@pytest.mark.parametrize(
    ('stored', 'at'),
    [
        *(('sqlite', at) for at in (-5, 0, 2**63 - 1)),
        *(('mcap', at) for at in (0, 2**63 - 1, 2**63 + 5)),
    ],
)
def test_a_damaged_log_time_does_not_make_the_recording_longer(tmp_path, stored, at) -> None:
    record = counted(50)
    if stored == 'sqlite':
        file = write_rosbags(tmp_path / 'a', record)
        change(file, f'UPDATE messages SET timestamp = {at} WHERE id = 20')
    else:
        file = tmp_path / 'a.mcap'
        with Peer(file) as peer:
            for name, series in record.items():
                key = peer.channel(f'/rig/{name}', CHANNEL_FIELDS[name][0])
                for row, raw in enumerate(serialise(name, series)):
                    log = at if (name, row) == ('speed', 20) else int(series.stamps_ns[row])
                    peer.writer.add_message(key, log, bytes(raw), 0)
    assert_same(read_record(file), record)  # by their headers nothing is lost
    with Bag(file) as bag:
        assert bag.span_ns == (record.start_ns, record.end_ns)
    found = inspect(file)
    assert found.duration_s == pytest.approx(record.duration_s)
    assert len(problems(file)) == 1, 'the message alone'
    assert export_file(file, tmp_path / 'a.csv', to_s=0.1) == 10
    if stored == 'mcap':
        assert repair(file, tmp_path / 'saved').messages == 2 * 50 - 1
        assert problems(tmp_path / 'saved') == []


def test_damage_beside_an_impossible_time_costs_no_more_than_itself(tmp_path) -> None:
    file = tmp_path / 'a.mcap'
    with Peer(file, chunk_size=2000) as peer:
        key = peer.channel('/rig/lateral')
        for row, raw in enumerate(joint_states(200)):
            log = 5 if row == 150 else BEGIN_NS + row * 10_000_000
            peer.writer.add_message(key, log, raw, 0)
    with Bag(file) as bag:
        chunk = bag.files[0].chunks[1]
        (_, count) = bag.files[0].indexes[chunk.offset][key]
    data = bytearray(file.read_bytes())
    data[chunk.data + chunk.stored // 2] ^= 0x10
    file.write_bytes(data)
    assert repair(file, tmp_path / 'saved').messages == 200 - 1 - count


def _of_two_clocks(path: Path, stamps: np.ndarray, others: np.ndarray, log: np.ndarray) -> Path:
    with Peer(path) as peer:
        for name in ('lateral', 'yaw', 'roller', 'speed'):
            own = stamps if name == 'lateral' else others
            key = peer.channel(f'/rig/{name}', CHANNEL_FIELDS[name][0])
            rows = serialise(name, Series(own, 0.01 * np.sin(0.2 * np.arange(own.size))))
            for at, raw in zip(log.tolist(), rows, strict=True):
                peer.writer.add_message(key, at, bytes(raw), at)
    return path


@pytest.mark.parametrize(
    ('ahead_s', 'faster', 'told'),
    [
        (3600.0, 0.0, 'lateral is off by 3600.000 s at the beginning and 3600.000 s at the end'),
        (0.0, 0.01, 'lateral is off by 0.010 s at the beginning and 0.190 s at the end'),
        (0.2, 1e-4, ''),
    ],
)
def test_two_clocks_in_one_recording_are_told_in_one_line(
    tmp_path, capsys, ahead_s: float, faster: float, told: str
) -> None:
    """An offset of the delay on the way, and a drift within the noise of it, are none."""
    log = BEGIN_NS + np.arange(2000) * 10_000_000
    stamps = log + np.round(1e9 * ahead_s + faster * (log - BEGIN_NS)).astype(np.int64)
    file = _of_two_clocks(tmp_path / 'a.mcap', stamps, log, log)
    said = f'not all channels are stamped by one clock: {told}'
    assert read_record(file).notes.get('problems', '') == (said if told else '')
    for verb in ('check', 'replay', 'info'):
        main([verb, str(file)])
        assert capsys.readouterr().out.count(said) == bool(told)
    if ahead_s > 1.0:
        assert main(['identify', str(file)]) == 2
        assert capsys.readouterr().err.count(said) == 1


def test_a_replay_at_another_pace_is_no_second_clock(tmp_path) -> None:
    """What it publishes late by 30 ms is late by 0.6 s of its own time."""
    log = BEGIN_NS + np.arange(2000) * 500_000
    own = BEGIN_NS + np.arange(2000) * 10_000_000
    late = own - np.where(np.arange(2000) > 1000, 600_000_000, 0)
    late = np.maximum.accumulate(late)
    file = _of_two_clocks(tmp_path / 'a.mcap', late, own, log)
    assert 'problems' not in read_record(file).notes


@pytest.mark.parametrize('steps', ['log', 'header', 'both'])
def test_a_clock_that_is_set_back_changes_no_order_and_is_told(tmp_path, steps, capsys) -> None:
    """What was measured first stays first, whatever clock was set by an hour."""
    set_back = BEGIN_NS + np.arange(400) * 10_000_000
    set_back[200:] -= 3600 * 10**9
    steady = BEGIN_NS + np.arange(400) * 10_000_000
    stamps = steady if steps == 'log' else set_back
    log = steady if steps == 'header' else set_back
    values = 0.01 * np.sin(0.2 * np.arange(400.0))
    with Peer(tmp_path / 'a.mcap', chunk_size=5000) as peer:
        for name in ('lateral', 'speed'):
            key = peer.channel(f'/rig/{name}', CHANNEL_FIELDS[name][0])
            rows = serialise(name, Series(stamps, values))
            for at, raw in zip(log.tolist(), rows, strict=True):
                peer.writer.add_message(key, at, bytes(raw), at)
    record = read_record(tmp_path / 'a.mcap')
    np.testing.assert_array_equal(record['lateral'].values, values)
    told = (  # by identify, plan and report too
        'a clock was set back by 3599.990 s: 400 samples of lateral, speed are stamped before'
        ' earlier ones, and kept'
    )
    assert (record.notes.get('problems') == told) == (steps != 'log')
    for verb, out in (('export', 'a.csv'), ('import', 'again')):
        assert main([verb, str(tmp_path / 'a.mcap'), str(tmp_path / out)]) == 0
        assert (told in ''.join(capsys.readouterr())) == (steps != 'log')
    assert_same(read_record(tmp_path / 'again'), record)
    found = [one for one in inspect(tmp_path / 'a.mcap').problems if one.kind == 'clock_jump']
    jumps = [one for one in found if one.time_s is not None]
    assert [one.text for one in found if one not in jumps] == ([told] if steps != 'log' else [])
    assert [one.text.partition(':')[0] for one in jumps] == ['/rig/lateral', '/rig/speed']
    assert jumps[0].time_s == pytest.approx(3599.99)
    if steps != 'log':
        assert main(['check', str(tmp_path / 'a.mcap')]) == 1
        said = capsys.readouterr().out
        assert 'the clock jumps back by 3599.990 s' in said
        assert 'e+0' not in said, 'plain numbers'
        assert 'repair' not in said, 'it mends no clock'


@pytest.mark.parametrize('mode', [None, CompressionMode.MESSAGE], ids=['plain', 'packed'])
def test_a_database_keeps_the_order_of_a_clock_that_is_set_back(tmp_path, mode) -> None:
    stamps = BEGIN_NS + np.arange(400) * 10_000_000
    stamps[200:] -= 3600 * 10**9
    series = Series(stamps, np.arange(400.0))
    write_rosbags(tmp_path / 'a', Record({'lateral': series, 'speed': series}), mode=mode)
    found = read_record(tmp_path / 'a')
    np.testing.assert_array_equal(found['lateral'].values, np.arange(400.0))
    np.testing.assert_array_equal(found['speed'].stamps_ns, stamps)
    raw = list(read_raw(tmp_path / 'a', ['lateral']))
    assert [message.log_ns for message in raw] == stamps.tolist()


def test_messages_of_two_publishers_stay_as_they_were_written(tmp_path) -> None:
    """Each has a channel of its own; nothing but their places tells the order of equal times."""
    messages = joint_states(200)
    with Peer(tmp_path / 'a.mcap') as peer:
        keys = [peer.channel('/rig/lateral', publisher=str(number)) for number in range(2)]
        for row, raw in enumerate(messages):
            peer.writer.add_message(keys[row % 2], BEGIN_NS, raw, BEGIN_NS)
    found = read_record(tmp_path / 'a.mcap')['lateral']
    np.testing.assert_array_equal(found.values, np.arange(200.0))


def test_a_clock_that_stands_still_is_no_recording(tmp_path) -> None:
    still = struct.pack('<iI', BEGIN_NS // 10**9, 5)
    file = recorded(tmp_path / 'a.mcap', empty_headers(joint_states(90), [*range(90)], still))
    with pytest.raises(BagError, match='lateral: 90 samples at 1 different time'):
        read_record(file)
    assert any('its clock stands still' in text for text in problems(file))


def test_the_only_number_of_a_message_needs_no_path(tmp_path) -> None:
    text = 'builtin_interfaces/Time stamp\nfloat32 value\nstring unit\n'
    with Peer(tmp_path / 'a.mcap') as peer:
        key = peer.channel('/rig/lateral', 'my_msgs/msg/Reading', text)
        rows = [struct.pack('<iIfI', 1 + row, 0, row, 3) + b'mm\0' for row in range(60)]
        peer.add(key, [CDR + row for row in rows])
    found = read_record(tmp_path / 'a.mcap')['lateral']
    np.testing.assert_array_equal(found.values, np.arange(60.0))
    np.testing.assert_array_equal(found.stamps_ns, (1 + np.arange(60)) * 10**9)


def test_times_of_a_simulation_are_times(tmp_path) -> None:
    """Stamps that begin at zero and run 50 times as fast as the recorder's clock."""
    stamps = np.arange(1, 3000) * 500_000_000
    rows = serialise('lateral', Series(stamps, np.arange(float(stamps.size))))
    record = read_record(recorded(tmp_path / 'a.mcap', [bytes(row) for row in rows]))
    np.testing.assert_array_equal(record['lateral'].stamps_ns, stamps)
    assert Record(record).duration_s > 1000.0


@pytest.mark.parametrize('damage', ["timestamp = 'then'", "data = 'words'"])
def test_what_was_wrong_with_the_original_is_not_wrong_with_what_was_made_of_it(
    tmp_path, damage: str
) -> None:
    file = write_rosbags(tmp_path / 'peer', counted(50))
    change(file, f'UPDATE messages SET {damage} WHERE id = 7')
    record = read_record(file)
    assert sum(len(series) for series in record.values()) == 99
    assert any('without a time, or of no bytes' in text for text in problems(file))
    assert 'without a time' in record.notes['problems']
    again = write_record(tmp_path / 'again', record)
    assert 'problems' not in read_record(again).notes
    assert 'without a time' in read_record(again).notes['source_problems']
    assert problems(again) == []


def test_one_file_of_a_recording_that_cannot_be_read_costs_its_messages_alone(tmp_path) -> None:
    for number in range(3):
        part = write_rosbags(tmp_path / f'part{number}', counted(20), 8, StoragePlugin.SQLITE3)
        part.rename(tmp_path / f'run-{number}.db3')
    damaged = tmp_path / 'run-1.db3'
    damaged.write_bytes(damaged.read_bytes()[:6000])
    record = read_record(tmp_path)
    assert len(record['lateral']) == 40
    assert 'run-1.db3: not a sound' in record.notes['problems']
    assert any('run-1.db3' in text for text in problems(tmp_path))


def test_a_dangling_link_and_a_pipe_in_a_folder_are_passed_over(tmp_path) -> None:
    recorded(tmp_path / 'run_0.mcap', 50)
    (tmp_path / 'run_1.mcap').symlink_to(tmp_path / 'nowhere.mcap')
    os.mkfifo(tmp_path / 'run_2.mcap')
    assert len(read_record(tmp_path)['lateral']) == 50
    with pytest.raises(BagError, match='not a file'):
        read_record(tmp_path / 'run_2.mcap')


def test_a_file_without_chunks_is_walked_in_little_memory(tmp_path) -> None:
    """An hour at 1 kHz has 8 million messages of them."""
    count = 20_000
    with Peer(tmp_path / 'a.mcap', use_chunking=False) as peer:
        peer.add(peer.channel('/rig/lateral'), joint_states(100) * (count // 100), step_ns=10)
    tracemalloc.start()
    with Bag(tmp_path / 'a.mcap') as bag:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert bag.topics['/rig/lateral'].messages == count
    assert peak < 100 * count
