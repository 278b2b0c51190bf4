"""The node that calls somebody, on a detector that alarms, recovers and falls silent."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray

from hunt_ros.drivers.alarm_output import Sound
from hunt_ros.nodes import alarm_outputs
from hunt_ros.nodes.support.conversions import diagnostic
from hunt_ros.nodes.support.qos import EVENTS, latched


@pytest.mark.slow
def test_it_calls_for_an_alarm_and_for_silence_and_a_cut_relay_harms_no_other(
    graph, detector, modbus_server, called
) -> None:
    calls = called()
    health = graph.told()
    silence_s = graph.machine.slowness * 2.0
    relay = {'relay_coil': 5, 'port': modbus_server.port}
    graph.start('alarm_outputs', command=calls.program, silence_s=silence_s, **relay)

    def coil() -> list[bool]:
        return [bool(values[0]) for _, values in modbus_server.written]

    graph.spin_until(lambda: calls() and coil())
    assert calls() == ['well: OK: its reasons']
    assert coil()[-1] is False
    detector.level, detector.alarm = 'ERROR', True
    graph.spin_until(lambda: len(calls()) > 1 and coil()[-1])
    assert calls()[1:] == ['alarm: ERROR: its reasons']
    modbus_server.stop()
    detector.level = 'WARN'
    graph.spin_until(lambda: health.says('relay failed: modbus tcp', level='ERROR'))
    assert calls()[2:] == [], 'an alarm that nobody has acknowledged is one'
    detector.alarm = False
    graph.spin_until(lambda: len(calls()) > 2)
    assert calls()[2:] == ['well: WARN: its reasons']
    modbus_server.start()
    count = len(coil())
    detector.level = 'OK'
    graph.spin_until(lambda: len(coil()) > count)
    assert coil()[-1] is False
    detector.silent = True
    graph.spin_until(lambda: len(calls()) > 3)
    assert calls()[3].startswith('doubt: no status for')
    graph.spin_until(lambda: coil()[-1])
    assert graph.end('alarm_outputs') == 0
    assert coil()[-1] is False, 'a relay is switched off with the node'


def test_a_detector_that_never_comes_is_a_doubt_and_what_fails_is_tried_again(
    resident, graph, called, tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr(alarm_outputs, '_AGAIN_S', 0.2)
    calls = called(f'[ -e {tmp_path}/network ]')
    health = graph.told()
    node = resident(alarm_outputs.AlarmOutputsNode, command=calls.program)
    graph.spin_until(lambda: health)
    assert not calls(), 'a suite that starts calls nobody'
    node._call._began_s -= 60.0  # as long as no start takes
    node._diagnostics._began_s -= 60.0
    graph.spin_until(lambda: len(calls()) > 2)
    assert calls()[0].startswith('doubt: no status since the start')
    graph.spin_until(lambda: health.says('command failed: ', level='ERROR'))
    (tmp_path / 'network').touch()
    health.clear()
    graph.spin_until(lambda: health.says('doubt', level='OK'))
    count = len(calls())
    graph.spin(1.0)
    assert len(calls()) == count, 'somebody has been called'


def test_a_test_has_every_output_call_and_says_what_does_not(
    graph, detector, called, tmp_path
) -> None:
    calls = called(f'[ ! -e {tmp_path}/broken ]')
    proof = tmp_path / 'tested'
    health = graph.told()
    detector.silent = True
    silence_s = graph.machine.slowness * 5.0
    graph.start('alarm_outputs', command=calls.program, silence_s=silence_s, tested_file=proof)
    assert not graph.call('alarm/test').success, 'the detector is not heard'
    detector.silent = False
    graph.spin_until(lambda: graph.call('alarm/test').success)
    assert any('alarm: test of the alarm' in call for call in calls())
    told = graph.call('alarm/test').message
    assert 'command called, and the detector is heard; last test before: 2' in told
    assert proof.exists(), 'when it was done outlives the process'
    graph.spin_until(lambda: health.says('tested from detector to output: 2', level='OK'))
    (tmp_path / 'broken').touch()
    answer = graph.call('alarm/test')
    assert not answer.success
    assert 'command: ' in answer.message


def test_an_acknowledgement_silences_the_sound_and_nothing_else(
    resident, graph, called, monkeypatch
) -> None:
    monkeypatch.setattr(Sound, 'repeat_s', 0.1)
    horn, calls = called(name='horn'), called()
    health = graph.told()
    events = graph.node.create_publisher(DiagnosticArray, 'hunting/events', EVENTS)
    drive = graph.node.create_publisher(DiagnosticArray, 'speed/status', latched())
    drive.publish(diagnostic(0, 'roller_speed', 'OK', '', {'alarm_kept': 'it hunted'}, ''))
    resident(alarm_outputs.AlarmOutputsNode, sound=horn.program, command=calls.program)

    def tell(event: str) -> None:
        events.publish(diagnostic(0, event, 'ERROR', 'why', {'event': event}, 'rig'))

    graph.spin_until(lambda: len(horn()) > 1 and events.get_subscription_count())
    graph.spin_until(lambda: health.says(condition='alarm', cause='it hunted'))
    tell('acknowledged')
    graph.spin_until(lambda: health.says(acknowledged='True'))
    before = -1
    while before != (before := len(horn())):  # one that was sounding ends
        graph.spin(1.0)
    tell('limit_cycle')
    graph.spin_until(lambda: len(horn()) > before + 1)
    assert calls() == ['alarm: it hunted'], 'an acknowledged alarm is one'


def test_it_calls_where_what_started_it_has_died(graph, called) -> None:
    """Then every node is interrupted, and this one is the last who can."""
    calls = called()
    health = graph.told()
    graph.orphan('alarm_outputs', lambda: health, command=calls.program)
    graph.spin_until(calls)
    assert calls() == ['doubt: what started the nodes has died: nobody watches the rig any more']


def test_nothing_takes_back_the_call_where_what_started_it_has_died(
    resident, graph, detector, called, monkeypatch
) -> None:
    """The speed node tells meanwhile that it ends, as it does where a person has asked for it."""
    calls = called()
    node = resident(alarm_outputs.AlarmOutputsNode, command=calls.program)
    graph.spin_until(calls)
    monkeypatch.setattr(alarm_outputs, 'abandoned', lambda: True)
    assert node.wind_down()
    for level in ('ERROR', 'OK'):
        detector.level = level
        graph.spin_until(lambda level=level: (node._call.condition.calls) == (level == 'ERROR'))
        graph.spin(0.3)
    assert [call.split(':')[0] for call in calls()] == ['well', 'doubt']
