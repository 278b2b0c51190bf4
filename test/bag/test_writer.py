"""What is written opens everywhere: rosbags and mcap read the same samples."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from bags_made import assert_same, compressed
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from hunt_ros.bag import Bag, BagWriter, read_record, write_record
from hunt_ros.bag.bag_writer import folder_metadata
from hunt_ros.errors import BagError
from hunt_ros.samples import Record, Series


@pytest.mark.parametrize('compression', ['', 'lz4', 'zstd'])
def test_round_trip_is_exact(record, tmp_path: Path, compression: str) -> None:
    with compressed(compression):
        path = write_record(tmp_path / 'run', record)
    again = read_record(path)
    assert_same(record, again)
    assert again.notes == record.notes
    assert not list(tmp_path.glob('*.active'))


def test_nan_and_infinity_stay_what_they_are(tmp_path: Path) -> None:
    values = np.array([1.0, np.nan, -np.inf, 0.0, -0.0])
    record = Record({'lateral': Series(10**18 + np.arange(5), values)})
    again = read_record(write_record(tmp_path / 'run', record))['lateral'].values
    np.testing.assert_array_equal(again.view(np.int64), values.view(np.int64))


def test_rosbags_reads_the_same(bag: Path, record) -> None:
    with AnyReader([bag]) as reader:
        found: dict[str, list[tuple[int, int, float]]] = {}
        for connection, log_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            if connection.msgtype == 'std_msgs/msg/String':
                assert message.data == 'v_c: 8'
                continue
            stamp = message.header.stamp
            name = connection.topic.rpartition('/')[2]
            if name == 'speed':
                value = message.twist.linear.x
            else:
                assert message.name == [name]
                value = message.position[0]
            found.setdefault(name, []).append((log_ns, stamp.sec * 10**9 + stamp.nanosec, value))
    for name, series in record.items():
        log_ns, stamps, values = zip(*found[name], strict=True)
        np.testing.assert_array_equal(log_ns, series.stamps_ns)
        np.testing.assert_array_equal(stamps, series.stamps_ns)
        np.testing.assert_array_equal(values, series.values)


def test_mcap_finds_every_crc_and_count_right(bag: Path, record) -> None:
    with open(next(bag.glob('*.mcap')), 'rb') as file:
        reader = make_reader(file, validate_crcs=True)
        counts: dict[str, int] = {}
        for _, channel, message in reader.iter_messages():
            assert message.publish_time == message.log_time
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
        summary = reader.get_summary()
        notes = {item.name: item.metadata for item in reader.iter_metadata()}
    assert counts == {
        '/rig/hunting/normal_form': 1,
        **{f'/rig/{name}': len(series) for name, series in record.items()},
    }
    assert summary.statistics.message_count == sum(counts.values())
    assert notes['hunt_ros']['operator'] == 'the operator'


def test_metadata_is_version_8_and_counts_what_is_there(bag: Path, record) -> None:
    info = yaml.safe_load((bag / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert info['version'] == 8
    assert info['relative_file_paths'] == ['run_0.mcap']
    assert info['message_count'] == sum(map(len, record.values())) + 1
    assert info['custom_data'] == {'rig': 'the rig', 'operator': 'the operator'}
    (form,) = (
        topic
        for topic in info['topics_with_message_count']
        if topic['topic_metadata']['type'] == 'std_msgs/msg/String'
    )
    (offered,) = yaml.safe_load(form['topic_metadata']['offered_qos_profiles'])
    assert offered['durability'] == 1
    assert form['topic_metadata']['type_description_hash'].startswith('RIHS01_')
    span = info['starting_time']['nanoseconds_since_epoch'], info['duration']['nanoseconds']
    assert span == (record.start_ns, record.end_ns - record.start_ns)


def test_nothing_stays_under_the_final_name_after_an_error(record, tmp_path: Path) -> None:
    def interrupted() -> None:
        with BagWriter(tmp_path / 'run') as writer:
            writer.flush()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        interrupted()
    assert not list(tmp_path.iterdir())


def test_an_empty_record_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='no samples'):
        write_record(tmp_path / 'run', Record({'yaw': Series(np.zeros(0), np.zeros(0))}))
    assert not list(tmp_path.iterdir())


def test_a_topic_keeps_its_type(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'run') as writer:
        key = writer.topic('/a', 'std_msgs/msg/String')
        assert writer.topic('/a', 'std_msgs/msg/String') == key
        with pytest.raises(BagError, match='std_msgs/msg/String'):
            writer.topic('/a', 'std_msgs/msg/Float64')


def test_notes_written_later_are_found(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'run', notes={'rig': 'a'}) as writer:
        key = writer.topic('/a', 'std_msgs/msg/String')
        writer.write(key, 1, b'\x00\x01\x00\x00\x02\x00\x00\x00x\x00')
        writer.note('parameters', {'/rig/detector': 'p: 1'})
        writer.split()
        writer.note('hunt_ros', {'notes': 'later'})
    with Bag(tmp_path / 'run') as opened:
        assert opened.strings('parameters') == {'/rig/detector': 'p: 1'}
        assert opened.notes == {'rig': 'a', 'notes': 'later'}


@pytest.mark.parametrize(
    ('known', 'written'), [('kilted', 'kilted'), ('', 'jazzy'), (None, 'jazzy')]
)
def test_the_metadata_names_the_ros_it_was_recorded_under(monkeypatch, known, written) -> None:
    if known is None:
        monkeypatch.delenv('ROS_DISTRO', raising=False)
    else:
        monkeypatch.setenv('ROS_DISTRO', known)
    assert f'ros_distro: {written}\n' in folder_metadata([], [], {})
