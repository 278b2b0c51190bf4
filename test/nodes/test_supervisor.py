"""
Whatever dies, the rig ends safe: `hunt run` on a simulated rig that outlives it, as hardware does.

How fast the roller turns is asked of the rig, not of the suite.
"""

from __future__ import annotations

import os
import pty
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from processes import HUNT, children
from sensor_msgs.msg import JointState

from hunt_ros.cli.support.processes import NodeSpec
from hunt_ros.cli.support.supervisor import Supervisor, _Child, _in_child
from hunt_ros.nodes.support.conversions import diagnostic
from hunt_ros.nodes.support.qos import EVENTS, STATUS, latched, stream

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
#: Between v_n = 6.41 and v_c = 8.0 of the rig: hunting would not end by itself.
SPEED, SAFE = 7.5, 5.9
RIG = """
/**/lateral_sensor: {{ros__parameters: {{port: {port}, sample_rate_hz: 100.0}}}}
/**/yaw_sensor: {{ros__parameters: {{port: {port}, sample_rate_hz: 100.0}}}}
/**/hunting_detector: {{ros__parameters: {{sensor_timeout_s: {patience}, output_rate_hz: 20.0}}}}
/**/alarm_outputs: {{ros__parameters: {{command: '{command}'}}}}
/**/roller_speed:
  ros__parameters:
    port: {port}
    profile: '{profile}'
    profile_autostart: true
    interlock: protect
    status_timeout_s: {patience}
    safe_deceleration_mps2: {rate}
"""


class Run:
    """`hunt run` on a rig that turns at `SPEED`, and an observer on the side of the rig."""

    def __init__(
        self,
        graph,
        *,
        rate: float = 1.0,
        one_process: bool = False,
        patience_s: float = 0.3,
        command: object = '',
    ) -> None:
        self.graph = graph
        self._rig = graph.told('/diagnostics', STATUS, of='rig_simulator')
        self._drive = graph.told('speed/status', latched())
        self.statuses = graph.told('hunting/status', STATUS)
        graph.start(
            'rig_simulator', port=graph.port, initial_speed_mps=SPEED, sample_rate_hz=100.0
        )
        profile = graph.profile(f'hold: {{speed_mps: {SPEED}, duration_s: 10000}}')
        rig = graph.folder / 'rig.yaml'
        patience = min(60.0, patience_s * graph.machine.measure())
        given = {'profile': profile, 'rate': rate, 'patience': patience, 'command': command}
        rig.write_text(RIG.format(port=graph.port, **given))
        self.words = [*HUNT, 'run', '--rig', str(rig)]
        self.words += ['--normal-form', str(ROOT / 'bags' / 'paper.yaml')]
        self.words += ['--directory', str(graph.folder / 'recordings')]
        self.words += ['--one-process'] * one_process
        self.screen = ''

    def begin(self, **streams: object) -> None:
        """Start it on a rig that turns, and wait for nothing else."""
        given: dict = {'stdout': subprocess.PIPE, 'stderr': subprocess.STDOUT, **streams}
        self.graph.spin_until(lambda: self.speed is not None)
        self.hunt = subprocess.Popen(self.words, text=True, start_new_session=True, **given)
        if self.hunt.stdout is not None:
            threading.Thread(target=self._read, daemon=True).start()

    def start(self, **streams: object) -> None:
        """... and wait until it is guarded."""
        self.begin(**streams)
        self.graph.spin_until(self._guarded, 60.0)
        assert self.speed == pytest.approx(SPEED, abs=0.1)

    def _guarded(self) -> bool:
        assert self.hunt.poll() is None, self.screen
        return self.status.get('interlock_cause') == 'no reason to trip'

    def _read(self) -> None:
        for line in self.hunt.stdout:
            self.screen += line

    @property
    def status(self) -> dict[str, str]:
        """What the speed node says."""
        return self._drive.last

    @property
    def speed(self) -> float | None:
        """What the rig itself says that it turns at, m/s."""
        return float(self._rig.last['speed_mps']) if self._rig else None

    def child(self, name: str) -> int:
        """Return the process of a node."""
        (pid,) = children(self.hunt.pid, name)
        return pid

    def kill(self, name: str, process: str = '') -> None:
        before = self.child(name)
        os.kill(before, signal.SIGKILL)
        line = f'{process or name} ended with exit code -9'
        self.graph.spin_until(lambda: line in self.screen)
        self.graph.spin_until(lambda: self._again(name, before))

    def _again(self, name: str, before: int) -> bool:
        try:
            return self.child(name) != before
        except ValueError:
            return False

    def until_safe(self, mps: float = SAFE) -> None:
        self.graph.spin_until(lambda: self.speed < mps + 0.1, 40.0)

    def end(self, number: int = signal.SIGTERM) -> int:
        self.hunt.send_signal(number)
        return self.ended()

    def ended(self) -> int:
        self.graph.spin_until(lambda: self.hunt.poll() is not None, 60.0)
        return self.hunt.returncode


