"""How nodes start and end: quietly, at the safe speed, or with one line that says why not."""

from __future__ import annotations

import os
import re
import shlex
import signal
import socket
import subprocess
from pathlib import Path

import pytest
from geometry_msgs.msg import TwistStamped
from made import python
from processes import HUNT

from hunt_ros.cli.support.suite import free_port
from hunt_ros.drivers.safety_state import SafetyState
from hunt_ros.nodes.support.sensor import SensorNode

DEPTH = 'qos_overrides./rig/lateral.subscription.depth'


@pytest.mark.parametrize(
    ('node', 'parameters', 'words'),
    [
        ('lateral_sensor', {'sample_rate_hz': 5.0}, 'Parameter sample_rate_hz out of range'),
        ('lateral_sensor', {'driver': 'telepathy'}, "'telepathy': unknown, those there are:"),
        ('yaw_sensor', {'sample_rate': 200.0}, "'sample_rate', expected sample_rate_hz"),
        ('axle_box_sensor', {}, "driver simulated: no channel 'axle_box', it has lateral, yaw"),
        ('yaw_sensor', {'calibration': 'yaw.yaml'}, 'expected gain, offset and range'),
        ('yaw_sensor', {'gain': 0.0}, 'gain: 0.0, expected a finite number that is not 0'),
        ('roller_speed', {'driver': 'modbus'}, 'neither actual_register nor encoder_register'),
        (
            'roller_speed',
            {'driver': 'modbus', 'actual_register': 1, 'use_sim_time': True},
            'use_sim_time: a drive that is real runs by the steady clock',
        ),
        ('roller_speed', {'rate_limit_mps': 0.2}, 'expected amplitude_limit_m'),
        ('roller_speed', {'emergency_speed_mps': 3.0}, 'none: an emergency stop is a stop'),
        ('roller_speed', {'profile': 'hold.yaml'}, 'step 1 (hold): duration_s: -1.0 is below 0'),
        ('rig_simulator', {'wheelset': 'binary.yaml'}, 'binary.yaml: cannot read it as a rig'),
        ('alarm_outputs', {}, 'none of sound, command and relay_coil'),
        ('alarm_outputs', {'command': '/nowhere/notify'}, "no program '/nowhere/notify'"),
        ('hunting_detector', {DEPTH: "'many'"}, DEPTH),
    ],
)
def test_what_a_node_refuses_ends_it_with_one_line(graph, node, parameters, words) -> None:
    (graph.folder / 'hold.yaml').write_text('profile: [{hold: {speed_mps: 6, duration_s: -1}}]')
    (graph.folder / 'binary.yaml').write_bytes(b'\xff\xfe\xff')
    graph.start(node, **parameters)
    assert graph.wait(node, 60.0) == 2
    said = graph.log(node).read_text().strip()
    assert words in said.splitlines()[-1]
    assert 'Traceback' not in said


def test_the_executable_of_several_nodes_asks_which() -> None:
    (line,) = python('-m', 'hunt_ros.nodes.entry', code=2).stderr.splitlines()
    assert 'bag_recorder' in line


def text(graph, node: str) -> str:
    return graph.log(node).read_text()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_node_that_imports_says_so_and_ends_without_a_traceback(graph, number) -> None:
    graph.start('hunting_detector')
    graph.spin_until(lambda: text(graph, 'hunting_detector'))
    assert graph.end('hunting_detector', number) == 0
    first, *rest = text(graph, 'hunting_detector').splitlines()
    assert first == 'hunting_detector: starting'
    # Where the import is over within the notice, the node ends by itself and has nothing to say;
    # on a busy machine it has got anywhere by then.
    ended = r'hunting_detector: ended while (starting|running|closing)'
    assert len(rest) <= 1
    assert all(re.fullmatch(ended, line) for line in rest), rest


@pytest.mark.parametrize(
    ('name', 'asked'),
    [
        ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST'),
        ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET'),
        ('ROS_LOCALHOST_ONLY', '1'),
    ],
)
def test_nodes_share_no_memory_and_hear_no_other_host_where_they_are_to_hear_none(
    graph, monkeypatch, name, asked
) -> None:
    """Who comes or goes would hold up all who share memory with it."""
    monkeypatch.setenv(name, asked)
    process = graph.start('bag_recorder')
    graph.spin_until(
        lambda: ('bag_recorder', '/rig') in graph.node.get_node_names_and_namespaces()
    )
    assert '/dev/shm/fast' not in Path(f'/proc/{process.pid}/maps').read_text()
    if asked != 'SUBNET':
        assert addresses_of(process.pid) == {'127.0.0.1'}


