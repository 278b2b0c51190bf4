"""Two replays beside each other, and one whose process was stopped."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from hunt_ros.bag import write_record
from hunt_ros.cli.support.suite import free_port
from hunt_ros.nodes.support.conversions import to_ns
from hunt_ros.nodes.support.qos import EVENTS
from hunt_ros.samples import Record, Series


def _bag(folder: Path, seconds: float, began_ns: int = 1_700_000_000_000_000_000) -> Path:
    stamps = began_ns + 5_000_000 * np.arange(round(200 * seconds))
    series = {name: Series(stamps, 1e-9 * np.arange(stamps.size)) for name in ('lateral', 'speed')}
    return write_record(folder / 'bag', Record(series))


@pytest.mark.slow
def test_a_replay_refuses_another_and_a_stopped_one_goes_on_where_it_was(graph) -> None:
    bag = _bag(graph.folder, 600.0)
    lateral = graph.collect(JointState, 'lateral')
    first = graph.start('live_replay', bag=bag)
    graph.spin_until(lambda: lateral)
    own = '/parameter', '/rosout', '/diag', '/rig/parameters', '/rig/live_replay/calls'
    names = (name for name, _ in graph.node.get_topic_names_and_types())
    replayed = {name for name in names if not name.startswith(own)}
    assert replayed == {'/clock', '/rig/lateral', '/rig/speed'}, 'a recording drives no rig'
    graph.start('live_replay', bag=bag)
    assert graph.wait('live_replay') == 2
    assert first.poll() is None, 'the one that plays goes on'

    stopped_s = 8.0
    first.send_signal(signal.SIGSTOP)
    graph.spin(stopped_s)
    heard, begin = len(lateral), time.monotonic()
    first.send_signal(signal.SIGCONT)
    graph.spin_until(lambda: len(lateral) > heard + 700)
    stamps = [to_ns(message.header.stamp) for message in lateral]
    assert stamps == sorted(stamps)
    # A busy machine holds it up a little, and that is made up for: the stop is not.
    played_s = (stamps[-1] - stamps[heard - 1]) / 1e9
    assert played_s < time.monotonic() - begin + 0.6 * stopped_s
    first.kill()
    first.wait()
    graph.node.create_publisher(JointState, 'lateral', 10)
    graph.start('live_replay', bag=bag)
    assert graph.wait('live_replay') == 2
    assert '/rig/lateral is published by' in graph.log('live_replay').read_text()


def test_a_recording_of_simulated_time_is_told_to_be_one_and_ends_no_detector(graph) -> None:
    """Its first stamp is 0: the time before it, of which no clock has one, ended the detector."""
    told = graph.told(qos=EVENTS, of='/live_replay')
    clock = graph.collect(Clock, '/clock')
    detector = graph.start('hunting_detector', use_sim_time=True)
    graph.start('live_replay', bag=_bag(graph.folder, 60.0, 0))
    graph.spin_until(lambda: len(clock) > 300 and told)
    assert min(to_ns(message.clock) for message in clock) >= 0
    last = told.last
    assert (last['bag'], last['length_s'], last['rate']) == ('bag', '59.995', '1.0')
    assert detector.poll() is None


def test_the_part_that_is_asked_for_comes_once_and_a_pause_holds_it(graph) -> None:
    health = graph.told(of='/live_replay')
    lateral = graph.collect(JointState, 'lateral')
    bag = _bag(graph.folder, 60.0)
    graph.start('live_replay', bag=bag, from_s=10.0, to_s=14.0, rate=0.5)
    graph.spin_until(lambda: lateral)
    assert graph.call('replay/pause').success
    graph.spin(0.5)  # what was under way
    count = len(lateral)
    graph.spin(1.0)
    assert len(lateral) == count < 801
    assert graph.call('replay/resume').success
    assert not graph.set_parameters('live_replay', rate=5.0)
    graph.spin_until(lambda: health.says('finished'))
    stamps = [to_ns(message.header.stamp) for message in lateral]
    assert stamps == [1_700_000_000_000_000_000 + 5_000_000 * k for k in range(2000, 2801)]
    graph.end('live_replay')
    graph.start('live_replay', bag=bag, from_s=61.0)
    assert graph.wait('live_replay') == 2
    assert 'no message from 61 s' in graph.log('live_replay').read_text()


def test_a_replay_waits_for_who_judges_and_not_for_the_page(graph) -> None:
    page, replay = (graph.told(qos=EVENTS, of=name) for name in ('/dashboard', '/live_replay'))
    graph.start('dashboard', port=free_port())
    graph.spin_until(lambda: page)
    graph.start('live_replay', bag=_bag(graph.folder, 600.0))
    graph.spin_until(lambda: len(replay) > 2)
    assert {each.get('listening') for each in replay} == {'False'}
    lateral = graph.collect(JointState, 'lateral')
    graph.spin_until(lambda: lateral)


def test_a_recording_whose_clock_was_set_back_is_played_as_it_was_made(graph) -> None:
    stamps = 1_700_000_000_000_000_000 + 5_000_000 * np.arange(400)
    stamps[200:] -= 600_000_000
    values = 1e-6 * np.arange(400)
    bag = graph.folder / 'bag'
    write_record(bag, Record({name: Series(stamps, values) for name in ('lateral', 'speed')}))
    health = graph.told(of='/live_replay')
    lateral = graph.collect(JointState, 'lateral')
    graph.start('live_replay', bag=bag)
    graph.spin_until(lambda: health.says('finished') and len(lateral) == 400)
    assert [message.position[0] for message in lateral] == values.tolist()
    heard = [to_ns(message.header.stamp) for message in lateral]
    assert heard == sorted(heard)
