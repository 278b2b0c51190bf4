"""Sensors on a host whose clock is not the detector's: live, recorded, and replayed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from processes import Wheelset
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from hunt_ros.bag import read_record
from hunt_ros.cli.support.recorded_run import recorded_run
from hunt_ros.detection import HuntingDetector
from hunt_ros.detection.replay import detect, samples_apart
from hunt_ros.nodes.support.conversions import to_ns
from hunt_ros.nodes.support.qos import latched

pytestmark = pytest.mark.slow


def test_a_host_with_another_clock_is_followed_live_and_the_run_is_replayed(graph) -> None:
    events = graph.told('hunting/events')
    statuses = graph.told('hunting/status')
    amplitudes = graph.collect(JointState, 'hunting/amplitude')
    closed = graph.collect(String, 'recording/closed', latched())
    host = Wheelset(graph, 2e-5, behind_ns=600_000_000)  # speaks before the detector listens
    recordings = graph.folder / 'recordings'
    graph.start('bag_recorder', directory=recordings)
    graph.spin_until(lambda: graph.node.count_subscribers('/rig/lateral') == 1, 60.0)
    graph.start('hunting_detector', Path(__file__).parents[2] / 'bags' / 'paper.yaml')

    graph.spin_until(lambda: statuses.says('lateral: clocks differ by', level='WARN'), 60.0)
    assert float(statuses.last['clock_offset_s lateral']) == pytest.approx(0.6, abs=0.2)
    host.amplitude_m = 7e-4
    graph.spin_until(lambda: {'escaping', 'limit_cycle'} & set(events.events), 30.0)
    assert graph.call('hunting/acknowledge_alarm').success
    host.muted = {'yaw'}
    graph.spin_until(
        lambda: 'input_stale' in events.events[events.events.index('acknowledged') :], 10.0
    )
    host.muted = set()
    graph.spin_until(lambda: events[-1]['event'] == 'input_recovered', 30.0)
    assert graph.call('recording/stop').success
    graph.spin_until(lambda: closed)

    bag = Path(closed[-1].data)
    live, record = recorded_run(bag), read_record(bag)
    assert live is not None
    assert any(entry.kind == 'offset' for entry in live.journal)
    assert not samples_apart(record, live.journal)[0]
    output = detect(HuntingDetector(), record, live.journal)
    rows = output.estimates
    heard = [m for m in amplitudes if to_ns(m.header.stamp) <= rows['stamp_ns'][-1]]
    assert len(heard) > 300
    at = np.searchsorted(rows['stamp_ns'], [to_ns(m.header.stamp) for m in heard])
    for number, name in enumerate(('lateral', 'yaw')):
        published = np.array([message.position[number] for message in heard])
        assert published.tobytes() == rows[f'{name}_amplitude'][at].tobytes()
    again = [(event.event, event.stamp_ns) for event in output.events]
    told = [(one['event'], int(one['stamp_ns'])) for one in events]
    told = [one for one in told if one[1] <= rows['stamp_ns'][-1]]
    assert told == again[-len(told) :]
