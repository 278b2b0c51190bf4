"""The recorder as a process: what is on the topics is in the bag, also after kill -9."""

from __future__ import annotations

import json
import os
import shutil
import signal
import time
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from bags_made import written
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from processes import joint
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from hunt_ros.bag import Bag, clips, read_columns, read_record
from hunt_ros.bag.messages import read_statuses, read_texts
from hunt_ros.bag.recording import RecordingState
from hunt_ros.errors import BagError
from hunt_ros.nodes import bag_recorder
from hunt_ros.nodes.support.conversions import diagnostic, twist
from hunt_ros.nodes.support.qos import latched

BEGIN_NS = 1_700_000_000_000_000_000
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def start(graph, **parameters: object) -> None:
    graph.start('bag_recorder', directory=str(graph.folder), **parameters)
    graph.spin_until(lambda: list(graph.folder.glob('*.active')))


def stopped(graph) -> Path:
    """Stop the recording, and return it."""
    answer = graph.call('recording/stop')
    assert answer.success, answer.message
    return Path(answer.message)


def test_parameters_stand_in_the_recording_as_they_are_and_as_they_become(graph) -> None:
    told = graph.collect(String, 'parameters', latched(100))
    start(graph, operator='Mia')
    graph.spin_until(lambda: told)
    assert not graph.set_parameters('bag_recorder', operator='Ada')
    graph.spin_until(lambda: 'operator: Ada' in told[-1].data)
    other = graph.node.create_publisher(String, 'parameters', latched())
    other.publish(String(data='/rig/sensor:\n  ros__parameters: {gain: 2.0}\n'))
    (active,) = graph.folder.glob('*.active')

    def noted() -> bool:
        with suppress(BagError), Bag(active) as opened:
            files = opened.strings('parameters')
            return 'Ada' in files.get('/rig/bag_recorder', '') and '/rig/sensor' in files
        return False

    graph.spin_until(noted)
    first = stopped(graph)
    assert graph.call('recording/start').success
    for path in (first, stopped(graph)):
        with Bag(path) as opened:
            files = opened.strings('parameters')
            assert set(files) == {'/rig/bag_recorder', '/rig/sensor'}
            assert 'operator: Ada' in files['/rig/bag_recorder']
            assert yaml.safe_load(files['/rig/bag_recorder'])['/rig/bag_recorder']
            assert 'gain: 2.0' in files['/rig/sensor']
            assert '/rig/parameters' not in opened.topics


def test_everything_published_is_in_the_closed_bag_bit_for_bit(graph) -> None:
    lateral = graph.node.create_publisher(JointState, 'lateral', 1000)
    speed = graph.node.create_publisher(TwistStamped, 'speed', 1000)
    form = graph.node.create_publisher(String, 'hunting/normal_form', LATCHED)
    form.publish(String(data='v_c: 8.0'))
    closed = graph.collect(String, 'recording/closed', LATCHED)
    start(graph, rig_name='the rig', operator='the operator', notes='second wheelset')
    graph.spin_until(lambda: lateral.get_subscription_count() and speed.get_subscription_count())
    values = np.random.default_rng(5).normal(size=500)
    for index, value in enumerate(values):
        lateral.publish(joint('lateral', BEGIN_NS + index, float(value)))
        speed.publish(twist(BEGIN_NS + index, float(index)))
    # A topic that nobody announced.
    late = graph.node.create_publisher(Imu, 'frame/imu', 10)
    graph.spin_until(late.get_subscription_count)
    late.publish(Imu())
    mark = graph.node.create_publisher(String, 'recording/mark', 10)
    graph.spin_until(mark.get_subscription_count)
    mark.publish(String(data='bump at joint 3'))
    graph.spin(1.0)
    bag = stopped(graph)
    graph.spin_until(lambda: closed)
    assert closed[-1].data == str(bag)
    record = read_record(bag)
    np.testing.assert_array_equal(record['lateral'].values, values)
    np.testing.assert_array_equal(record['lateral'].stamps_ns, BEGIN_NS + np.arange(500))
    np.testing.assert_array_equal(record['speed'].values, np.arange(500.0))
    assert record.notes['rig'] == 'the rig'
    assert record.notes['operator'] == 'the operator'
    assert record.notes['notes'] == 'second wheelset'
    assert read_texts(bag, 'hunting/normal_form') == ['v_c: 8.0']
    assert read_texts(bag, 'recording/mark') == ['bump at joint 3']
    assert len(read_columns(bag, ['x=/rig/frame/imu.linear_acceleration.x'])['x']) == 1
    with Bag(bag) as opened:
        assert not opened.problems
        parameters = dict(opened.strings('parameters'))
        assert 'operator: the operator' in parameters['/rig/bag_recorder']


