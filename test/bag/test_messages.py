"""Low-rate topics: texts and statuses as they were published."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from hunt_ros.bag import BagWriter
from hunt_ros.bag.messages import DIAGNOSTIC_ARRAY, read_raw, read_statuses, read_texts
from hunt_ros.errors import BagError

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types


def status_array(stamp_ns: int, level: int, message: str) -> bytes:
    seconds, rest = divmod(stamp_ns, 10**9)
    stamp = TYPES['builtin_interfaces/msg/Time'](sec=seconds, nanosec=rest)
    header = TYPES['std_msgs/msg/Header'](stamp=stamp, frame_id='')
    pair = TYPES['diagnostic_msgs/msg/KeyValue'](key='speed_mps', value='7.25')
    status = TYPES['diagnostic_msgs/msg/DiagnosticStatus'](
        level=level, name='detector', message=message, hardware_id='', values=[pair]
    )
    array = TYPES[DIAGNOSTIC_ARRAY](header=header, status=[status])
    return bytes(STORE.serialize_cdr(array, DIAGNOSTIC_ARRAY))


def test_events_come_back_with_stamp_level_and_values(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'run') as writer:
        key = writer.topic('/rig/hunting/events', DIAGNOSTIC_ARRAY)
        for index in range(5):
            writer.write(key, index + 10, status_array(10**18 + index, index, f'event {index}'))
    found = read_statuses(tmp_path / 'run', 'hunting/events')
    assert [status.level for status in found] == ['OK', 'WARN', 'ERROR', 'STALE', 'STALE']
    assert [status.stamp_ns for status in found] == [10**18 + index for index in range(5)]
    assert [status.log_ns for status in found] == [10, 11, 12, 13, 14]
    assert found[2].message == 'event 2'
    assert found[2].values == {'speed_mps': '7.25'}


def test_texts_are_found_by_their_last_name_and_absent_topics_are_empty(bag: Path) -> None:
    (text,) = read_texts(bag, 'hunting/normal_form')
    assert text.text == 'v_c: 8'
    assert read_texts(bag, '/rig/hunting/normal_form') == [text]
    assert read_texts(bag, 'hunting/journal') == []
    assert read_statuses(bag, 'hunting/events') == []


def test_a_topic_of_another_type_is_refused(bag: Path) -> None:
    with pytest.raises(BagError, match='JointState, expected std_msgs/msg/String'):
        read_texts(bag, 'lateral')


def test_raw_messages_come_in_the_order_of_time(bag: Path, record) -> None:
    raw = list(read_raw(bag, ['lateral', 'speed']))
    assert len(raw) == len(record['lateral']) + len(record['speed'])
    assert (np.diff([message.log_ns for message in raw]) >= 0).all()


def test_damaged_messages_are_refused_in_one_line(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'run') as writer:
        key = writer.topic('/t', 'std_msgs/msg/String')
        writer.write(key, 1, b'\x00\x01\x00\x00\xff\xff\xff\x7fx')
    with pytest.raises(BagError, match='not a std_msgs/msg/String') as caught:
        read_texts(tmp_path / 'run', 't')
    assert '\n' not in str(caught.value)
