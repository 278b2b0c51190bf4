"""The suite on a simulated rig that is faster than a real one, and how its time goes."""

from __future__ import annotations

from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.nodes import rig_simulator
from hunt_ros.nodes.support.conversions import diagnostic, to_ns
from hunt_ros.nodes.support.qos import STATUS, latched, stream

FORM = Path(__file__).parents[2] / 'bags' / 'paper.yaml'
_S = 1_000_000_000
_FOLLOWS = {'use_sim_time': True}
#: In fast simulated time a short pause of the machine is a long one of the rig.
_DETECTOR = {'sensor_timeout_s': 3.0, **_FOLLOWS}
_FAST = {'time_scale': 8.0, 'start_with_readers': 3}


def _start_sources(graph, **drive: object) -> None:
    for name in ('lateral_sensor', 'yaw_sensor'):
        graph.start(name, port=graph.port, **_FOLLOWS)
    graph.start('roller_speed', port=graph.port, profile_autostart=True, **drive, **_FOLLOWS)


@pytest.mark.slow
def test_a_sweep_is_recorded_refitted_and_the_form_taken_over_without_a_restart(graph) -> None:
    events, statuses = graph.told('hunting/events'), graph.told('hunting/status')
    closed = graph.collect(String, 'recording/closed', latched())
    forms = graph.collect(String, 'hunting/normal_form', latched())
    recordings = graph.folder / 'recordings'
    graph.start('hunting_detector', output_rate_hz=20.0, **_DETECTOR)
    for name in ('bag_recorder', 'normal_form_identifier'):
        graph.start(name, directory=recordings, **_FOLLOWS)
    graph.spin_until(lambda: graph.node.count_subscribers('/rig/lateral') == 2, 60.0)
    kicks = {'kicks': [20.0, 0.00015, 50.0, 0.00015]}
    rig = {'sample_rate_hz': 100.0, 'initial_speed_mps': 6.2, **kicks}
    graph.start('rig_simulator', port=graph.port, **rig, **_FAST)
    sweep = 'corners: {times_s: [0, 5, 105, 125, 225], speeds_mps: [6.2, 6.2, 8.7, 8.7, 6.1]}'
    profile = graph.profile(sweep)
    _start_sources(graph, profile=profile, interlock='measure', status_timeout_s=10.0)
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


@pytest.mark.parametrize('form', [FORM, None], ids=['a form', 'no form'])
def test_a_climb_goes_up_where_a_form_clears_it_and_back_without_one(
    graph, resident, monkeypatch, form
) -> None:
    # Nobody is taken for dead: samples that nobody heard yet do not leave all waiting.
    monkeypatch.setattr(rig_simulator, '_DEAD_S', 1e9)
    said = graph.told('hunting/status', STATUS)
    drive = graph.told('speed/status', latched())
    graph.start('hunting_detector', *([form] if form else []), **_DETECTOR)
    graph.spin_until(lambda: said, 60.0)
    rig = {'sample_rate_hz': 200.0, 'initial_speed_mps': 6.0}
    resident(rig_simulator.RigSimulatorNode, port=graph.port, **rig, **_FAST)
    climb = 'climb: {low_mps: 6.0, high_mps: 7.0, step_mps: 1.0, rate_mps2: 0.5, wait_s: 60}'
    profile = graph.profile(climb)
    _start_sources(graph, profile=profile, slow_down_at_end=False, interlock="'off'")
    graph.spin_until(lambda: drive.last.get('profile_state') == 'finished', 120.0)
    if form is None:
        assert not any(' is cleared' in one['clearance'] for one in said)
        assert '6 m/s is not cleared (margin not known' in graph.log('roller_speed').read_text()
        assert not any(float(one['speed_mps']) > 6.2 for one in drive)
    else:
        words = dict.fromkeys(one['clearance'] for one in said)
        assert any(one.startswith('7.0') and ' is cleared' in one for one in words), words
        assert float(drive.last['target_mps']) == pytest.approx(7.0)


def test_simulated_time_begins_with_the_detector_and_waits_for_its_first_estimate(graph) -> None:
    times = graph.collect(Clock, '/clock', stream(10))
    status = graph.node.create_publisher(DiagnosticArray, 'hunting/status', STATUS)
    rig = {'time_scale': 50.0, 'sample_rate_hz': 100.0}
    graph.start('rig_simulator', port=graph.port, **rig)
    graph.spin_until(status.get_subscription_count, 60.0)
    graph.spin(0.5)
    assert not times

    def nothing_judged_yet() -> bool:
        status.publish(diagnostic(0, 'hunting', 'STALE', '', {}, 'rig'))
        return bool(times)

    graph.spin_until(nothing_judged_yet, 60.0)
    graph.spin(0.5)  # 25 s of the rig
    assert to_ns(times[-1].clock) < 4 * _S


def test_simulated_time_creeps_on_and_a_dead_detector_is_not_waited_for(graph) -> None:
    now_s = 0.0
    pace = rig_simulator.Pace(graph.node, lambda: now_s)
    status = graph.node.create_publisher(DiagnosticArray, 'hunting/status', STATUS)
    status.publish(diagnostic(10 * _S, 'hunting', 'OK', '', {}, 'rig'))
    graph.spin_until(lambda: pace.heard)
    assert not pace.must_wait(round(10.9 * _S))
    assert pace.must_wait(round(11.1 * _S))
    now_s = 6.0
    assert not pace.must_wait(round(11.1 * _S))
    assert pace.must_wait(round(11.3 * _S))
    now_s = 59.0
    assert pace.must_wait(13 * _S), 'the patience of the demo with a sensor'
    now_s = 61.0
    assert not pace.must_wait(13 * _S)