def test_services_start_split_stop_and_mark_with_words_or_without(graph) -> None:
    words = graph.node.create_publisher(String, 'bag_recorder/calls', 10)
    graph.start('bag_recorder', directory=str(graph.folder), autostart=False)
    graph.spin_until(words.get_subscription_count)
    for service in ('mark', 'stop', 'split'):
        assert not graph.call(f'recording/{service}').success
    assert graph.call('recording/start').success
    assert not graph.call('recording/start').success
    assert graph.call('recording/mark').success
    for text in ('bump at joint 3', 'crane overhead'):
        said = {'service': 'mark', 'who': 'Mia', 'words': text}
        # As who calls with words does: the recorder has them.
        words.publish(String(data=json.dumps(said)))
        assert words.wait_for_all_acked(Duration(seconds=30.0))
        assert graph.call('recording/mark').success
    assert graph.call('recording/split').success
    assert not all(graph.call('recording/split').success for _ in range(20)), 'no flood of files'
    assert graph.call('recording/mark').success
    path = stopped(graph)
    texts = read_texts(path, 'recording/mark')
    assert texts == ['mark', 'bump at joint 3', 'crane overhead', 'mark']
    assert path.name.startswith('hunt_')
    assert 2 <= len(list(path.glob('*.mcap'))) < 20


def alarm(word: str, level: str) -> DiagnosticArray:
    values = {'event': word, 'test': 'rate', 'cause': 'it grows'}
    return diagnostic(time.time_ns(), word, level, 'it grows', values, 'rig')


def test_an_alarm_has_a_clip_while_the_recording_goes_on_and_when_it_ends(
    graph, resident, monkeypatch
) -> None:
    monkeypatch.setattr(clips, 'AFTER_S', 1.0)
    lateral = graph.node.create_publisher(JointState, 'lateral', 1000)
    events = graph.node.create_publisher(DiagnosticArray, 'hunting/events', 1000)
    resident(bag_recorder.BagRecorderNode, directory=graph.folder, least_free_mib=1.0)
    graph.spin_until(lambda: lateral.get_subscription_count() and events.get_subscription_count())
    lateral.publish(joint('lateral', BEGIN_NS, 1.5))
    events.publish(alarm('margin_low', 'WARN'))
    for word in ('escaping', 'limit_cycle'):  # one alarm, and it chatters
        events.publish(alarm(word, 'ERROR'))
        events.publish(alarm('quiet', 'OK'))
    graph.spin_until(lambda: list(graph.folder.glob('*.mcap')))
    (path,) = graph.folder.glob('*.mcap')
    assert path.stem.endswith('_hunting')
    assert read_record(path)['lateral'].values.tolist() == [1.5]
    assert len(read_statuses(path, 'hunting/events')) == 5
    (active,) = graph.folder.glob('*.active')
    assert path.name.startswith(f'clip_{active.stem}_')

    monkeypatch.setattr(clips, 'AFTER_S', 500.0)
    events.publish(alarm('interlock_tripped', 'ERROR'))
    graph.spin(0.5)
    stopped(graph)
    graph.spin_until(lambda: len(list(graph.folder.glob('*.mcap'))) == 1 and len(
        read_statuses(path, 'hunting/events')) == 6)  # fmt: skip


