"""Low-rate topics: texts and statuses as they were published."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made import record_of

from hunt_ros.bag import Bag, BagWriter
from hunt_ros.bag.cdr.message_types import standard_types
from hunt_ros.bag.messages import DIAGNOSTIC_ARRAY, STRING, read_raw, read_statuses, read_texts
from hunt_ros.bag.record_writer import messages_of
from hunt_ros.cli.main import main
from hunt_ros.cli.support.recorded_run import recorded_events
from hunt_ros.detection import Level
from hunt_ros.errors import BagError


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


def test_a_damaged_message_costs_itself_and_is_told_in_one_line(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'run') as writer:
        key = writer.topic('/t', 'std_msgs/msg/String')
        writer.write(key, 1, b'\x00\x01\x00\x00\xff\xff\xff\x7fx')
        writer.write(key, 2, b'\x00\x01\x00\x00\x02\x00\x00\x00x\x00')
    with Bag(tmp_path / 'run') as bag:
        assert read_texts(bag, 't') == ['x']
        (told,) = map(str, bag.problems)
    assert told.startswith('topic /t: 1 messages cannot be read (not a std_msgs/msg/String: ')
    assert '\n' not in told


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
    with Bag(tmp_path / 'run') as recording:
        (event,) = recorded_events(recording) or ()
    assert (event.stamp_ns, event.event, event.level) == (7_000_000_005, 'escaping', Level.ERROR)


def test_a_recording_without_a_detector_has_no_events(bag: Path) -> None:
    with Bag(bag) as recording:
        assert recorded_events(recording) is None


def test_a_damaged_journal_costs_no_replay_and_a_damaged_event_no_report(
    tmp_path: Path, capsys
) -> None:
    seconds = np.arange(1000) / 100.0
    record = record_of(seconds, lateral=1e-4 * np.sin(18.0 * seconds), yaw=0.0, speed=7.0)
    with BagWriter(tmp_path / 'run') as writer:
        for message in messages_of(record, writer.topic, 'rig'):
            writer.write(*message)
        for topic, kind in (('journal', STRING), ('events', DIAGNOSTIC_ARRAY)):
            writer.write(
                writer.topic(f'/rig/hunting/{topic}', kind), 10**10, b'\0\1\0\0' + b'\xff' * 9
            )
    assert main(['replay', str(tmp_path / 'run')]) == 0
    assert 'topic /rig/hunting/journal: 1 messages cannot be read' in capsys.readouterr().out
    main(['report', str(tmp_path / 'run'), '--out', str(tmp_path / 'a.html')])
    assert 'topic /rig/hunting/events: 1 messages cannot be read' in capsys.readouterr().err
    assert (tmp_path / 'a.html').exists()
