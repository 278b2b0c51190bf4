"""Simulated time goes no further than the detector can follow."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from rosgraph_msgs.msg import Clock

from hunt_ros.nodes.rig_simulator import Pace
from hunt_ros.nodes.support.conversions import diagnostic, to_ns
from hunt_ros.nodes.support.qos import STATUS, stream

_S = 1_000_000_000


def test_simulated_time_begins_with_the_detector_and_waits_for_its_first_estimate(graph) -> None:
    times = graph.collect(Clock, '/clock', stream(10))
    status = graph.node.create_publisher(DiagnosticArray, 'hunting/status', STATUS)
    rig = {'time_scale': 50.0, 'sample_rate_hz': 100.0, 'start_with_detector': True}
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
    pace = Pace(graph.node, lambda: now_s)
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


def test_samples_that_nobody_heard_yet_do_not_leave_all_waiting(
    graph, resident, monkeypatch
) -> None:
    from hunt_ros.nodes import rig_simulator

    monkeypatch.setattr(rig_simulator, '_DEAD_S', 1e9)
    statuses = graph.collect(DiagnosticArray, 'hunting/status', STATUS)
    follows = {'use_sim_time': True}
    graph.start('hunting_detector', sensor_timeout_s=3.0, **follows)
    graph.spin_until(lambda: statuses, 60.0)
    fast = {'time_scale': 8.0, 'start_with_readers': 3, 'start_with_detector': True}
    resident(rig_simulator.RigSimulatorNode, port=graph.port, sample_rate_hz=200.0, **fast)
    # The drivers are connected, and only then the listeners are waited for.
    for name in ('lateral_sensor', 'yaw_sensor'):
        graph.start(name, port=graph.port, **follows)
    graph.start('roller_speed', port=graph.port, slow_down_at_end=False, **follows)
    graph.spin_until(lambda: to_ns(statuses[-1].header.stamp) > 5 * _S, 60.0)