@pytest.fixture
def run(graph) -> Iterator[Callable[..., Run]]:
    made: list[Run] = []

    def make(**given: object) -> Run:
        made.append(Run(graph, **given))
        return made[-1]

    yield make
    for each in made:
        if each.hunt.poll() is None:
            each.hunt.kill()  # its nodes are interrupted by the system
            each.hunt.wait()


class _Sleeper(NodeSpec):
    def command(self, namespace: str) -> list[str]:
        return ['sleep', '1000']


def test_what_dies_is_started_again_though_the_folder_of_the_recordings_was_moved(
    tmp_path: Path, monkeypatch, machine
) -> None:
    folder = tmp_path / 'recordings'
    with Supervisor('rig', folder / 'logs', private=False) as supervisor:
        supervisor.start(_Sleeper('yaw_sensor'))
        before, said = supervisor.pids()['yaw_sensor'], []
        folder.rename(tmp_path / 'tidied')
        monkeypatch.setattr(subprocess, 'Popen', _no_process)  # for a moment
        os.kill(before, signal.SIGKILL)

        def again() -> bool:
            said.extend(supervisor.look())
            if any('cannot be started' in line for line in said):
                monkeypatch.undo()
            return supervisor.pids().get('yaw_sensor', before) != before

        machine.until(again, told=lambda: said)
        os.kill(supervisor.pids()['yaw_sensor'], signal.SIGKILL)


@pytest.mark.parametrize('others', [('yaw_sensor', 'lateral_sensor'), ()])
@pytest.mark.parametrize('spoken', [True, False])
def test_a_guard_that_stands_still_is_started_again_unless_all_are_silent(
    tmp_path: Path, machine, others, spoken
) -> None:
    with Supervisor('rig', tmp_path / 'logs', private=False) as supervisor:
        supervisor.start(_Sleeper('alarm_outputs'))
        before = supervisor.pids()['alarm_outputs']
        if spoken:
            supervisor.heard('/rig/alarm_outputs')
        for _ in range(20 if spoken else 50):
            for name in others:
                supervisor.heard(f'/rig/{name}')
        if not spoken:
            assert supervisor.look() == [], 'a start takes its time'
        for _ in range(20):
            for name in others:
                supervisor.heard(f'/rig/{name}')
            supervisor.heard('/rig_beside/yaw_sensor')
            supervisor.heard('/rig/lateral_sensor')  # one that speaks very often
            supervisor.heard('/rig_beside/alarm_outputs')
        said = supervisor.look()
        assert said == (['alarm_outputs stands still: it is ended'] if others else [])
        if others:

            def again() -> bool:
                supervisor.look()
                return supervisor.pids().get('alarm_outputs', before) != before

            machine.until(again)
        os.kill(supervisor.pids()['alarm_outputs'], signal.SIGKILL)  # it hears nothing else


def test_a_process_whose_parent_died_before_it_could_be_told_is_interrupted() -> None:
    words = [sys.executable, '-c', 'import signal as s; print(s.SIGINT in s.sigpending())']
    for parent, interrupted in ((os.getpid(), 'False'), (1, 'True')):
        done = subprocess.run(
            words, capture_output=True, text=True, preexec_fn=partial(_in_child, parent)
        )
        assert done.stdout.strip() == interrupted


class _Listener(NodeSpec):
    def command(self, namespace: str) -> list[str]:
        listens = 'import signal as s, time; s.pthread_sigmask(s.SIG_UNBLOCK, [s.SIGINT])'
        return [sys.executable, '-c', f'{listens}; print(flush=True); time.sleep(1000)']


