"""The whole chain on real rclpy: simulated rig, sensors, speed, detector, recorder, identifier."""

from __future__ import annotations

from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.nodes.support.qos import latched

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
