"""The node that calls somebody, on a detector that alarms, recovers and falls silent."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray

from hunt_ros.nodes.support.conversions import diagnostic, read_diagnostic
from hunt_ros.nodes.support.qos import STATUS

pytestmark = pytest.mark.ros


def test_it_calls_for_an_alarm_and_for_silence_and_a_cut_relay_harms_no_other(
    graph, modbus_server, tmp_path
) -> None:
    program, log = tmp_path / 'notify', tmp_path / 'log'
    program.write_text(f'#!/bin/sh\necho "$1: $2" >> {log}\n')
    program.chmod(0o755)
    health = graph.collect(DiagnosticArray, '/diagnostics')
    publisher = graph.node.create_publisher(DiagnosticArray, 'hunting/status', STATUS)
    graph.start(
        'alarm_outputs',
        command=program,
        relay_coil=5,
        port=modbus_server.port,
        silence_s=graph.machine.slowness * 2.0,
    )

    def said() -> list[str]:
        return log.read_text().splitlines() if log.exists() else []

    def publish_until(level: str, alarm: bool, done) -> None:
        def step() -> bool:
            publisher.publish(diagnostic(0, 'hunting', level, 'why', {'alarm': alarm}, 'rig'))
            return done()

        graph.spin_until(step)

    def coil() -> list[bool]:
        return [bool(values[0]) for _, values in modbus_server.written]

    publish_until('OK', False, lambda: said() and coil())
    assert said() == ['well: OK: why']
    assert coil()[-1] is False
    publish_until('ERROR', True, lambda: len(said()) > 1 and coil()[-1])
    assert said()[1:] == ['alarm: ERROR: why']
    modbus_server.stop()
    publish_until('WARN', True, lambda: _told(health, 'ERROR', 'relay: modbus tcp'))
    assert said()[2:] == [], 'an alarm that nobody has acknowledged is one'
    publish_until('WARN', False, lambda: len(said()) > 2)
    assert said()[2:] == ['well: WARN: why']
    modbus_server.start()
    count = len(coil())
    publish_until('OK', False, lambda: len(coil()) > count)
    assert coil()[-1] is False
    graph.spin_until(lambda: len(said()) > 3)
    assert said()[3].startswith('doubt: no status for')
    graph.spin_until(lambda: coil()[-1])
    assert graph.end('alarm_outputs') == 0
    assert coil()[-1] is False, 'a relay is switched off with the node'


def _told(health: list, level: str, words: str) -> bool:
    texts = [read_diagnostic(message) for message in health]
    return any(text['level'] == level and words in text['message'] for text in texts)


@pytest.mark.parametrize(
    ('parameters', 'words'),
    [
        ({}, 'none of sound, command and relay_coil'),
        ({'command': '/nowhere/notify'}, "no program '/nowhere/notify'"),
        ({'relay_coil': 70000}, 'relay_coil'),
    ],
)
def test_outputs_that_cannot_be_are_one_line(graph, parameters, words) -> None:
    graph.start('alarm_outputs', **parameters)
    assert graph.wait('alarm_outputs') == 2
    _, line = graph.log('alarm_outputs').read_text().strip().splitlines()
    assert words in line
