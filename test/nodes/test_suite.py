"""The whole chain on real rclpy: simulated rig, sensors, speed, detector, recorder, identifier."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from hunt_ros.bag import read_record
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.nodes.conversions import read_diagnostic, to_ns
from hunt_ros.nodes.qos import latched

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def _form_file(folder: Path) -> Path:
    path = folder / 'normal_form.yaml'
    path.write_text(IdentifiedNormalForm(PAPER_NORMAL_FORM).to_yaml())
    return path


def _start_rig(graph, **simulator: object) -> None:
    graph.start('rig_simulator', port=graph.port, start_with_readers=3, **simulator)
    for name in ('lateral_sensor', 'yaw_sensor', 'roller_speed'):
        graph.start(name, port=graph.port)


class Heard:
    """What the detector says, as texts."""

    def __init__(self, graph) -> None:
        self._events = graph.collect(DiagnosticArray, 'hunting/events')
        self._statuses = graph.collect(DiagnosticArray, 'hunting/status')

    @property
    def events(self) -> list[str]:
        return [read_diagnostic(message)['event'] for message in self._events]

    @property
    def status(self) -> dict[str, str]:
        return read_diagnostic(self._statuses[-1]) if self._statuses else {}


def test_a_bump_beyond_the_basin_is_escaping_then_a_limit_cycle_and_stays_an_alarm(graph) -> None:
    heard = Heard(graph)
    amplitudes = graph.collect(JointState, 'hunting/amplitude')
    graph.start('hunting_detector', _form_file(graph.folder))
    graph.spin_until(lambda: heard.status)
    assert heard.status['level'] == 'STALE', 'no data must not look like a quiet rig'
    _start_rig(graph, initial_speed_mps=7.2, kick_m=0.0006)
    graph.spin_until(
        lambda: heard.status['region'] == 'hysteresis' and heard.status['level'] == 'WARN', 60.0
    )
    assert heard.status['alarm'] == 'False'
    assert graph.call('simulator/kick').success
    graph.spin_until(lambda: 'limit_cycle' in heard.events, 60.0)
    assert heard.events.index('escaping') < heard.events.index('limit_cycle')
    graph.spin_until(lambda: heard.status['level'] == 'ERROR')
    assert heard.status['alarm'] == 'True'
    assert amplitudes[-1].position[0] == pytest.approx(0.63e-3, rel=0.05)
    assert graph.call('hunting/acknowledge_alarm').success
    graph.spin(0.5)
    assert heard.status['alarm'] == 'True', 'the rig still hunts'


def test_silence_is_stale_and_recovers_by_itself(graph) -> None:
    heard = Heard(graph)
    graph.start('hunting_detector', _form_file(graph.folder))
    _start_rig(graph, initial_speed_mps=6.2)
    graph.spin_until(lambda: heard.status.get('level') == 'OK', 60.0)
    graph.end('lateral_sensor')
    graph.spin_until(lambda: heard.status['level'] != 'OK', 5.0)
    assert 'lateral' in heard.status['message']
    graph.start('lateral_sensor', port=graph.port)
    graph.spin_until(lambda: heard.status['level'] == 'OK', 60.0)


def test_a_recorder_killed_at_once_leaves_all_but_the_last_second(graph) -> None:
    lateral = graph.collect(JointState, 'lateral')
    recordings = graph.folder / 'recordings'
    graph.start('bag_recorder', directory=recordings)
    _start_rig(graph, initial_speed_mps=6.5)
    graph.spin_until(lambda: len(lateral) > 2000, 60.0)
    assert graph.end('bag_recorder', signal.SIGKILL) == -signal.SIGKILL
    last_ns = to_ns(lateral[-1].header.stamp)
    (active,) = recordings.glob('*.active')
    record = read_record(active)
    assert record['lateral'].stamps_ns[0] <= to_ns(lateral[0].header.stamp)
    assert last_ns - record['lateral'].stamps_ns[-1] < 1_500_000_000
    assert (record['lateral'].stamps_ns[1:] > record['lateral'].stamps_ns[:-1]).all()


def test_a_sweep_is_recorded_refitted_and_the_form_taken_over_without_a_restart(graph) -> None:
    heard = Heard(graph)
    closed = graph.collect(String, 'recording/closed', latched())
    forms = graph.collect(String, 'hunting/normal_form', latched())
    recordings = graph.folder / 'recordings'
    simulated = {'use_sim_time': True}
    patience = {'sensor_timeout_s': 5.0, 'roller_timeout_s': 5.0, 'speed_timeout_s': 5.0}
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
        profile_times_s=[0.0, 5.0, 105.0, 125.0, 225.0],
        profile_speeds_mps=[6.2, 6.2, 8.7, 8.7, 6.1],
        profile_autostart=True,
        **simulated,
    )
    graph.spin_until(lambda: 'limit_cycle' in heard.events, 120.0)
    graph.spin_until(lambda: 'quiet' in heard.events, 120.0)
    assert graph.call('recording/stop').success
    graph.spin_until(lambda: forms, 90.0)
    form = IdentifiedNormalForm.from_yaml(forms[-1].data).form
    assert form.criticality == 'subcritical'
    assert form.nonlinear_critical_speed == pytest.approx(6.433, abs=0.15)
    assert form.critical_speed == pytest.approx(8.0, abs=0.4)
    assert (recordings / 'normal_form.yaml').read_text() == forms[-1].data
    assert Path(closed[-1].data).is_dir()
    graph.spin_until(lambda: heard.status['region'] == 'stable', 30.0)
