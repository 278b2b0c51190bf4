"""`hunt run`: what is on the screen, what is in the recording, and its end."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import termios
import time
from dataclasses import replace

import pytest
from made import PAPER, python
from processes import HUNT, joint
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from hunt_ros.bag import read_columns
from hunt_ros.cli.main import main
from hunt_ros.suite import hold

#: Each of them is in every node of a lab that measures all day.
_LIGHT = """
import sys
import hunt_ros.nodes.bag_recorder, hunt_ros.nodes.console
import hunt_ros.nodes.roller_speed, hunt_ros.nodes.support.sensor
import hunt_ros.nodes.normal_form_identifier
print(sorted({'scipy', 'numba', 'matplotlib'} & set(sys.modules)))
"""
#: What solvers cost in memory is for those who solve.
_WITHOUT_SOLVERS = """
import sys
import hunt_ros.nodes.hunting_detector, hunt_ros.nodes.rig_simulator
print(sorted(name for name in sys.modules if name.startswith('scipy.') and name.islower()
             and name.split('.')[1] in ('linalg', 'optimize', 'signal', 'special', 'stats')))
"""


def test_a_run_with_the_form_of_another_rig_starts_nothing(tmp_path, capsys) -> None:
    """That would call the wrong speeds safe."""
    rig, form = tmp_path / 'rig_file.yaml', tmp_path / 'A.yaml'
    rig.write_text('/**: {ros__parameters: {rig_name: B}}\n')
    form.write_text(replace(PAPER, rig_name='A').to_yaml())
    words = ['--rig', str(rig), '--normal-form', str(form)]
    assert main(['run', *words, '--directory', str(tmp_path / 'recordings')]) == 2
    assert "A.yaml: identified on rig 'A', expected 'B'" in capsys.readouterr().err
    assert not (tmp_path / 'recordings').exists()


def test_a_run_with_a_driver_that_is_not_there_starts_nothing(tmp_path, capsys) -> None:
    rig = tmp_path / 'rig_file.yaml'
    rig.write_text('yaw_sensor: {ros__parameters: {driver: nidaq}}\n')
    assert main(['run', '--rig', str(rig), '--directory', str(tmp_path / 'recordings')]) == 2
    assert "driver 'nidaq': unknown, those there are" in capsys.readouterr().err
    assert not (tmp_path / 'recordings').exists()


def test_words_that_ros_cannot_read_start_nothing(tmp_path, capsys) -> None:
    """Its parser was given them, and each node was started again for ever."""
    folder = tmp_path / 'd\udcffr'
    assert main(['run', '--simulated', '--directory', str(folder)]) == 2
    assert '\\udcffr/.rig_speed_state.json' in (said := capsys.readouterr().err)
    assert 'not UTF-8' in said
    assert main(['call', 'mark', 'b\udcffmp']) == 2
    assert '\'words:="b\\udcffmp"\': not UTF-8, as ROS wants it' in capsys.readouterr().err


def test_a_second_run_of_a_rig_starts_nothing_that_the_first_one_could_see(
    tmp_path, domain, capsys
) -> None:
    with hold('/rig/roller_speed', domain):
        assert main(['run', '--simulated', '--directory', str(tmp_path / 'recordings')]) == 2
    assert '/rig/roller_speed runs already on this machine' in capsys.readouterr().err
    assert not list((tmp_path / 'recordings').glob('*'))


@pytest.mark.slow
def test_of_two_runs_that_begin_at_once_one_says_that_the_other_runs(
    tmp_path, machine, domain
) -> None:
    """Both found no node of the other; one then said that nobody guards a roller at no speed."""
    runs, screens = [], [tmp_path / 'first', tmp_path / 'second']
    words = [*HUNT, 'run', '--simulated', '--directory', str(tmp_path / 'recordings')]
    for screen in screens:
        with screen.open('w') as out:
            runs.append(subprocess.Popen(words, stdout=out, stderr=out))
    try:
        machine.until(lambda: any(run.poll() is not None for run in runs), 60.0)
        refused = [run.poll() is not None for run in runs].index(True)
        assert runs[refused].returncode == 2
        assert '/rig runs already on this machine' in screens[refused].read_text()
        assert 'NOBODY GUARDS' not in screens[refused].read_text()
        runs[1 - refused].send_signal(signal.SIGTERM)
        machine.wait_for(runs[1 - refused], 60.0)
    finally:
        for run in runs:
            run.kill()


#: Who has this profile of Fast DDS asks for others where nobody is.
_ALONE = """<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>
<participant profile_name="alone" is_default_profile="true"><rtps><builtin>
<metatrafficUnicastLocatorList><locator/></metatrafficUnicastLocatorList><initialPeersList>
<locator><udpv4><address>127.0.0.1</address><port>9</port></udpv4></locator>
</initialPeersList></builtin></rtps></participant></profiles></dds>"""


@pytest.mark.slow
def test_a_run_that_hears_none_of_its_nodes_says_so(
    tmp_path, machine, domain, monkeypatch
) -> None:
    profile, screen = tmp_path / 'alone.xml', tmp_path / 'screen'
    profile.write_text(_ALONE)
    monkeypatch.setenv('HUNT_START_S', '5')
    monkeypatch.delenv('ROS_AUTOMATIC_DISCOVERY_RANGE')
    for version in ('FASTRTPS', 'FASTDDS'):
        monkeypatch.setenv(f'{version}_DEFAULT_PROFILES_FILE', str(profile))
    with screen.open('w') as out:
        words = [*HUNT, 'run', '--simulated', '--directory', str(tmp_path)]
        run = subprocess.Popen(words, stdout=out, stderr=out)
    said = 'no node of this run is heard for 5 s'
    try:
        machine.until(lambda: said in screen.read_text(), 60.0, screen.read_text)
        run.send_signal(signal.SIGINT)
        machine.wait_for(run, 60.0)
    finally:
        run.kill()
    assert screen.read_text().count(said) == 1


@pytest.mark.slow
def test_a_run_that_listens_records_without_a_clock_and_ends_at_sigterm(graph, called) -> None:
    folder = graph.folder / 'recordings'
    folder.mkdir()
    form = folder / 'normal_form.yaml'
    form.write_text(PAPER.to_yaml())
    calls, rig = called(), folder / 'rig.yaml'
    rig.write_text(f'/**/alarm_outputs: {{ros__parameters: {{command: {calls.program}}}}}')
    lateral = graph.node.create_publisher(JointState, 'lateral', 100)
    words = [*HUNT, 'run', '--listen', '--one-process']
    keyboard, terminal = os.openpty()
    taken = socket.create_server(('127.0.0.1', 0))  # the page ends at once: its port is in use
    words += ['--page', str(taken.getsockname()[1]), '--rig', str(rig)]
    with (graph.folder / 'screen').open('w') as out:
        run = subprocess.Popen(
            [*words, '--directory', str(folder)], stdin=terminal, stdout=out, stderr=out
        )
    before = termios.tcgetattr(keyboard)
    marks = graph.collect(String, 'recording/mark')
    try:
        graph.spin_until(lambda: lateral.get_subscription_count() == 2, 60.0)
        for number in range(50):
            lateral.publish(joint('lateral', time.time_ns(), float(number)))
            graph.spin(0.01)
        graph.spin_until(lambda: 'dashboard ended' in (graph.folder / 'screen').read_text(), 60.0)
        graph.spin_until(calls, 60.0)
        assert calls()[0].startswith('doubt: STALE: '), 'no sensor speaks for long'
        # The terminal is in its key mode once the screen says what the keys do.
        graph.spin_until(lambda: 'q: quit' in (graph.folder / 'screen').read_text())
        os.write(keyboard, b'm')
        graph.spin_until(lambda: marks)
        os.write(keyboard, b'x')
        graph.spin_until(lambda: (graph.folder / 'screen').read_text().count('q: quit') == 2)
        run.send_signal(signal.SIGTERM)
        assert graph.machine.wait_for(run, 15.0) == 0
    finally:
        run.kill()
    assert termios.tcgetattr(keyboard) == before, 'the terminal is left as it was found'
    os.close(keyboard)
    os.close(terminal)
    screen = (graph.folder / 'screen').read_text()
    assert str(form) in screen, 'the newest form is loaded'
    assert 'hunt call acknowledge' in screen
    assert 'an alarm calls by command; tested last: never' in screen
    assert 'a: acknowledge' in screen
    assert 'e: emergency-stop' not in screen, 'the node of that service was not started'
    assert 'Traceback' not in ''.join(log.read_text() for log in folder.glob('logs/**/*.log'))
    (bag,) = folder.glob('hunt_*')
    assert not bag.suffix, 'the recording was closed'
    values = read_columns(bag, {'y': '/rig/lateral.position[0]'})['y'].values
    assert values.tolist() == list(map(float, range(50)))


@pytest.mark.parametrize('program', [_LIGHT, _WITHOUT_SOLVERS])
def test_nodes_import_no_more_numerics_than_they_use(program) -> None:
    assert python('-c', program).stdout == '[]\n'
