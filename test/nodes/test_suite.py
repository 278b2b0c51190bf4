"""The whole chain on real rclpy: simulated rig, sensors, speed, detector, recorder, identifier."""

from __future__ import annotations

from pathlib import Path

import pytest
from std_msgs.msg import String

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.nodes.support.qos import latched

pytestmark = pytest.mark.slow


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
