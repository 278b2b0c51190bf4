"""A profile climbs as far as the detector clears it, and goes back: on real nodes and a rig."""

from __future__ import annotations

from pathlib import Path

import pytest

from hunt_ros.nodes.support.qos import STATUS, latched

FORM = Path(__file__).parents[2] / 'bags' / 'paper.yaml'


@pytest.mark.parametrize('form', [FORM, None], ids=['a form', 'no form'])
def test_a_climb_goes_up_where_a_form_clears_it_and_back_without_one(graph, form) -> None:
    said = graph.told('hunting/status', STATUS)
    drive = graph.told('speed/status', latched())
    follows = {'use_sim_time': True}
    graph.start('hunting_detector', *([form] if form else []), sensor_timeout_s=3.0, **follows)
    graph.spin_until(lambda: said, 60.0)
    fast = {'time_scale': 8.0, 'start_with_readers': 3, 'start_with_detector': True}
    graph.start(
        'rig_simulator', port=graph.port, sample_rate_hz=200.0, initial_speed_mps=6.0, **fast
    )
    for name in ('lateral_sensor', 'yaw_sensor'):
        graph.start(name, port=graph.port, **follows)
    climb = 'climb: {low_mps: 6.0, high_mps: 7.0, step_mps: 1.0, rate_mps2: 0.5, wait_s: 60}'
    graph.start(
        'roller_speed', port=graph.port, slow_down_at_end=False, interlock="'off'",
        profile=graph.profile(climb), profile_autostart=True, **follows,
    )  # fmt: skip
    graph.spin_until(lambda: drive.last.get('profile_state') == 'finished', 120.0)
    if form is None:
        assert not any(' is cleared' in one['clearance'] for one in said)
        assert '6 m/s is not cleared (margin not known' in graph.log('roller_speed').read_text()
        assert not any(float(one['speed_mps']) > 6.2 for one in drive)
    else:
        words = dict.fromkeys(one['clearance'] for one in said)
        assert any(one.startswith('7.0') and ' is cleared' in one for one in words), words
        assert float(drive.last['target_mps']) == pytest.approx(7.0)
