"""The detector node: alarms that outlast it, what it hears, forms of other rigs, its threads."""

from __future__ import annotations

import json
import time
from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from made import PAPER
from processes import Wheelset, joint
from rcl_interfaces.msg import Log
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from hunt_ros.cli.main import main
from hunt_ros.detection import Companions
from hunt_ros.drivers.interlock import Interlock, InterlockSettings
from hunt_ros.nodes.hunting_detector import HuntingDetectorNode
from hunt_ros.nodes.support.conversions import heard_of
from hunt_ros.nodes.support.qos import STATUS, latched


def test_an_alarm_lasts_while_settings_change_and_is_acknowledged(
    graph, resident, monkeypatch
) -> None:
    unexpected, update = [ZeroDivisionError('nobody expected this')], Companions.update

    def failing(companions: Companions, motion: np.ndarray) -> tuple:
        if unexpected:
            raise unexpected.pop()
        return update(companions, motion)

    monkeypatch.setattr(Companions, 'update', failing)
    Wheelset(graph, 3e-4, noise=0.0)
    statuses, events = graph.told('hunting/status'), graph.told('hunting/events')
    log: list[Log] = graph.collect(Log, '/rosout')
    health = graph.collect(DiagnosticArray, '/diagnostics')
    criterion = {'criteria': '[cfr_213_333]', 'criteria_scale': 0.001}
    node = resident(HuntingDetectorNode, channels='[lateral, speed]', **criterion)
    graph.spin_until(lambda: statuses.last.get('state') == 'limit_cycle')
    graph.spin_until(lambda: 'limit_cycle' in events.events)
    event = events[events.events.index('limit_cycle')]
    graph.spin_until(lambda: 'criterion_exceeded' in events.events)
    assert events[events.events.index('criterion_exceeded')]['test'] == 'cfr_213_333'
    assert 'stays as that of a limit cycle does' in event['cause']
    assert float(event['since_s']) > 0.0

    # What runs beside the detector has failed once: that is told, and the next samples are judged.
    failed = 'criteria and forecast failed: ZeroDivisionError: nobody expected this'
    graph.spin_until(lambda: any(failed in each.message for m in health for each in m.status))
    node._diagnostics.done('criteria and forecast')

    assert not graph.set_parameters('hunting_detector', critical_speed_mps=7.0)
    graph.spin_until(lambda: statuses.last['region'] == 'unstable')
    assert statuses.last['alarm'] == 'True'
    assert statuses.last['state'] == 'limit_cycle'

    def monitored() -> dict[str, bytes]:
        return {each.name: each.level for message in health[-2:] for each in message.status}

    # What a monitor shows: the detector is well, and the rig is not.
    levels = {'rig/hunting_alarm': DiagnosticStatus.ERROR, 'rig/hunting_detector': b'\0'}
    graph.spin_until(lambda: monitored().items() >= levels.items())
    assert all(each.hardware_id for message in health for each in message.status)
    assert main(['call', 'acknowledge', 'Mia  Lopez']) == 0
    again = graph.call('hunting/acknowledge_alarm')
    assert (again.success, again.message) == (True, 'there was no alarm to acknowledge')
    graph.spin_until(lambda: statuses.last['level'] == 'ERROR')
    status = statuses.last
    assert status['alarm'] == 'True', 'it still hunts'
    assert status['message'].startswith('limit cycle')
    assert status['alarm_count'] == '1'
    assert float(status['hunting_hours']) > 0.0
    assert float(status['highest_amplitude_m']) == pytest.approx(3e-4, rel=0.05)

    graph.spin_until(lambda: 'acknowledged' in events.events)
    assert events[events.events.index('acknowledged')]['cause'].startswith('by Mia Lopez')
    latest = graph.collect(String, 'hunting/alarms', latched())
    graph.spin_until(lambda: latest and 'Mia' in latest[-1].data)
    (alarm,) = json.loads(latest[-1].data)['alarms']
    assert alarm['acknowledged_by'] == 'Mia Lopez'
    assert alarm['cause'] == event['cause']
    assert alarm['began_s'] == pytest.approx(float(event['since_s']), abs=2e-3)

    def lines(begin: str) -> list[Log]:
        return [line for line in log if line.msg.startswith(begin)]

    # Each transition once on /rosout, as severe as it is.
    graph.spin_until(lambda: lines('acknowledged at'))
    assert [line.level for line in lines('limit_cycle at')] == [Log.ERROR]