def test_what_is_stopped_goes_on_to_its_own_end(tmp_path: Path) -> None:
    """A recorder closes its recording; it was waited for, and killed after 64 s."""
    started: list[subprocess.Popen[str]] = []
    with Supervisor('rig', tmp_path / 'logs', private=False) as supervisor:
        supervisor.start(_Listener('bag_recorder', piped=True), started.append)
        started[0].stdout.readline()
        os.kill(started[0].pid, signal.SIGSTOP)
    assert started[0].returncode == -signal.SIGINT


class _Swallows:
    def __del__(self) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)  # what is raised here is lost


def test_an_interrupt_at_any_moment_ends_the_run(tmp_path: Path) -> None:
    with Supervisor('rig', tmp_path / 'logs', private=False) as supervisor:
        supervisor.start(_Sleeper('yaw_sensor'))
        assert supervisor.look() == []
        _Swallows()
        for again in (supervisor.look, lambda: supervisor.start(_Sleeper('lateral_sensor'))):
            with pytest.raises(KeyboardInterrupt):
                again()


def test_one_that_ends_while_it_is_looked_at_does_not_stand_still(tmp_path, monkeypatch) -> None:
    with Supervisor('rig', tmp_path / 'logs', private=False) as supervisor:
        supervisor.start(_Sleeper('yaw_sensor'))
        pid = supervisor.pids()['yaw_sensor']
        os.kill(pid, signal.SIGKILL)
        os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)  # dead, and nobody has asked
        with monkeypatch.context() as patch:
            patch.setattr(_Child, 'runs', True)
            patch.setattr(_Child, 'ended', lambda child: None)
            assert supervisor.look() == []


def test_the_console_which_tells_no_health_does_not_stand_still() -> None:
    child = _Child(NodeSpec('console', piped=True), lambda process: None)
    with subprocess.Popen(['sleep', '1000'], text=True) as child.process:
        child.others.update(yaw_sensor=1000, lateral_sensor=1000)
        assert not child.stands_still
        child.process.kill()


def test_what_fails_for_days_is_started_again_each_half_minute() -> None:
    child = _Child(NodeSpec('yaw_sensor'), lambda process: None)
    for _ in range(3000):
        child.put_off()
    assert child.due_s <= time.monotonic() + 30.0


def _no_process(*words: object, **how: object) -> None:
    raise BlockingIOError('no process more')


def test_what_guards_nothing_is_started_again_and_the_roller_turns_on(run, graph) -> None:
    rig = run(patience_s=5.0)  # what starts again takes both cores of a small machine
    rig.start()
    recordings = lambda: list((graph.folder / 'recordings').glob('hunt_*'))  # noqa: E731
    graph.spin_until(recordings)
    rig.kill('console')
    rig.kill('bag_recorder')
    graph.spin_until(lambda: len(recordings()) == 2, 60.0)
    rig.kill('normal_form_identifier')
    graph.spin(3.0)
    assert rig.status['interlock_state'] == 'armed', rig.status['interlock_cause']
    assert rig.speed == pytest.approx(SPEED, abs=0.1)
    assert rig.hunt.poll() is None
    assert rig.end() == 0
    rig.until_safe()
    assert 'on its way to 5.9' in rig.screen, rig.screen
    # What the last nodes miss of those that have ended is no news.
    assert 'INPUT STALE' not in rig.screen.partition('where it is safe')[2], rig.screen


