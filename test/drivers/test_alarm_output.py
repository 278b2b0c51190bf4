"""Sound, command and relay, each for real; each failing with one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from hunt_ros.drivers.alarm_output import AlarmSettings, Call, Command, Condition, Relay, Sound
from hunt_ros.drivers.modbus import ModbusBus
from hunt_ros.errors import ConfigError, DriverError


@pytest.fixture
def program(tmp_path: Path):
    """Make a program of a few lines; what it writes stands in the file `log`."""

    def make(text: str) -> str:
        path = tmp_path / 'program'
        path.write_text(f'#!/bin/sh\n{text}\n')
        path.chmod(0o755)
        return str(path)

    make.log = tmp_path / 'log'
    return make


def test_a_command_gets_condition_and_cause_and_no_shell_reads_them(program) -> None:
    output = Command(f'{program(f"echo $# $1/$2/$3 >> {program.log}")} "two words"')
    output.show(Condition.ALARM, 'limit cycle; $(rm -r x)')
    output.show(Condition.WELL, '')
    assert program.log.read_text().splitlines() == [
        '3 two words/alarm/limit cycle; $(rm -r x)',
        '3 two words/well/',
    ]


def test_a_sound_is_played_while_somebody_must_come(program) -> None:
    output = Sound(program(f'echo played >> {program.log}'))
    for condition in Condition:
        output.show(condition, 'cause')
    assert program.log.read_text() == 2 * 'played\n'


@pytest.mark.parametrize(
    ('inverted', 'states'),
    [
        (False, [False, True, True, False]),  # an alarm of before is not taken back
        (True, [False, True, False, False, False]),
    ],
)
def test_a_relay_is_on_for_an_alarm_or_inverted_while_all_is_well(
    modbus_server, inverted, states
) -> None:
    relay = Relay(ModbusBus(port=modbus_server.port, timeout_s=5.0), 7, inverted)
    for condition in (Condition.WAITING, Condition.WELL, Condition.ALARM, Condition.DOUBT):
        relay.show(condition, 'cause')
    relay.close()
    assert modbus_server.written == [(7, [state]) for state in states]


def test_a_command_that_fails_or_hangs_is_one_line(program) -> None:
    output = Command(program('echo no modem >&2; exit 3'))
    with pytest.raises(DriverError, match=r'exit code 3 \(no modem\)'):
        output.show(Condition.ALARM, '')
    hanging = Command(program('exec sleep 60'))
    hanging.longest_s = 0.2
    with pytest.raises(DriverError, match=r'ended after 0\.2 s'):
        hanging.show(Condition.ALARM, '')
    Path(output._words[0]).unlink()
    with pytest.raises(DriverError, match='No such file'):
        output.show(Condition.ALARM, '')


@pytest.mark.parametrize('text', ['sh "unfinished', ' '])
def test_a_program_that_is_not_there_is_refused_at_the_start(text) -> None:
    with pytest.raises(ConfigError, match='command '):
        Command(text)


WELL, ALARM, DOUBT = Condition.WELL, Condition.ALARM, Condition.DOUBT
MEASURE = {'operating_state': 'measure'}


def _call(level: str, causes: str = '', **drive: str) -> Call:
    """Return what a detector and a speed node, which have just spoken, call for at 100 s."""
    call = Call(1.0, 0.0)
    values = {'level': level, 'message': 'why', 'alarm': str(level == 'ERROR'), 'causes': causes}
    call.hear(100.0, values)
    call.hear_drive(100.0, drive)
    call.look(100.0)
    return call


@pytest.mark.parametrize(
    ('level', 'causes', 'drive', 'condition', 'cause'),
    [
        ('WARN', '', {}, WELL, 'WARN: why'),
        ('STALE', 'yaw_stuck', {}, DOUBT, 'STALE: why'),
        ('ERROR', 'limit_cycle', {}, ALARM, 'ERROR: why'),
        ('OK', '', {'alarm_kept': 'it hunted'}, ALARM, 'it hunted'),
        ('OK', '', {'interlock_state': 'tripped', 'interlock_cause': 'gone'}, ALARM, 'gone'),
        ('ERROR', 'limit_cycle escaping', MEASURE, WELL, 'out of service: ERROR: why'),
        ('ERROR', 'limit_cycle alarm_yaw_mrad', MEASURE, ALARM, 'ERROR: why'),
        ('STALE', 'yaw_silent', {'operating_state': 'parked'}, WELL, 'out of service: STALE: why'),
        ('STALE', 'inputs', {'operating_state': 'parked'}, DOUBT, 'STALE: why'),
        ('ERROR', 'escaping', {'operating_state': 'measure'}, WELL, 'out of service: ERROR: why'),
        ('ERROR', 'escaping', {'operating_state': 'protect'}, ALARM, 'ERROR: why'),
        ('STALE', 'yaw_silent', {'operating_state': 'measure'}, DOUBT, 'STALE: why'),
        (
            'ERROR',
            'limit_cycle',
            MEASURE | {'interlock_state': 'tripped', 'interlock_cause': 'hunts'},
            ALARM,
            'hunts',
        ),
    ],
)
def test_somebody_is_called_by_what_is_said(level, causes, drive, condition, cause) -> None:
    call = _call(level, causes, **drive)
    assert (call.condition, call.cause) == (condition, cause)


def test_what_is_out_of_service_calls_nobody_when_the_run_is_ended() -> None:
    call = _call('STALE', 'yaw_silent', operating_state='parked')
    call.hear(100.0, {'level': 'STALE', 'message': '', 'alarm': 'True', 'causes': 'yaw_silent'})
    call.hear_drive(100.1, {'operating_state': 'parked', 'ending': 'True'})
    assert not call.look(102.0), 'though the speed node has ended'


def test_an_end_that_begins_in_doubt_takes_no_call_back() -> None:
    """The roller turns yet, and nobody sees what the wheelset does."""
    call = _call('STALE', 'yaw_silent')
    call.hear_drive(100.1, {'ending': 'True'})
    assert not call.look(100.1)
    call.hear(100.5, {'level': 'OK', 'message': ''})
    assert call.look(100.5), 'until it is seen again'
    assert call.condition is WELL


def test_who_is_silent_calls_whatever_is_out_of_service_but_at_an_end_that_was_asked_for() -> None:
    call = _call('ERROR', 'limit_cycle', **MEASURE)
    assert not call.look(100.9)
    assert call.look(101.1)
    assert call.condition is ALARM, 'nobody knows any more what is out of service'
    for told in (_call('OK'), _call('ERROR', 'limit_cycle', **MEASURE)):
        told.hear_drive(101.0, MEASURE)
        assert told.look(101.1), 'of the detector alone'
        assert (told.condition, told.cause) == (DOUBT, 'no status for 1 s')
    call = _call('OK')
    call.hear_drive(100.0, {'ending': 'True'})
    call.hear(101.0, {'level': 'STALE', 'message': 'why'})
    assert not call.look(103.0), 'the speed node was asked to end'
    assert call.look(131.0), 'and somebody else was not'
    call.hear_drive(131.0, {'ending': 'True'})
    assert call.look(131.0)
    assert call.cause == 'the run is being ended: STALE: why', 'no "well" that says STALE'
    # `ros2 launch` ends the detector at the same moment.
    tripped = {'ending': 'True', 'interlock_state': 'tripped', 'interlock_cause': 'why'}
    call = _call('OK')
    call.hear_drive(100.1, tripped | {'interlock_code': 'detector'})
    assert not call.look(101.5)
    before = _call('OK')
    for ending in ('False', 'True'):
        before.hear_drive(100.1, tripped | {'interlock_code': 'detector', 'ending': ending})
    assert before.look(101.5), 'a trip of before the end calls on'
    call.hear_drive(101.5, tripped | {'interlock_code': 'hunting'})
    assert call.look(101.5)
    assert call.condition is ALARM
    call = _call('ERROR')
    assert not call.look(1e6), 'what was an alarm is one while nobody speaks'
    call = Call(1.0, 0.0)
    assert not call.look(1.0)
    assert call.condition is Condition.WAITING
    assert call.look(100.0)
    assert call.cause.startswith('no status since the start')


def test_a_start_calls_nobody_but_for_an_alarm_and_no_longer_than_it_takes() -> None:
    call = Call(1.0, 0.0)
    for now_s, level, alarm, condition in (
        (1.0, 'STALE', 'False', Condition.WAITING),
        (2.0, 'STALE', 'True', ALARM),  # of before a restart, which nobody has acknowledged
        (3.0, 'STALE', 'False', Condition.WAITING),
        (4.0, 'WARN', 'False', WELL),
        (5.0, 'STALE', 'False', DOUBT),
    ):
        call.hear(now_s, {'level': level, 'message': 'why', 'alarm': alarm})
        call.look(now_s)
        assert call.condition is condition
    call = Call(1.0, 0.0)
    call.hear_drive(1.0, {'alarm_kept': 'it hunted'})
    assert call.look(1.0)
    assert call.condition is ALARM, 'a detector that was started again knows nothing of it'
    call = Call(1.0, 0.0)
    call.hear(100.0, {'level': 'STALE', 'message': 'why'})
    assert call.look(100.0)
    assert call.condition is DOUBT


def test_an_acknowledgement_counts_until_something_new() -> None:
    call = _call('ERROR')
    for event, silenced in (('acknowledged', True), ('decaying', True), ('limit_cycle', False)):
        call.hear_event(event)
        assert call.acknowledged == silenced
    call.hear_event('acknowledged')
    call.hear(101.0, {'level': 'STALE', 'message': 'why'})
    assert call.look(101.0)
    assert not call.acknowledged


def test_a_slip_in_the_section_of_the_alarm_is_refused_where_its_node_is_not_started() -> None:
    text = '/**/alarm_outputs: {ros__parameters: {relay_coils: 3}}'
    with pytest.raises(
        ConfigError,
        match=r'rig\.yaml: section alarm_outputs: unknown relay_coils, expected relay_coil',
    ):
        AlarmSettings.told([('rig.yaml', text)])
