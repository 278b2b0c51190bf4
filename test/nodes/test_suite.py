"""The whole chain on real rclpy: simulated rig, sensors, speed, detector, recorder, identifier."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from rcl_interfaces.msg import Log
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from hunt_ros.bag import ChannelSource, read_columns, read_record, write_record
from hunt_ros.detection import HuntingDetector
from hunt_ros.detection.replay import replay_journal
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.nodes.support.conversions import to_ns
from hunt_ros.nodes.support.qos import latched
from hunt_ros.recorded_run import recorded_run
from hunt_ros.samples import Record, Series

pytestmark = [pytest.mark.ros, pytest.mark.slow]

FORM = Path(__file__).parents[2] / 'bags' / 'paper.yaml'


def _start_rig(graph, **simulator: object) -> None:
    graph.start('rig_simulator', port=graph.port, start_with_readers=3, **simulator)
    for name in ('lateral_sensor', 'yaw_sensor'):
        graph.start(name, port=graph.port)
    # These tests look at the detector: nothing shall slow the roller down.
    graph.start('roller_speed', port=graph.port, interlock="'off'")


def test_a_bump_beyond_the_basin_is_escaping_then_a_limit_cycle_and_stays_an_alarm(graph) -> None:
    events, statuses = graph.told('hunting/events'), graph.told('hunting/status')
    amplitudes = graph.collect(JointState, 'hunting/amplitude')
    health = graph.collect(DiagnosticArray, '/diagnostics')
    logged = graph.collect(Log, '/rosout')
    graph.start('hunting_detector', FORM)
    graph.spin_until(lambda: statuses)
    assert statuses.last['level'] == 'STALE', 'no data must not look like a quiet rig'
    _start_rig(graph, initial_speed_mps=7.2, kick_m=0.0006)
    graph.spin_until(
        lambda: statuses.last['region'] == 'hysteresis' and statuses.last['level'] == 'WARN', 60.0
    )
    assert statuses.last['alarm'] == 'False'
    assert graph.call('simulator/kick').success
    graph.spin_until(lambda: 'limit_cycle' in events.events, 60.0)
    assert events.events.index('escaping') < events.events.index('limit_cycle')
    graph.spin_until(lambda: statuses.last['level'] == 'ERROR')
    assert statuses.last['alarm'] == 'True'
    assert amplitudes[-1].position[0] == pytest.approx(0.63e-3, rel=0.05)

    def alarming() -> bool:
        told = {status.name: status.level for message in health[-20:] for status in message.status}
        said = told.get('rig/hunting_alarm'), told.get('rig/hunting_detector')
        return said == (DiagnosticStatus.ERROR, DiagnosticStatus.OK)

    graph.spin_until(alarming)  # what a monitor of /diagnostics shows
    assert all(status.hardware_id for message in health for status in message.status)
    words = ('hunting_detector', 'limit_cycle')
    graph.spin_until(
        lambda: any(m.name.endswith(words[0]) and m.msg.startswith(words[1]) for m in logged)
    )
    assert graph.call('hunting/acknowledge_alarm').success
    graph.spin(0.5)
    assert statuses.last['alarm'] == 'True', 'the rig still hunts'


def test_a_sweep_is_recorded_refitted_and_the_form_taken_over_without_a_restart(graph) -> None:
    events, statuses = graph.told('hunting/events'), graph.told('hunting/status')
    closed = graph.collect(String, 'recording/closed', latched())
    forms = graph.collect(String, 'hunting/normal_form', latched())
    recordings = graph.folder / 'recordings'
    simulated = {'use_sim_time': True}
    # In fast simulated time a short pause of the machine is a long one of the rig.
    patience = {'sensor_timeout_s': 3.0}
    graph.start('hunting_detector', output_rate_hz=20.0, **patience, **simulated)
    graph.start('bag_recorder', directory=recordings, **simulated)
    graph.start('normal_form_identifier', directory=recordings, **simulated)
    graph.spin_until(lambda: graph.node.count_subscribers('/rig/lateral') == 2, 60.0)
    graph.start(
        'rig_simulator',
        port=graph.port,
        start_with_readers=3,
        time_scale=8.0,
        sample_rate_hz=100.0,
        initial_speed_mps=6.2,
        kick_times_s=[20.0, 50.0],
        kick_sizes_m=[0.00015, 0.00015],
    )
    for name in ('lateral_sensor', 'yaw_sensor'):
        graph.start(name, port=graph.port, **simulated)
    graph.start(
        'roller_speed',
        port=graph.port,
        profile=graph.profile(
            'corners: {times_s: [0, 5, 105, 125, 225], speeds_mps: [6.2, 6.2, 8.7, 8.7, 6.1]}'
        ),
        profile_autostart=True,
        interlock='measure',
        status_timeout_s=10.0,
        **simulated,
    )
    graph.spin_until(lambda: 'limit_cycle' in events.events, 120.0)
    graph.spin_until(lambda: 'quiet' in events.events, 120.0)
    assert graph.call('recording/stop', 60.0).success
    graph.spin_until(lambda: forms, 120.0)
    form = IdentifiedNormalForm.from_yaml(forms[-1].data).form
    assert form.criticality == 'subcritical'
    assert form.nonlinear_critical_speed == pytest.approx(6.433, abs=0.15)
    assert form.critical_speed == pytest.approx(8.0, abs=0.4)
    assert (recordings / 'normal_form.yaml').read_text() == forms[-1].data
    assert Path(closed[-1].data).is_dir()
    graph.spin_until(lambda: statuses.last['region'] == 'stable', 60.0)


def test_a_replay_of_a_recorded_run_gives_the_live_numbers_bit_for_bit(graph) -> None:
    events, statuses = graph.told('hunting/events'), graph.told('hunting/status')
    closed = graph.collect(String, 'recording/closed', latched())
    recordings = graph.folder / 'recordings'
    graph.start('hunting_detector', FORM)
    graph.start('bag_recorder', directory=recordings, record_estimates=True)
    graph.spin_until(lambda: graph.node.count_subscribers('/rig/lateral') == 2, 60.0)
    graph.start_rig(initial_speed_mps=7.2, kick_m=0.0004)
    graph.spin_until(lambda: statuses.last.get('region') == 'hysteresis', 60.0)
    graph.spin(3.0)
    assert graph.call('simulator/kick').success
    graph.spin_until(lambda: 'escaping' in events.events, 30.0)
    # Silence has to be repeated too.
    graph.change_state('yaw_sensor', Transition.TRANSITION_DEACTIVATE)
    graph.spin_until(lambda: 'input_stale' in events.events)
    graph.change_state('yaw_sensor', Transition.TRANSITION_ACTIVATE)
    graph.spin_until(lambda: 'input_recovered' in events.events)
    graph.spin(1.0)
    assert graph.call('recording/stop').success
    graph.spin_until(lambda: closed)

    bag = Path(closed[-1].data)
    live = recorded_run(bag)
    assert live is not None
    output = replay_journal(HuntingDetector(live.config), read_record(bag), live.journal)
    rows = output.estimates
    recorded = read_columns(
        bag,
        {
            'lateral': ChannelSource('lateral', 'hunting/amplitude.position[0]'),
            'yaw': ChannelSource('yaw', 'hunting/amplitude.position[1]'),
        },
    )
    stamps = recorded['lateral'].stamps_ns
    assert len(stamps) > 300
    at = np.searchsorted(rows['stamp_ns'], stamps)
    assert (rows['stamp_ns'][at] == stamps).all()
    for channel in ('lateral', 'yaw'):
        expected = rows[f'{channel}_amplitude'][at]
        assert recorded[channel].values.tobytes() == expected.tobytes()
    assert 'escaping' in [event.event for event in output.events]


def test_a_live_replay_speaks_as_the_rig_and_refuses_its_company(graph) -> None:
    stamps = 1_700_000_000_000_000_000 + 5_000_000 * np.arange(400)
    series = {name: Series(stamps, 1e-4 * np.arange(400.0)) for name in ('lateral', 'speed')}
    bag = write_record(graph.folder / 'bag', Record(series))
    lateral = graph.collect(JointState, 'lateral')
    graph.start('live_replay', bag=bag, rate=2.0)
    graph.spin_until(lambda: len(lateral) == 400)
    assert [to_ns(message.header.stamp) for message in lateral] == stamps.tolist()
    topics = dict(graph.node.get_publisher_names_and_types_by_node('live_replay', '/rig'))
    ours = {name for name in topics if not name.startswith(('/parameter', '/rosout', '/diag'))}
    assert ours == {'/clock', '/rig/lateral', '/rig/speed'}
    graph.end('live_replay')
    graph.node.create_publisher(JointState, 'lateral', 10)
    graph.start('live_replay', bag=bag)
    assert graph.wait('live_replay') == 2
    assert '/rig/lateral is published by' in graph.log('live_replay').read_text()


def test_a_railway_criterion_beside_the_detector_speaks_on_its_own_topic(graph) -> None:
    verdicts = graph.told('hunting/criteria')
    graph.start('hunting_detector', criteria='[cfr_213_333]', criteria_scale=0.02)
    graph.spin_until(lambda: graph.node.count_publishers('/rig/hunting/criteria') == 1, 60.0)
    _start_rig(graph, initial_speed_mps=8.8, kick_m=0.0006)
    graph.spin(2.0)
    assert graph.call('simulator/kick').success
    graph.spin_until(lambda: verdicts, 60.0)
    verdict = verdicts[0]
    assert (verdict['name'], verdict['exceeded']) == ('cfr_213_333', 'True')
    assert float(verdict['index']) > float(verdict['limit'])
