"""Low-rate topics: texts and statuses as they were published."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hunt_ros.bag import BagWriter
from hunt_ros.bag.cdr.message_types import standard_types
from hunt_ros.bag.messages import DIAGNOSTIC_ARRAY, read_raw, read_statuses, read_texts
from hunt_ros.detection import Level
from hunt_ros.errors import BagError
from hunt_ros.recorded_run import recorded_events


def test_texts_are_found_by_their_last_name_and_absent_topics_are_empty(bag: Path) -> None:
    assert read_texts(bag, 'hunting/normal_form') == ['v_c: 8']
    assert read_texts(bag, '/rig/hunting/normal_form') == ['v_c: 8']
    assert read_texts(bag, 'hunting/journal') == []


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


def test_what_was_said_live_is_read_from_the_recording(tmp_path: Path) -> None:
    types = standard_types()
    kinds = [types.types[name] for name in (
        'std_msgs/msg/Header', 'builtin_interfaces/msg/Time', DIAGNOSTIC_ARRAY,
        'diagnostic_msgs/msg/DiagnosticStatus', 'diagnostic_msgs/msg/KeyValue',
    )]  # fmt: skip
    header, time, array, status, pair = kinds
    said = status(2, 'escaping', 'it grows', '', [pair('event', 'escaping'), pair('cause', 'why')])
    message = array(header(time(7, 5), ''), [said])
    with BagWriter(tmp_path / 'run') as writer:
        key = writer.topic('/rig/hunting/events', DIAGNOSTIC_ARRAY)
        writer.write(key, 1, bytes(types.serialize_cdr(message, DIAGNOSTIC_ARRAY)))
    (read,) = read_statuses(tmp_path / 'run', 'hunting/events')
    assert read == {'event': 'escaping', 'cause': 'why', 'level': '2', 'message': 'it grows',
                    'stamp_ns': '7000000005'}  # fmt: skip
    assert read_statuses(tmp_path / 'run', 'hunting/status') == []
    (event,) = recorded_events(tmp_path / 'run') or ()
    assert (event.stamp_ns, event.event, event.level) == (7_000_000_005, 'escaping', Level.ERROR)


def test_a_recording_without_a_detector_has_no_events(bag: Path) -> None:
    assert recorded_events(bag) is None