def test_a_message_that_says_nothing_ends_no_run(run, graph) -> None:
    """Other nodes of the ROS domain tell on /diagnostics what they want."""
    rig = run()
    rig.start()
    strange = {'interlock_state': 'tripped', 'stamp_ns': 'now', 'topic': 'hunting/events'}
    for topic in ('/diagnostics', 'hunting/events', 'speed/status'):
        quality = latched() if topic == 'speed/status' else EVENTS
        publisher = graph.node.create_publisher(DiagnosticArray, topic, quality)
        graph.spin_until(lambda publisher=publisher: publisher.get_subscription_count() > 1)
        publisher.publish(DiagnosticArray())
        publisher.publish(diagnostic(0, 'camera', 'OK', '', strange, ''))
    rig.kill('lateral_sensor')
    # And there are bytes that are no message at all.
    publisher = graph.node.create_publisher(JointState, 'lateral', stream(10))
    names = ('roller_speed', 'hunting_detector')
    logs = [next(graph.folder.rglob(f'{name}.log')) for name in names]

    def said() -> bool:
        for wire in (b'', b'\0\1\0\0', bytes(range(200))):
            publisher.publish(wire)
        return all('a message cannot be read' in log.read_text() for log in logs)

    graph.spin_until(said)
    rig.kill('yaw_sensor')
    assert 'roller_speed ended' not in rig.screen
    assert 'hunting_detector ended' not in rig.screen
    assert all(log.read_text().count('a message cannot be read') < 3 for log in logs)
    assert 'alarm_outputs ended' not in rig.screen
    assert rig.end() == 0, rig.screen


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGSTOP])
def test_the_loss_of_the_detector_trips_the_guard_and_is_mended(run, graph, number) -> None:
    rig = run()
    rig.start()

    def trips() -> bool:
        """Hit it again where it is back before anybody has missed it, as on a slow machine."""
        for pid in children(rig.hunt.pid, 'hunting_detector'):
            with suppress(ProcessLookupError):
                os.kill(pid, number)
        return rig.status['interlock_state'] == 'tripped'

    graph.spin_until(trips, 60.0)
    rig.statuses.clear()
    rig.until_safe()
    assert rig.hunt.poll() is None
    # What was lost is back: a person can go on. Its start may have hung, and is then a second one.
    graph.spin_until(lambda: rig.statuses.last.get('level') in ('OK', 'WARN'), 120.0)
    refused: list[str] = []

    def rearmed() -> bool:
        answer = graph.call('speed/rearm')
        refused.append(answer.message)
        return answer.success

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(graph, 'tails', lambda: f'{refused[-1:]}; {rig.screen[-2000:]}')
        graph.spin_until(rearmed, 60.0)
    assert rig.end(signal.SIGINT) == 0
    assert rig.speed < SAFE + 0.1


def test_the_processes_of_one_process_fail_together_and_not_with_the_guard(run, graph) -> None:
    rig = run(one_process=True)
    rig.start()
    rig.kill('hunting_detector', 'suite')
    rig.until_safe()
    assert rig.end() == 0


def test_a_guard_that_somebody_else_ends_starts_no_profile_again(run, graph) -> None:
    """What saves memory on a machine ends single processes, in order."""
    rig = run()
    rig.start()
    os.kill(rig.child('roller_speed'), signal.SIGTERM)
    graph.spin_until(lambda: 'roller_speed ended with exit code 0' in rig.screen, 60.0)
    # That it ended unasked is the cause at first; a busy detector then takes the roller lower.
    graph.spin_until(lambda: rig.status['interlock_state'] == 'tripped', 60.0)
    assert rig.status['profile_state'] == 'idle'
    assert rig.speed < SAFE + 0.1
    assert rig.end() == 0, rig.screen


def test_somebody_is_called_when_the_alarm_outputs_are_gone(run, graph, called) -> None:
    calls = called()
    rig = run(patience_s=5.0, command=calls.program)
    rig.start()
    graph.spin_until(calls, 60.0)
    before = rig.child('alarm_outputs')
    os.kill(before, signal.SIGKILL)
    # It cannot say so of itself, and is not back yet.
    graph.spin_until(lambda: 'doubt: alarm_outputs ended with exit code -9' in calls())
    graph.spin_until(lambda: calls()[-1].startswith('well: '), 60.0)
    assert rig.child('alarm_outputs') != before
    assert rig.end() == 0
    assert calls()[-1].startswith('well: '), 'an end that was asked for calls nobody'


def test_somebody_is_called_though_who_calls_was_stopped_and_the_run_is_killed(
    run, graph, called
) -> None:
    calls = called()
    rig = run(command=calls.program)
    rig.start()
    graph.spin_until(calls, 60.0)
    os.kill(rig.child('alarm_outputs'), signal.SIGSTOP)
    rig.hunt.kill()
    graph.spin_until(lambda: any('what started the nodes has died' in call for call in calls()))
    rig.until_safe(0.0)


