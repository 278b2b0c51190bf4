"""The node that calls somebody, on a detector that alarms, recovers and falls silent."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import Trigger

from hunt_ros.nodes.support.conversions import diagnostic
from hunt_ros.nodes.support.qos import EVENTS, STATUS, latched


@pytest.mark.slow
def test_it_calls_for_an_alarm_and_for_silence_and_a_cut_relay_harms_no_other(
    graph, modbus_server, called
) -> None:
    calls = called()
    health = graph.told()
    publisher = graph.node.create_publisher(DiagnosticArray, 'hunting/status', STATUS)
    graph.start(
        'alarm_outputs',
        command=calls.program,
        relay_coil=5,
        port=modbus_server.port,
        silence_s=graph.machine.slowness * 2.0,
    )

    def publish_until(level: str, alarm: bool, done) -> None:
        def step() -> bool:
            publisher.publish(diagnostic(0, 'hunting', level, 'why', {'alarm': alarm}, 'rig'))
            return done()

        graph.spin_until(step)

    def coil() -> list[bool]:
        return [bool(values[0]) for _, values in modbus_server.written]

    publish_until('OK', False, lambda: calls() and coil())
    assert calls() == ['well: OK: why']
    assert coil()[-1] is False
    publish_until('ERROR', True, lambda: len(calls()) > 1 and coil()[-1])
    assert calls()[1:] == ['alarm: ERROR: why']
    modbus_server.stop()
    publish_until('WARN', True, lambda: health.says('relay: modbus tcp', level='ERROR'))
    assert calls()[2:] == [], 'an alarm that nobody has acknowledged is one'
    publish_until('WARN', False, lambda: len(calls()) > 2)
    assert calls()[2:] == ['well: WARN: why']
    modbus_server.start()
    count = len(coil())
    publish_until('OK', False, lambda: len(coil()) > count)
    assert coil()[-1] is False
    graph.spin_until(lambda: len(calls()) > 3)
    assert calls()[3].startswith('doubt: no status for')
    graph.spin_until(lambda: coil()[-1])
    assert graph.end('alarm_outputs') == 0
    assert coil()[-1] is False, 'a relay is switched off with the node'


def test_a_detector_that_never_comes_is_a_doubt_and_what_fails_is_tried_again(
    resident, graph, called, tmp_path, monkeypatch
) -> None:
    from hunt_ros.nodes import alarm_outputs

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
    graph.spin_until(lambda: health.says('command: ', level='ERROR'))
    (tmp_path / 'network').touch()
    health.clear()
    graph.spin_until(lambda: health.says('doubt', level='OK'))
    count = len(calls())
    graph.spin(1.0)
    assert len(calls()) == count, 'somebody has been called'


def test_a_test_has_every_output_call_and_says_what_does_not(graph, called, tmp_path) -> None:
    calls = called(f'[ ! -e {tmp_path}/broken ]')
    publisher = graph.node.create_publisher(DiagnosticArray, 'hunting/status', STATUS)
    proof = tmp_path / 'tested'
    health = graph.told()
    graph.start(
        'alarm_outputs',
        command=calls.program,
        silence_s=graph.machine.slowness * 5.0,
        tested_file=proof,
    )
    assert not graph.call('alarm/test').success, 'the detector is not heard'
    client = graph.client(Trigger, 'alarm/test')

    def asked() -> Trigger.Response:
        future = client.call_async(Trigger.Request())

        def step() -> bool:
            publisher.publish(diagnostic(0, 'hunting', 'OK', 'why', {'alarm': False}, 'rig'))
            return future.done()

        graph.spin_until(step)
        return future.result()

    graph.spin_until(lambda: asked().success)
    assert any('alarm: test of the alarm' in call for call in calls())
    assert 'command called, and the detector is heard; last test before: 2' in asked().message
    assert proof.exists(), 'when it was done outlives the process'
    graph.spin_until(lambda: health.says('tested from detector to output: 2', level='OK'))
    (tmp_path / 'broken').touch()
    answer = asked()
    assert not answer.success
    assert 'command: ' in answer.message


def test_an_acknowledgement_silences_the_sound_and_nothing_else(
    resident, graph, called, monkeypatch
) -> None:
    from hunt_ros.drivers.alarm_output import Sound
    from hunt_ros.nodes.alarm_outputs import AlarmOutputsNode

    monkeypatch.setattr(Sound, 'repeat_s', 0.1)
    horn, calls = called(name='horn'), called()
    health = graph.told()
    events = graph.node.create_publisher(DiagnosticArray, 'hunting/events', EVENTS)
    drive = graph.node.create_publisher(DiagnosticArray, 'speed/status', latched())
    drive.publish(diagnostic(0, 'roller_speed', 'OK', '', {'alarm_kept': 'it hunted'}, ''))
    resident(AlarmOutputsNode, sound=horn.program, command=calls.program)

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