def test_an_event_that_nobody_can_read_ends_no_recording(graph) -> None:
    lateral = graph.node.create_publisher(JointState, 'lateral', 10)
    events = graph.node.create_publisher(DiagnosticArray, 'hunting/events', 10)
    start(graph)
    graph.spin_until(lambda: lateral.get_subscription_count() and events.get_subscription_count())
    events.publish(serialize_message(alarm('escaping', 'ERROR'))[:-9])
    graph.spin(0.5)
    lateral.publish(joint('lateral', BEGIN_NS, 1.5))
    graph.spin(0.5)
    assert read_record(stopped(graph))['lateral'].values.tolist() == [1.5]


def test_kill_loses_nothing_that_was_written_and_the_next_start_closes_it(graph) -> None:
    lateral = graph.node.create_publisher(JointState, 'lateral', 1000)
    events = graph.node.create_publisher(DiagnosticArray, 'hunting/events', 1000)
    process = graph.start('bag_recorder', directory=str(graph.folder))
    graph.spin_until(lambda: lateral.get_subscription_count() and events.get_subscription_count())
    events.publish(alarm('escaping', 'ERROR'))  # its clip waits when the recorder is killed
    values = np.arange(100.0)
    for index, value in enumerate(values):
        lateral.publish(joint('lateral', BEGIN_NS + index, float(value)))
    (left,) = graph.folder.glob('*.active')
    graph.spin_until(lambda: written(left, '/rig/lateral') == values.size)
    graph.spin_until(lambda: written(left, '/rig/hunting/events'))
    os.kill(process.pid, signal.SIGKILL)
    process.wait()

    graph.start('bag_recorder', directory=str(graph.folder), autostart=False)
    final = left.with_suffix('')
    graph.spin_until(final.exists)
    np.testing.assert_array_equal(read_record(final)['lateral'].values, values)
    clip = f'clip_{final.name}_*_hunting.mcap'
    graph.spin_until(lambda: list(graph.folder.glob(clip)))
    (path,) = graph.folder.glob(clip)
    assert len(read_statuses(path, 'hunting/events')) == 1


def test_what_was_published_before_a_stop_is_taken_though_the_machine_was_busy(graph) -> None:
    lateral = graph.node.create_publisher(JointState, 'lateral', 5000)
    process = graph.start('bag_recorder', directory=str(graph.folder))
    stop = graph.node.create_client(Trigger, 'recording/stop')
    graph.spin_until(lambda: lateral.get_subscription_count() and stop.service_is_ready())
    lateral.publish(joint('lateral', BEGIN_NS, 0.0))
    graph.spin_until(lambda: lateral.wait_for_all_acked(Duration(seconds=0.0)))
    process.send_signal(signal.SIGSTOP)
    for index in range(1, 1500):
        lateral.publish(joint('lateral', BEGIN_NS + index, float(index)))
    answer = stop.call_async(Trigger.Request())
    graph.spin(0.5)
    process.send_signal(signal.SIGCONT)
    graph.spin_until(answer.done)
    assert answer.result().success, answer.result().message
    values = read_record(answer.result().message)['lateral'].values
    np.testing.assert_array_equal(values, np.arange(1500.0))


def test_a_topic_of_a_reliable_and_a_best_effort_publisher_is_recorded_once(graph) -> None:
    reliable = graph.node.create_publisher(JointState, 'lateral', 100)
    start(graph)
    graph.spin_until(reliable.get_subscription_count)
    loose = graph.node.create_publisher(JointState, 'lateral', BEST_EFFORT)
    graph.spin_until(lambda: loose.get_subscription_count() and graph.spin(0.5) is None)
    estimate = graph.node.create_publisher(JointState, 'hunting/amplitude', 10)
    for index in range(50):
        reliable.publish(joint('lateral', BEGIN_NS + 2 * index, 1.0))
        loose.publish(joint('lateral', BEGIN_NS + 2 * index + 1, 2.0))
        estimate.publish(joint('lateral_amplitude', BEGIN_NS + index, 3.0))
        graph.spin(0.02)
    path = stopped(graph)
    # Of the best-effort publisher some may be lost; none of any publisher is there twice.
    with Bag(path) as bag:
        assert 50 < bag.topics['/rig/lateral'].messages <= 100
        assert '/rig/hunting/amplitude' not in bag.topics, 'a replay makes it again'
    assert np.count_nonzero(read_record(path)['lateral'].values == 1.0) == 50


