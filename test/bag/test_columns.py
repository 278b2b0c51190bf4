"""Columns gathered from bytes equal what rosbags deserialises, for any type and any storage."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import zstandard
from bags_made import Peer, assert_same, chunks_of, make_record, write_mcap, write_rosbags
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from hunt_ros.bag import Bag, BagWriter, ChannelSource, read_columns, read_record, write_record
from hunt_ros.bag.blocks import Topic
from hunt_ros.bag.cdr import gather
from hunt_ros.bag.cdr.layout import locate
from hunt_ros.bag.columns import find_topic
from hunt_ros.bag.inspection import inspect
from hunt_ros.bag.mcap.writer import McapWriter
from hunt_ros.bag.record_writer import serialise
from hunt_ros.errors import BagError
from hunt_ros.samples import Record, Series

STORE = get_typestore(Stores.ROS2_JAZZY)
STORE.register(
    get_types_from_msg(
        'std_msgs/Header header\nstring[] labels\nSample[] samples\nfloat32[3] fixed\n'
        'uint8 flag\nint64[] counts\nfloat64 last\n'
        + '=' * 80
        + '\nMSG: lab_msgs/Sample\nbool ok\nfloat64 value\nstring note\nint16 small\n',
        'lab_msgs/msg/Mixed',
    )
)
TYPES = STORE.types
BEGIN_NS = 1_600_000_000_123_456_789


def header(stamp_ns: int, frame: str = ''):
    seconds, rest = divmod(stamp_ns, 10**9)
    stamp = TYPES['builtin_interfaces/msg/Time'](sec=seconds, nanosec=rest)
    return TYPES['std_msgs/msg/Header'](stamp=stamp, frame_id=frame)


def mixed(rng: np.random.Generator, stamp_ns: int):
    text = lambda: 'x' * int(rng.integers(0, 6))  # noqa: E731
    samples = [
        TYPES['lab_msgs/msg/Sample'](
            ok=bool(rng.integers(2)),
            value=rng.normal(),
            note=text(),
            small=int(rng.integers(-9, 9)),
        )
        for _ in range(rng.integers(2, 4))
    ]
    return TYPES['lab_msgs/msg/Mixed'](
        header=header(stamp_ns, text()),
        labels=[text() for _ in range(rng.integers(0, 3))],
        samples=samples,
        fixed=rng.normal(size=3).astype(np.float32),
        flag=int(rng.integers(256)),
        counts=rng.integers(-(2**50), 2**50, size=rng.integers(0, 3)),
        last=rng.normal(),
    )


FIELDS: dict[str, Callable] = {
    'samples[1].value': lambda m: m.samples[1].value,
    'samples[1].small': lambda m: m.samples[1].small,
    'samples[0].ok': lambda m: m.samples[0].ok,
    'fixed[2]': lambda m: m.fixed[2],
    'flag': lambda m: m.flag,
    'last': lambda m: m.last,
    'header.stamp.nanosec': lambda m: m.header.stamp.nanosec,
}


@given(st.integers(0, 2**32), st.booleans())
@settings(max_examples=25, deadline=None)
def test_any_field_of_messages_of_varying_layout_equals_deserialisation(
    tmp_path_factory: pytest.TempPathFactory, seed: int, little: bool
) -> None:
    rng = np.random.default_rng(seed)
    folder = tmp_path_factory.mktemp('mixed')
    messages = [mixed(rng, BEGIN_NS + 10 * index) for index in range(30)]
    text, _ = STORE.generate_msgdef('lab_msgs/msg/Mixed', ros_version=2)
    path = folder / 'run.mcap'
    with chunks_of(700), closing(McapWriter(path)) as writer:
        writer.add_topic(Topic(1, '/daq', 'lab_msgs/msg/Mixed', 'cdr', 'ros2msg', text))
        for index, message in enumerate(messages):
            raw = STORE.serialize_cdr(message, 'lab_msgs/msg/Mixed', little_endian=little)
            writer.add(1, BEGIN_NS + 10 * index + 3, bytes(raw))
        writer.finish()
    sources = [ChannelSource(name, f'/daq.{name}') for name in FIELDS]
    columns = read_columns(path, sources)
    for name, pick in FIELDS.items():
        np.testing.assert_array_equal(columns[name].values, [float(pick(m)) for m in messages])
        np.testing.assert_array_equal(columns[name].stamps_ns, BEGIN_NS + 10 * np.arange(30))
    logged = read_columns(path, sources[:1], stamps='log')
    np.testing.assert_array_equal(
        next(iter(logged.values())).stamps_ns, BEGIN_NS + 3 + 10 * np.arange(30)
    )


@pytest.mark.parametrize(
    'options',
    [
        {'compression': CompressionType.NONE},
        {'compression': CompressionType.LZ4},
        {'compression': CompressionType.ZSTD},
        {'index_types': IndexType.NONE},
        {'index_types': IndexType.CHUNK},
        {'index_types': IndexType.MESSAGE},
        {'use_chunking': False},
        {'repeat_channels': False, 'repeat_schemas': False},
        {'use_statistics': False},
        {'use_summary_offsets': False},
        {'enable_crcs': False, 'compression': CompressionType.NONE},
        {'use_statistics': False, 'index_types': IndexType.NONE, 'use_summary_offsets': False},
        {'use_statistics': False, 'repeat_channels': False, 'repeat_schemas': False},
        {'use_statistics': False, 'repeat_channels': False, 'index_types': IndexType.MESSAGE},
    ],
    ids=str,
)
def test_every_form_of_mcap_reads_the_same_and_is_sound(tmp_path: Path, options) -> None:
    """MCAP leaves index, statistics and repetitions to the recorder: nothing is damaged."""
    record = make_record(seconds=1.0)
    path = write_mcap(tmp_path / 'peer.mcap', record, **options)
    assert_same(record, read_record(path))
    assert inspect(path).problems == []


@pytest.mark.parametrize('version', [8, 9])
@pytest.mark.parametrize('plugin', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize('mode', [None, CompressionMode.FILE, CompressionMode.MESSAGE])
def test_every_form_of_rosbag2_reads_the_same(tmp_path: Path, version, plugin, mode) -> None:
    record = make_record(seconds=0.5)
    file = write_rosbags(tmp_path / 'peer', record, version, plugin, mode)
    assert_same(record, read_record(file.parent))
    assert_same(record, read_record(file))


def test_what_is_in_the_log_of_a_recorder_that_runs_or_was_killed_is_read(tmp_path: Path) -> None:
    record = make_record(seconds=0.5)
    file = write_rosbags(tmp_path / 'peer', record)
    with closing(sqlite3.connect(file)) as recorder:
        recorder.execute('PRAGMA journal_mode = WAL')  # rosbag2's preset `resilient`
        recorder.execute('PRAGMA wal_autocheckpoint = 0')
        rows = recorder.execute('SELECT * FROM messages').fetchall()
        recorder.execute('DELETE FROM messages')
        recorder.commit()
        recorder.execute('PRAGMA wal_checkpoint(TRUNCATE)')
        recorder.executemany('INSERT INTO messages VALUES (?, ?, ?, ?)', rows)
        recorder.commit()
        assert_same(record, read_record(file.parent))
        shutil.copytree(file.parent, tmp_path / 'killed')
    (tmp_path / 'killed' / f'{file.name}-shm').unlink()
    assert_same(record, read_record(tmp_path / 'killed'))


@pytest.mark.parametrize('version', [4, 5, 6, 7])
def test_older_metadata_reads_the_same(tmp_path: Path, version: int) -> None:
    import yaml

    record = make_record(seconds=0.5)
    path = write_record(tmp_path / 'run', record)
    document = yaml.safe_load((path / 'metadata.yaml').read_text())
    info = document['rosbag2_bagfile_information']
    info['version'] = version
    later = {'files': 5, 'custom_data': 6, 'ros_distro': 8}
    for key, since in later.items():
        if version < since:
            del info[key]
    for topic in info['topics_with_message_count']:
        del topic['topic_metadata']['type_description_hash']
    (path / 'metadata.yaml').write_text(yaml.safe_dump(document))
    assert_same(record, read_record(path))


def test_a_clock_set_ahead_by_years_is_read_and_given_no_constants(tmp_path: Path) -> None:
    """A year at 100 Hz has no room; what was measured has."""
    stamps = np.arange(2000, dtype=np.int64) * 10**7
    stamps[1000:] += 50 * 365 * 86_400 * 10**9
    write_record(
        tmp_path / 'set', Record({'lateral': Series(stamps, np.sin(0.2 * np.arange(2000)))})
    )
    assert len(read_record(tmp_path / 'set')['lateral']) == 2000
    with pytest.raises(BagError, match=r'7.88e\+08 s from the others: its clock was not set'):
        read_record(tmp_path / 'set', ['speed=7'])


def test_scale_offset_and_constants(bag: Path, record) -> None:
    columns = read_columns(bag, ['a=/rig/lateral*1000', 'b=speed/2+1', 'c=16.3'])
    np.testing.assert_array_equal(columns['a'].values, record['lateral'].values * 1000)
    np.testing.assert_array_equal(columns['b'].values, record['speed'].values * 0.5 + 1)
    mapped = read_record(bag, ['speed=16.3', 'yaw=/rig/lateral*0.1'])
    for constant, channels in ((columns['c'], columns), (mapped['speed'], mapped)):
        assert set(constant.values) == {16.3}
        assert constant.rate_hz == pytest.approx(100.0)
        ends = [(one.stamps_ns.min(), one.stamps_ns.max()) for one in channels.values()]
        assert constant.stamps_ns[0] == min(first for first, _ in ends)
        assert constant.stamps_ns[-1] == max(last for _, last in ends)
    np.testing.assert_array_equal(mapped['yaw'].values, record['lateral'].values * 0.1)


@pytest.mark.parametrize(
    ('source', 'words'),
    [
        ('a=/nowhere.x', r"no topic '/nowhere'.*it has /rig/"),
        ('a=/rig/speed.twist.linear.w', r"no field 'w' in twist.linear.*'x', 'y', 'z'"),
        ('a=/rig/speed.twist.linear', 'is not a number'),
        ('a=/rig/lateral.position', r'is an array.*position\[0\]'),
        ('a=/rig/lateral.position[3]', r'there is no \[3\]'),
        ('a=/rig/lateral.name[0]', 'is a string'),
        ('a=/rig/lateral.position..x', 'no field path'),
        ('a=/rig/hunting/normal_form.data', 'is a string'),
    ],
)
def test_what_is_not_there_is_said_in_one_line(bag: Path, source: str, words: str) -> None:
    with pytest.raises(BagError, match=words) as caught:
        read_columns(bag, [source])
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('name', 'content', 'words'),
    [
        ('nothing', None, 'no such recording'),
        ('', None, r'no \.mcap or \.db3 file in it'),
        ('empty.mcap', b'', 'empty'),
        ('text.mcap', b'hello', 'not an MCAP file'),
        ('text.db3', b'hello', 'SQLite'),
        ('packed.mcap.zstd', zstandard.compress(b'hello'), 'not an MCAP file'),
        ('table.xls', b'hello', 'not a recording'),
    ],
)
def test_what_is_no_recording_is_said_in_one_line(tmp_path: Path, name, content, words) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(BagError, match=words):
        read_record(tmp_path / name)


def test_a_channel_that_is_wanted_and_is_not_there_or_says_nothing(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'run') as writer:
        writer.topic('/rig/speed', 'geometry_msgs/msg/TwistStamped')
        key = writer.topic('/rig/yaw', 'sensor_msgs/msg/JointState')
        for message in serialise('yaw', Series([1, 2], [1.0, 2.0])):
            writer.write(key, 1, bytes(message))
    for channel, words in (('lateral', 'is not in it'), ('speed', 'holds no messages')):
        with pytest.raises(BagError, match=f'channel {channel} {words}'):
            read_record(tmp_path / 'run', require=[channel])


def test_a_joint_is_found_by_its_name_in_any_order(tmp_path: Path) -> None:
    kind = 'sensor_msgs/msg/JointState'
    rng = np.random.default_rng(4)
    expected = []
    with chunks_of(900), BagWriter(tmp_path / 'run') as writer:
        key = writer.topic('/rig/lateral', kind)
        for index in range(60):
            # Names of one length: only the bytes tell the orders apart.
            names = ['lateral', 'outward', 'onward_'][: int(rng.integers(1, 4))]
            rng.shuffle(names)
            if 'lateral' not in names:
                names[0] = 'lateral'
            values = rng.normal(size=len(names))
            expected.append(values[names.index('lateral')])
            message = TYPES[kind](
                header=header(BEGIN_NS + index),
                name=names,
                position=values,
                velocity=np.zeros(0),
                effort=np.zeros(0),
            )
            wire = bytes(STORE.serialize_cdr(message, kind))
            # Some publishers send what is left of their estimate of the length.
            writer.write(key, BEGIN_NS + index, wire + rng.bytes(index % 9))
    for columns in (
        read_columns(tmp_path / 'run', ['a=/rig/lateral.position[lateral]'])['a'],
        read_record(tmp_path / 'run')['lateral'],
    ):
        np.testing.assert_array_equal(columns.values, expected)
    with pytest.raises(BagError, match="no joint 'inward', it has"):
        read_columns(tmp_path / 'run', ['a=/rig/lateral.position[inward]'])


def test_what_pads_a_message_makes_no_layout_of_its_own(tmp_path: Path, monkeypatch) -> None:
    """Fast CDR leaves there what the memory held: each message would be walked alone."""
    rng, walks = np.random.default_rng(5), []
    values = Series(np.arange(1, 1001), rng.normal(size=1000))
    with BagWriter(tmp_path / 'run') as writer:
        key = writer.topic('/rig/lateral', 'sensor_msgs/msg/JointState')
        for stamp, message in zip(values.stamps_ns, serialise('lateral', values), strict=True):
            wire = bytearray(message)
            wire[17:20] = rng.bytes(3)  # behind an empty frame
            writer.write(key, int(stamp), wire)
    monkeypatch.setattr(gather, 'locate', lambda *words: walks.append(1) or locate(*words))
    found = read_record(tmp_path / 'run')['lateral']
    np.testing.assert_array_equal(found.values, values.values)
    assert len(walks) < 10


def test_a_type_described_in_idl_is_read(tmp_path: Path) -> None:
    head = '=' * 80 + '\nIDL: lab_msgs/msg/'
    parts = (
        ('Inner', 'struct Inner { float small; double value; };'),
        ('Outer', 'struct Outer { sequence<double> data; lab_msgs::msg::Inner inner; };'),
    )
    text = ''.join(
        f'{head}{name}\nmodule lab_msgs {{ module msg {{ {body} }}; }};\n' for name, body in parts
    )
    raw = b'\0\1\0\0' + struct.pack('<I4xddf4xd', 2, 1.5, 2.5, 3.5, 4.5)
    with Peer(tmp_path / 'idl.mcap') as peer:
        schema = peer.writer.register_schema('lab_msgs/msg/Outer', 'ros2idl', text.encode())
        peer.add(peer.writer.register_channel('/daq', 'cdr', schema), [raw] * 3)
    columns = read_columns(tmp_path / 'idl.mcap', ['a=/daq.data[1]', 'b=/daq.inner.value'])
    assert columns['a'].values.tolist() == [2.5] * 3
    assert columns['b'].values.tolist() == [4.5] * 3
    assert len(columns['b']) == 3


def test_of_two_rigs_in_one_bag_the_topics_are_named(tmp_path: Path) -> None:
    from hunt_ros.bag.record_writer import messages_of

    first, second = make_record(seconds=0.2, seed=1), make_record(seconds=0.2, seed=2)
    with BagWriter(tmp_path / 'two') as writer:
        for name, record in (('a', first), ('b', second)):
            for message in messages_of(record, writer.topic, name):
                writer.write(*message)
    with pytest.raises(BagError, match='several topics'):
        read_record(tmp_path / 'two')
    assert_same(second, read_record(tmp_path / 'two', {name: f'/b/{name}' for name in second}))
    with Bag(tmp_path / 'two') as bag:
        assert find_topic(bag, 'a/lateral', 'x') == '/a/lateral'


def test_memory_is_the_columns_and_some_blocks(tmp_path: Path) -> None:
    import tracemalloc

    path = write_record(tmp_path / 'long', make_record(seconds=600.0))
    with Bag(path) as bag:
        read_columns(bag, ['a=/rig/yaw'])
        tracemalloc.start()
        column = read_columns(bag, ['a=/rig/yaw'])['a']
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    # The column itself, its log times, and a block with what is gathered from it.
    assert peak < 2 * column.stamps_ns.nbytes + column.values.nbytes + 4 * (1 << 22)


def test_messages_in_any_order_come_out_in_the_order_of_log_time(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    order = rng.permutation(500)
    with chunks_of(1000), BagWriter(tmp_path / 'run') as writer:
        key = writer.topic('/p', 'std_msgs/msg/Float64')
        for at in order.tolist():
            writer.write(key, at + 1, b'\0\1\0\0' + struct.pack('<d', at))
    column = read_columns(tmp_path / 'run', ['a=p'])['a']
    np.testing.assert_array_equal(column.values, np.arange(500.0))