def _killed(rig: Run) -> None:
    rig.start()
    rig.hunt.kill()


def _hung_up(rig: Run) -> None:
    ours, theirs = pty.openpty()
    rig.start(stdin=theirs, stdout=theirs, stderr=theirs)
    os.close(theirs)
    os.close(ours)  # the window is closed
    rig.hunt.send_signal(signal.SIGHUP)


def _unread(rig: Run) -> None:
    reader, writer = os.pipe()
    rig.start(stdout=writer)
    os.close(writer)
    os.close(reader)
    os.kill(rig.child('bag_recorder'), signal.SIGKILL)  # there is something to say


@pytest.mark.parametrize(('end', 'mps'), [(_killed, 0.0), (_hung_up, SAFE), (_unread, SAFE)])
def test_however_it_ends_the_roller_is_at_the_safe_speed(run, graph, end, mps) -> None:
    """Stopped where nobody is left who asks for anything: the form may be wrong about it."""
    rig = run()
    end(rig)
    rig.ended()
    rig.until_safe(mps)
    graph.spin(1.0)
    assert rig.speed > mps - 0.5
    for log in graph.folder.rglob('*.log'):
        assert 'Traceback' not in log.read_text(), log


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGSTOP])
def test_a_guard_that_is_killed_on_the_way_to_the_safe_speed_gets_there(
    run, graph, number
) -> None:
    rig = run(rate=0.2)
    rig.start()
    rig.hunt.send_signal(signal.SIGTERM)
    graph.spin_until(lambda: 'on its way to 5.9' in rig.screen)
    os.kill(rig.child('roller_speed'), number)
    assert rig.ended() == 0
    rig.until_safe()


def test_a_rig_file_that_is_spoilt_while_it_runs_keeps_no_guard_away(run, graph) -> None:
    """Nor does a profile, nor a disk that takes no log."""
    (graph.folder / 'recordings').mkdir()
    (graph.folder / 'recordings' / 'logs').write_text('no folder')
    rig = run()
    rig.start()
    for path in (graph.folder / 'rig.yaml', graph.folder / 'profile.yaml'):
        path.write_text('nonsense: [')
    rig.kill('roller_speed')
    rig.until_safe()
    assert rig.end() == 0


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGKILL])
def test_a_run_that_ends_while_its_guard_starts_leaves_no_roller_at_speed(
    run, graph, number
) -> None:
    rig = run()
    rig.begin()
    graph.spin_until(lambda: children(rig.hunt.pid, 'roller_speed'))
    code = rig.end(number)
    rig.until_safe(0.0)  # no form has been heard
    assert code == (0 if number == signal.SIGINT else -number), rig.screen


def test_a_folder_that_is_deleted_takes_the_state_of_no_guard_with_it(run, graph) -> None:
    rig = run()
    rig.start()
    graph.spin_until(lambda: list((graph.folder / 'recordings').glob('.*_state.json')))
    os.kill(rig.child('roller_speed'), signal.SIGSTOP)  # it does not write it again
    shutil.rmtree(graph.folder / 'recordings', ignore_errors=True)
    rig.kill('roller_speed')
    graph.spin_until(lambda: rig.status['interlock_state'] == 'tripped', 60.0)
    rig.until_safe()
    assert rig.end() == 0


def test_a_place_for_the_log_of_ros_that_is_gone_keeps_no_guard_away(run, graph) -> None:
    place = graph.folder / 'ros'
    rig = run()
    rig.start(env={**os.environ, 'ROS_LOG_DIR': str(place)})
    shutil.rmtree(place)
    place.touch()
    rig.kill('roller_speed')
    rig.until_safe()
    assert rig.end() == 0


def test_who_presses_twice_is_told_that_the_roller_still_turns(run, graph) -> None:
    rig = run(rate=0.1)
    rig.start()
    rig.hunt.send_signal(signal.SIGINT)
    graph.spin_until(lambda: 'on its way to 5.9' in rig.screen)
    graph.spin(1.0)
    assert rig.end(signal.SIGINT) == 1
    assert rig.speed > SAFE + 0.5, 'it was not waited for'
    assert 'THE ROLLER RUNS AT 7.' in rig.screen