def test_simulated_time_without_a_clock_is_said(graph, monkeypatch) -> None:
    monkeypatch.setenv(
        'HUNT_START_S', '2'
    )  # no start takes so long: what it waits for does not come
    health = graph.told()
    graph.start('bag_recorder', directory=str(graph.folder), use_sim_time=True)
    graph.spin_until(lambda: health)
    assert '/clock' in health.last['message']
    graph.spin_until(lambda: health.last['level'] == 'STALE')
    assert '/clock' in health.last['message']


def test_a_later_recording_begins_with_what_latched_topics_still_say(graph) -> None:
    alarms = graph.node.create_publisher(String, 'hunting/alarms', latched())
    journal = graph.node.create_publisher(String, 'hunting/journal', latched(1000))
    start(graph)
    graph.spin_until(lambda: alarms.get_subscription_count() and journal.get_subscription_count())
    for number in range(5):
        alarms.publish(String(data=f'{number} alarms'))
        assert alarms.wait_for_all_acked(Duration(seconds=30.0)), 'it keeps no more than one'
        journal.publish(String(data=f'entry {number}'))
    first = stopped(graph)
    assert graph.call('recording/start').success
    for path, numbers in ((first, range(5)), (stopped(graph), [4])):
        said = read_texts(path, 'hunting/alarms')
        assert said == [f'{number} alarms' for number in numbers]
        entries = read_texts(path, 'hunting/journal')
        assert entries == [f'entry {number}' for number in range(5)]


def test_a_recorder_without_room_stays_says_so_and_records_when_there_is(
    graph, resident, monkeypatch
) -> None:
    monkeypatch.setattr(bag_recorder, '_AGAIN_S', 0.5)
    # Not filled in truth: others write to this disk and free it.
    usage, free = shutil.disk_usage(graph.folder), [1 << 10]
    monkeypatch.setattr(shutil, 'disk_usage', lambda path: usage._replace(free=free[0]))
    closed = graph.collect(String, 'recording/closed', LATCHED)
    health = graph.told()
    folder = graph.folder / 'bags'
    resident(bag_recorder.BagRecorderNode, directory=folder, least_free_mib=1.0)
    graph.spin_until(lambda: health.says('on the disk', level='ERROR'))
    assert not list(folder.glob('hunt_*'))
    health.clear()
    free[0] = usage.total
    graph.spin_until(lambda: list(folder.glob('*.active')) and health.says(level='OK'))
    health.clear()
    free[0] = 1 << 10
    graph.spin_until(lambda: closed)
    graph.spin_until(lambda: health.says('on the disk', level='ERROR'))
    with Bag(closed[-1].data) as bag:
        assert not bag.problems


def test_a_folder_that_is_moved_away_is_said_and_another_recording_follows(
    graph, resident, monkeypatch
) -> None:
    monkeypatch.setattr(bag_recorder, '_AGAIN_S', 1000.0)
    folder = graph.folder / 'recordings'
    health = graph.told()
    node = resident(bag_recorder.BagRecorderNode, directory=folder)
    graph.spin_until(lambda: list(folder.glob('*.active')))
    node._began_s -= 1000.0  # so long it has lasted
    folder.rename(graph.folder / 'tidied')
    graph.spin_until(lambda: health.says('No such file', level='ERROR'))
    graph.spin_until(lambda: list(folder.glob('*.active')))


def test_dropped_messages_are_a_warning(tmp_path: Path) -> None:
    state = RecordingState(tmp_path, dropped=Counter({'/a': 1, '/b': 2}))
    assert bag_recorder._judged(state) == ('WARN', '3 messages dropped, most of them on /b')
    assert bag_recorder._judged(replace(state, dropped=Counter()))[0] == 'OK'
    assert bag_recorder._judged(replace(state, running=False))[0] == 'ERROR'