def addresses_of(pid: int) -> set[str]:
    """Return the addresses at which a process takes UDP."""
    proc = Path(f'/proc/{pid}')
    held = {os.readlink(each) for each in (proc / 'fd').iterdir() if each.is_symlink()}
    found = set()
    for line in (proc / 'net' / 'udp').read_text().splitlines()[1:]:
        address, inode = line.split()[1], line.split()[9]
        if f'socket:[{inode}]' in held:
            found.add(socket.inet_ntoa(bytes.fromhex(address.partition(':')[0])[::-1]))
    return found


def test_a_node_that_waits_for_its_hardware_ends(graph) -> None:
    graph.start('roller_speed', port=graph.port)  # where nobody answers
    graph.spin_until(
        lambda: ('roller_speed', '/rig') in graph.node.get_node_names_and_namespaces()
    )
    # Whether the roller turns nobody knows.
    assert graph.end('roller_speed', signal.SIGTERM) == 2
    assert 'the roller may turn: ' in text(graph, 'roller_speed').splitlines()[-1]


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGHUP])
def test_the_speed_node_takes_the_roller_to_the_safe_speed_before_it_ends(graph, number) -> None:
    """Also where the terminal of `ros2 launch` is closed: all of its nodes are hung up."""
    speeds = graph.collect(TwistStamped, 'speed')
    graph.start('rig_simulator', port=graph.port, initial_speed_mps=8.0)
    drive = {'port': graph.port, 'safe_speed_mps': 6.5, 'safe_deceleration_mps2': 0.5}
    process = graph.start('roller_speed', **drive)
    graph.spin_until(lambda: speeds, 60.0)
    process.send_signal(number)
    process.send_signal(signal.SIGINT)  # the group and its leader each pass it on
    graph.spin(1.5)
    process.send_signal(number)  # late on a busy machine; in a hurry is who presses Ctrl-C
    graph.spin_until(lambda: process.poll() is not None, 30.0)
    assert process.returncode == 0
    assert speeds[0].twist.linear.x == pytest.approx(8.0, abs=0.1)
    assert speeds[-1].twist.linear.x == pytest.approx(6.5, abs=0.1)


def test_a_speed_node_that_nobody_asks_for_any_more_is_in_no_hurry(graph) -> None:
    """A service manager that is late on a busy machine interrupts it a second time."""
    speeds = graph.collect(TwistStamped, 'speed')
    graph.start('rig_simulator', port=graph.port, initial_speed_mps=8.0)
    drive = {'port': graph.port, 'safe_deceleration_mps2': 2.0}
    node = graph.orphan('roller_speed', lambda: speeds, **drive)
    graph.spin(1.5)
    os.kill(node, signal.SIGINT)
    graph.spin_until(lambda: speeds[-1].twist.linear.x < 0.1)


FORM = Path(__file__).resolve().parents[2] / 'bags' / 'paper.yaml'
RIG = """
/**/rig_simulator: {{ros__parameters: {{port: {port}}}}}
/**/lateral_sensor: {{ros__parameters: {{port: {port}}}}}
/**/yaw_sensor: {{ros__parameters: {{port: {port}}}}}
/**/hunting_detector: {{ros__parameters: {{sensor_timeout_s: 10.0}}}}
/**/roller_speed: {{ros__parameters: {{port: {port}, status_timeout_s: 30.0}}}}
"""
#: What a machine says that cannot follow.
_BUSY = re.compile(r'behind real time|too late|lost on their way|samples lost|samples/s|missed')
_LOUD = re.compile(r'ERROR|WARN|STALE|Traceback|silent')


def loud_lines(said: str) -> list[str]:
    """Return the lines that look like trouble, but for those of a machine that cannot follow."""
    return [line for line in said.splitlines() if _LOUD.search(line) and not _BUSY.search(line)]


def _run(words: list[str], folder: Path, until: str, machine) -> str:
    """Run `hunt` until it ends or says this; return all that it and its nodes wrote."""
    screen = folder / 'screen'
    with screen.open('w') as out:
        run = subprocess.Popen([*HUNT, *words], stdout=out, stderr=out, cwd=folder)
    try:
        machine.until(
            lambda: run.poll() is not None or until in screen.read_text(), 120.0, screen.read_text
        )
        run.send_signal(signal.SIGINT)
        machine.wait_for(run, 60.0)
    finally:
        run.kill()
    logs = [path.read_text() for path in folder.rglob('*.log')]
    return '\n'.join([screen.read_text(), *logs])