def test_a_driver_with_the_profile_of_sensor_data_is_heard_if_told_so_and_named_if_not(
    graph, resident
) -> None:
    health = graph.told()
    publishers = [
        graph.node.create_publisher(JointState, channel, qos_profile_sensor_data)
        for channel in ('lateral', 'yaw')
    ]
    resident(
        HuntingDetectorNode,
        **{'qos_overrides./rig/lateral.subscription.reliability': 'best_effort'},
    )
    sent = 0

    def told() -> dict[str, str]:
        nonlocal sent
        sent += 1
        for publisher, name in zip(publishers, ('lateral', 'yaw'), strict=True):
            publisher.publish(joint(name, 1_000_000_000 + sent * 10_000_000, 1e-6 * sent))
        return health.last

    graph.spin_until(lambda: int(told().get('received', 0)) > 0)
    graph.spin_until(lambda: '/rig/yaw is published with best effort' in told()['message'])
    text = told()['message']
    assert 'qos_overrides./rig/yaw.subscription.reliability' in text
    assert '/rig/lateral is published' not in text
    # As of a killed node and the one that was started in its place.
    second = graph.node.create_publisher(JointState, 'lateral', qos_profile_sensor_data)
    other = graph.beside('other')
    other.create_publisher(JointState, 'lateral', qos_profile_sensor_data)
    graph.spin_until(lambda: '/rig/lateral has 2 publishers' in told()['message'])
    assert '/rig/other' in told()['message']
    assert told()['level'] != 'OK'
    other.destroy_node()
    graph.node.destroy_publisher(second)


def test_it_does_not_begin_with_the_form_of_another_rig_nor_take_it_over(graph) -> None:
    """That would call the wrong speeds safe."""
    forms = {name: replace(PAPER, rig_name=name).to_yaml() for name in 'AB'}
    path = graph.folder / 'A.yaml'
    path.write_text(forms['A'])
    log = graph.log('hunting_detector')
    graph.start('hunting_detector', path, rig_name='B')
    assert graph.wait('hunting_detector') == 2
    assert "identified on rig 'A', expected 'B'" in log.read_text()

    statuses = graph.told('hunting/status')
    graph.start('hunting_detector', rig_name='B')
    graph.spin_until(lambda: statuses)
    publisher = graph.node.create_publisher(String, 'hunting/normal_form', latched())
    publisher.publish(String(data=forms['A']))
    graph.spin_until(lambda: 'the form in force stays' in log.read_text())
    assert statuses.last.get('v_n_mps', 'nan') in ('nan', '')
    publisher.publish(String(data=forms['B']))
    graph.spin_until(lambda: statuses.last.get('v_n_mps', 'nan').startswith('6.4'))


def test_a_guard_does_not_wait_for_a_detector_that_starts_beside_a_limit_cycle(graph) -> None:
    """Its form calls the speed safe, and it has not seen the quiet motion."""
    path = graph.folder / 'form.yaml'
    path.write_text(PAPER.to_yaml().replace('v_c: 8.0', 'v_c: 12.0'))
    Wheelset(graph, 6.6e-4)
    guard, causes = Interlock(InterlockSettings(status_timeout_s=60.0)), []
    guard.lost = ''

    def hear(message: DiagnosticArray) -> None:
        guard.hear(time.monotonic_ns(), heard_of(message))
        change = guard.judge(time.monotonic_ns())
        causes.extend([change.cause] if change else [])

    graph.node.create_subscription(DiagnosticArray, 'hunting/status', hear, STATUS)
    graph.start('hunting_detector', path)
    graph.spin_until(lambda: causes, 60.0)
    # Whichever is first: the cycle is decided about as soon as the guard has waited enough.
    assert causes[0].startswith(('not known for ', 'the detector says ERROR: limit cycle'))