@pytest.mark.slow
def test_the_first_minute_of_a_simulated_run_and_its_end_are_quiet(
    tmp_path, machine, domain, monkeypatch
) -> None:
    # A busy machine is silent for longer than a rig may be: that is no matter of the start.
    monkeypatch.setenv('HUNT_START_S', str(30.0 * machine.measure()))
    rig = tmp_path / 'rig.yaml'
    rig.write_text(RIG.format(port=free_port()))
    run = ['run', '--simulated', '--rig', str(rig), '--duration', '60']
    run += ['--normal-form', str(FORM)]
    said = _run(run, tmp_path, 'never', machine)
    assert 'recording' in said
    assert loud_lines(said) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'value'), [('RMW_IMPLEMENTATION', 'rmw_none'), ('ROS_LOG_DIR', '/proc/none')]
)
def test_a_ros_that_does_not_start_ends_the_run(
    tmp_path, machine, domain, monkeypatch, name, value
) -> None:
    monkeypatch.setenv(name, value)
    said = _run(['run', '--simulated', '--directory', str(tmp_path)], tmp_path, 'never', machine)
    assert value in said
    assert 'Traceback' not in said


@pytest.mark.slow
def test_a_run_without_a_stream_of_its_own_records(tmp_path, machine, domain) -> None:
    words = ['run', '--simulated', '--directory', str(tmp_path), '--duration', '6']
    shell = f'{shlex.join([*HUNT, *words])} <&- >&- 2>&-'
    assert machine.wait_for(subprocess.Popen(shell, shell=True), 120.0) == 0
    assert list(tmp_path.glob('hunt_*/*.mcap'))


@pytest.mark.slow
def test_the_demo_is_quiet_until_the_rig_is_not(tmp_path, machine, domain) -> None:
    said = _run(['demo'], tmp_path, 'hysteresis region', machine)
    before = said.partition('hysteresis region')[0]
    assert [line for line in before.splitlines() if _LOUD.search(line)] == []


def _sensor(graph, resident) -> SensorNode:
    """Return a sensor of a rig that nobody simulates yet."""
    return resident(lambda: SensorNode('yaw'), port=graph.port)


def test_who_waits_for_a_neighbour_is_starting_and_later_in_trouble(graph, resident) -> None:
    health = graph.told()
    node = _sensor(graph, resident)

    graph.spin_until(lambda: health.says('starting: ', level='OK'))
    assert not health.says(level='ERROR')
    node._diagnostics._began_s -= 60.0
    graph.spin_until(lambda: health.says('cannot connect', level='ERROR'))


def test_a_neighbour_that_has_just_come_and_not_spoken_yet_is_no_trouble(graph, resident) -> None:
    health = graph.told()
    node = _sensor(graph, resident)
    graph.spin_until(lambda: health.says('cannot connect'))
    with socket.create_server(('127.0.0.1', graph.port)):
        graph.spin_until(lambda: node._found)
        until = len(health) + 2
        graph.spin_until(lambda: len(health) >= until)
        assert {one['level'] for one in health} == {'OK'}


def test_a_stop_of_before_is_in_force_from_the_first_word_on(graph, tmp_path) -> None:
    """A start may wait for a neighbour; it does not call well what is not."""
    state = tmp_path / 'state.json'
    state.write_text(SafetyState(emergency_stop='asked for').to_json())
    health = graph.told()
    graph.start('roller_speed', port=graph.port, state_file=str(state))  # and no drive is there
    graph.spin_until(lambda: health)
    assert health[0]['level'] == 'ERROR'
    assert 'emergency stop is in force' in health[0]['message']


@pytest.mark.parametrize('name', ['', 'pipe', '/dev/null', '/dev/zero'])
def test_a_state_that_can_be_neither_read_nor_written_is_said_once(graph, tmp_path, name) -> None:
    health = graph.told()
    os.mkfifo(tmp_path / 'pipe')
    graph.start('roller_speed', port=graph.port, state_file=str(tmp_path / name))
    graph.spin_until(lambda: health.says('safety state failed'))
    count = len(health)
    graph.spin_until(lambda: len(health) > count + 3)  # it has been tried again
    assert health.last['level'] == 'ERROR'
    assert text(graph, 'roller_speed').count('safety state: ') == 1
    assert 'Traceback' not in text(graph, 'roller_speed')


def test_a_device_that_refuses_is_no_start_that_waits(graph, modbus_server) -> None:
    health = graph.told()
    refused = {'driver': 'modbus', 'port': modbus_server.port, 'register': 9999}
    graph.start('lateral_sensor', **refused)
    graph.spin_until(lambda: health.says('register 9999'))
    levels = {one['level'] for one in health if 'register 9999' in one['message']}
    assert levels == {'ERROR'}


@pytest.mark.parametrize('node', ['lateral_sensor', 'roller_speed'])
def test_hardware_that_does_not_answer_is_no_start_that_waits(graph, node) -> None:
    """What is told after half a minute comes when the operator has gone."""
    health = graph.told()
    register = {'lateral_sensor': 'register', 'roller_speed': 'actual_register'}[node]
    graph.start(node, driver='modbus', port=graph.port, **{register: 1})  # where nobody answers
    graph.spin_until(lambda: health.says('cannot connect'))
    assert {one['level'] for one in health if 'cannot connect' in one['message']} == {'ERROR'}
    assert 'cannot connect; trying again' in text(graph, node)
