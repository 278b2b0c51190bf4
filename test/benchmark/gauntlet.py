"""
The gauntlet: the real `hunt run` on a rig that outlives it, and whatever may happen to it.

    make gauntlet                     # SCENARIOS=20 FIRST=100: which

Each scenario has a number, and is the same one again under that number, but for what the machine
makes of it: `--first N --scenarios 1`. The rig is a process of its own (`gauntlet_rig`), the
observer is `gauntlet_judge`. Programs of others come and go all the time, as `ros2 topic list`
does. All of it runs in a network namespace of its own, in real time: the guards count on the
steady clock. A scenario in which the machine let the suite wait for too long
is not judged, and counted. In one of eight, where there is a C compiler, the clock of the machine
is set: for the suite (`set_clock.c`), and for what the rig stamps.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import pty
import random
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from pathlib import Path

import numpy as np
import rclpy
from gauntlet_judge import RULES, Deed, Witness, judge, table
from gauntlet_rig import true_limits
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import SetBool, Trigger
from tables import markdown, publish

ROOT = Path(__file__).resolve().parents[2]
_INSIDE = 'HUNT_GAUNTLET_INSIDE'
_START_S, _END_S, _AFTER_S = 120.0, 90.0, 7.0
#: A process that was killed is blind at least so long, s: longer than may pass without a call.
_KILLED_S = 2.5
_NODES = ('lateral_sensor', 'yaw_sensor', 'hunting_detector', 'bag_recorder', 'roller_speed')
_NODES += ('normal_form_identifier', 'alarm_outputs', 'console', 'hunt run')
_BLIND = ('lateral_sensor', 'yaw_sensor', 'hunting_detector', 'suite', 'roller_speed')
#: From the sensor to the call: what waits here is late.
_CHAIN = (*_BLIND, 'alarm_outputs')
_MOVING = ('start_profile', 'resume_profile')
_KEYS = ('s', 'y', ' ', 'r', 'e', 'a', 'm', 'x', 'S', '\x1b[A', '\x1bOS', '\x1bOR', 'start\n')
_CALLS = ('speed/start_profile', 'speed/stop_profile', 'speed/resume_profile', 'speed/rearm')
_CALLS += ('speed/emergency_stop', 'hunting/acknowledge_alarm', 'recording/stop')
_CALLS += ('recording/start', 'recording/split', 'identify', 'hunting/accept_normal_form')
_CALLS += ('hunting/revert_normal_form', 'alarm/test', 'disarm', 'arm')
_VISITOR = """
import random, rclpy, time
while True:
    rclpy.init()
    rclpy.create_node('visitor')
    time.sleep(random.uniform(0.2, 2.0))
    rclpy.shutdown()
    time.sleep(random.uniform(0.2, 2.0))
"""
RIG = """
/**: {{ros__parameters: {{rig_name: simulated, channels: [lateral, yaw, roller, speed],
  roller_diameter_m: 0.3, speed_ceiling_mps: 12.0, flange_clearance_m: 0.008}}}}
/**/lateral_sensor: {{ros__parameters: {{port: {port}, sample_rate_hz: 200.0}}}}
/**/yaw_sensor: {{ros__parameters: {{port: {port}, sample_rate_hz: 200.0}}}}
/**/hunting_detector: {{ros__parameters: {{sensor_timeout_s: {patience},
  output_rate_hz: 20.0}}}}
/**/bag_recorder: {{ros__parameters: {{least_free_mib: 1.0}}}}
/**/roller_speed: {{ros__parameters: {{port: {port}, interlock: protect,
  status_timeout_s: {patience}, profile: {profile}}}}}
/**/alarm_outputs: {{ros__parameters: {{command: {command}}}}}
"""


@cache
def _clock_setter() -> str:
    """Return the library that sets a clock; '' where it cannot be made."""
    made = Path(tempfile.mkdtemp(prefix='gauntlet_clock_')) / 'set_clock.so'
    words = ['cc', '-shared', '-fPIC', '-o', str(made), str(ROOT / 'test/benchmark/set_clock.c')]
    with suppress(OSError):
        subprocess.run([*words, '-ldl'], check=False)
    return str(made) if made.exists() else ''


class Scenario:
    """One run of the suite, what happens to it, and what was seen."""

    def __init__(self, number: int, patience_s: float, folder: Path) -> None:
        self.random = random.Random(number)
        self.number, self.folder = number, folder
        self.began_s = time.time()
        self.deeds: list[Deed] = []
        self.requests: list[float] = []
        self.stops: list[float] = []
        self.waits: list[tuple[float, float]] = []
        self.kills: list[float] = []
        self.broken: dict[tuple[str, str], Deed] = {}
        self.emergency, self.disarmed_s = False, math.inf
        self.ended = True
        self.full = self.random.random() < 0.1
        faultless = self.random.random() < 0.12
        self.top_mps = self.random.uniform(6.6, 7.1 if faultless else 8.5)
        self.faults = [] if faultless else self.random.choices(FAULTS, k=self.random.randint(1, 3))
        if self.full and self.faults:
            self.faults[0] = _fill
        # Drawn beside the rest, which is the same with and without it.
        drawn = random.Random(f'clock {number}').random() < 0.125
        self.clock = folder / 'clock' if drawn and self.faults and _clock_setter() else None
        if self.clock:
            self.faults.append(_set_clock)
            self.clock.write_bytes(bytes(8))
        self.form = self.random.choice(list(FORMS)) if self._drawn(0.25, faultless) else 'right'
        self.one_process = self.random.random() < 0.2
        self.recordings = folder / 'recordings'
        self.recordings.mkdir()
        if self.full:
            subprocess.run(
                ['mount', '-t', 'tmpfs', '-o', 'size=24m', 'tmpfs', self.recordings], check=True
            )
        with socket.socket() as probe:
            probe.bind(('127.0.0.1', 0))
            self.port = probe.getsockname()[1]
        self._write(patience_s)
        self._start_rig()
        self._waited: dict[int, int] = {}
        self._over = threading.Event()
        threading.Thread(target=self._look_at_machine, daemon=True).start()

    def _drawn(self, share: float, never: bool) -> bool:
        return self.random.random() < share and not never

    def _write(self, patience_s: float) -> None:
        command, profile = self.folder / 'call.sh', self.folder / 'profile.yaml'
        command.write_text(
            f'#!/bin/sh\necho "$(LD_PRELOAD= date +%s.%N) $1 $2" >> {self.folder}/calls\n'
        )
        command.chmod(0o755)
        hold = f'{{speed_mps: {self.top_mps:.3f}, duration_s: 100000, rate_mps2: 1.0}}'
        profile.write_text(f'profile:\n- hold: {hold}\n')
        given = {'port': self.port, 'patience': patience_s, 'profile': profile, 'command': command}
        (self.folder / 'rig.yaml').write_text(RIG.format(**given))
        form = (ROOT / 'bags' / 'paper.yaml').read_text()
        for before, after in FORMS[self.form]:
            form = form.replace(before, after)
        (self.folder / 'form.yaml').write_text(form)

    def _start_rig(self) -> None:
        words = [sys.executable, str(Path(__file__).with_name('gauntlet_rig.py')), str(self.port)]
        words += [str(self.number), '5.0', str(self.folder / 'truth.npz')]
        self.rig = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self.rig.stdout is not None
        self.rig.stdout.readline()

    def tell(self, *order: object) -> None:
        """Have the rig obey."""
        assert self.rig.stdin is not None
        assert self.rig.stdout is not None
        self.rig.stdin.write(json.dumps(order).encode() + b'\n')
        self.rig.stdin.flush()
        self.rig.stdout.readline()

    def start(self) -> None:
        """Start `hunt run` on a terminal, or with its output in a file."""
        words = [sys.executable, '-u', '-m', 'hunt_ros.cli.main', 'run']
        words += ['--rig', str(self.folder / 'rig.yaml'), '--directory', str(self.recordings)]
        if self.form != 'none':
            words += ['--normal-form', str(self.folder / 'form.yaml')]
        words += ['--one-process'] * self.one_process
        self.keyboard = -1
        environment = dict(os.environ)
        if self.clock:
            environment |= {'LD_PRELOAD': _clock_setter(), 'CLOCK_FILE': str(self.clock)}
        begin = partial(subprocess.Popen, words, env=environment, start_new_session=True)
        out = (self.folder / 'screen').open('ab')
        if self.random.random() < 0.3:
            self.keyboard, terminal = pty.openpty()
            self.run = begin(stdin=terminal, stdout=terminal, stderr=out)
            os.close(terminal)
            threading.Thread(target=self._drain, args=(self.keyboard,), daemon=True).start()
        else:
            self.run = begin(stdin=subprocess.DEVNULL, stdout=out, stderr=out)

    def _drain(self, keyboard: int) -> None:
        with suppress(OSError):
            while os.read(keyboard, 1 << 16):
                pass

    def pids(self) -> dict[str, int]:
        """Return the processes of the suite by their names."""
        found = {'hunt run': self.run.pid}
        for path in Path('/proc').glob('[0-9]*'):
            with suppress(OSError, ValueError, IndexError):
                parent = int((path / 'stat').read_text().rpartition(')')[2].split()[1])
                words = (path / 'cmdline').read_text().split('\0')
                if parent == self.run.pid and 'hunt_ros.nodes.entry' in words:
                    names = words[
                        words.index('hunt_ros.nodes.entry') + 1 : words.index('--ros-args')
                    ]
                    found[names[0] if len(names) == 1 else 'suite'] = int(path.name)
        return found

    def _look_at_machine(self) -> None:
        """Note how long the slowest from sensor to call waits for a processor."""
        while not self._over.wait(0.25):
            longest = 0.0
            pids = self.pids() if hasattr(self, 'run') else {}
            for pid in (self.rig.pid, *(pids[name] for name in _CHAIN if name in pids)):
                waited = 0
                for path in Path(f'/proc/{pid}/task').glob('*/schedstat'):
                    with suppress(OSError):
                        waited = max(waited, int(path.read_text().split()[1]))
                passed = waited - self._waited.get(pid, waited)
                self._waited[pid] = waited
                longest = max(longest, passed * 1e-9)
            self.waits.append((time.time(), longest))

    def note(self, kind: str, what: str, lasts_s: float = math.inf, **about: bool) -> None:
        """Note what is done now."""
        now_s = time.time()
        self.deeds.append(Deed(kind, what, now_s, now_s + lasts_s, **about))
        print(f'  {now_s - self.began_s:5.1f} s {kind}: {what}', flush=True)

    def kick(self) -> None:
        """Hit the wheelset."""
        size_m = self.random.uniform(0.2e-3, 2.5e-3) * self.random.choice((-1.0, 1.0))
        self.note('kick', f'{1e3 * size_m:.2f} mm')
        self.tell('kick', size_m)

    def ask(self, operator: Operator, word: str) -> None:
        """Press what a person may press."""
        now_s = time.time()
        if word.removeprefix('speed/') in _MOVING or word in ('s', 'r', 'y'):
            self.requests.append(now_s)
        if word in ('speed/stop_profile', 'speed/emergency_stop', ' ', 'e'):
            self.stops.append(now_s)
        self.emergency |= word in ('speed/emergency_stop', 'e')
        if word == 'disarm':
            self.disarmed_s = min(self.disarmed_s, now_s)
        self.note('operator', repr(word))
        if word in _KEYS:
            with suppress(OSError):
                os.write(self.keyboard, word.encode())
        else:
            operator.call(word)

    def begin(self, operator: Operator) -> bool:
        """Start the suite and the profile; return False where it does not come to that."""
        self.start()
        deadline = time.monotonic() + _START_S
        while time.monotonic() < deadline and self.run.poll() is None:
            answer = operator.call('speed/start_profile', wait_s=3.0)
            self.requests.append(time.time())
            if answer:
                return True
            time.sleep(0.5)
        print((self.folder / 'screen').read_text(errors='replace')[-2000:])
        return False

    def end(self, number: int = signal.SIGINT) -> None:
        """End the suite as a person does."""
        if self.run.poll() is None:
            self.run.send_signal(signal.SIGCONT)  # one that is stopped hears nothing
            self.run.send_signal(number)
        try:
            self.run.wait(_END_S)
        except subprocess.TimeoutExpired:
            self.ended = False
        for pid in self.pids().values():
            with suppress(ProcessLookupError):
                if not self.ended:
                    os.kill(pid, signal.SIGKILL)

    def play(self, operator: Operator) -> Witness:
        """Let it happen; return what was seen."""
        started_s = time.time()
        if self.begin(operator):
            started_s = time.time()
            time.sleep(self.top_mps - 5.0 + self.random.uniform(1.0, 4.0))
            if self.form not in ('right', 'none'):
                self.note(f'form: {self.form}', 'since the start')
            acts = [*self.faults]
            if self.faults:
                acts += [Scenario.kick] * self.random.choice((0, 1, 1))
            self.random.shuffle(acts)
            mends = []
            for act in acts:
                mend = act(self, operator) if act is not Scenario.kick else self.kick()
                mends += [mend] if mend and self.random.random() < 0.6 else []
                time.sleep(self.random.uniform(0.3, 4.0))
                while mends and self.random.random() < 0.5:
                    mends.pop(0)()
            time.sleep(_AFTER_S if acts else 25.0)
            for mend in mends:
                mend()
            time.sleep(1.0)
        else:
            self.began_s = math.nan
        for pid in self.pids().values():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)
        self.stops.append(time.time())
        self.end()
        return self._witness(started_s if not math.isnan(self.began_s) else math.inf)

    def _witness(self, started_s: float) -> Witness:
        ended_s = time.time()
        time.sleep(1.0)
        self._over.set()
        assert self.rig.stdin is not None
        self.rig.stdin.close()
        self.rig.wait(30.0)
        seen = np.load(self.folder / 'truth.npz')
        calls, path = [], self.folder / 'calls'
        for line in path.read_text().splitlines() if path.exists() else ():
            at, condition, *_ = line.split()
            calls.append((float(at), condition))
        return Witness(
            seen['truth'],
            seen['set_points'].reshape(-1, 2),
            calls,
            self.deeds,
            self.requests,
            self.stops,
            np.array(self.waits),
            (started_s, ended_s),
            self.ended,
            {path: _read(path) for path in self.folder.rglob('*.mcap')},
            self.kills,
            self.emergency,
            self.disarmed_s,
        )


Fault = Callable[[Scenario, 'Operator'], Callable[[], object] | None]
Order = tuple[str, str, float]


def _broken(kind: str, where: str, order: Order, blind: bool = True) -> Fault:
    """
    Return what breaks a part of the rig.

    `where`: one of these, or all that are joined by +; `order`: without the part itself. What was
    broken there before gives way.
    """

    def begin(scene: Scenario, operator: Operator) -> Callable[[], object]:
        names = scene.random.choice(where.split())
        scene.note(kind, names.lower(), blind=blind, drive=names == 'DRIVE')
        deed, (part, *values) = scene.deeds[-1], order
        for name in names.split('+'):
            place = () if part == 'drive' else (name,)
            scene.broken.pop((part, name), deed).end_s = time.time()
            scene.broken[part, name] = deed
            scene.tell(part, *place, *values)
        deed.end_s = math.inf

        def mend() -> None:
            if all(scene.broken.get((part, name)) is deed for name in names.split('+')):
                for name in names.split('+'):
                    scene.tell(part, *(() if part == 'drive' else (name,)), 'well', 0.0)
                deed.end_s = time.time()

        return mend

    return begin


def _kill(scene: Scenario, operator: Operator) -> None:
    pids = scene.pids()
    name = scene.random.choice([name for name in (*_NODES, 'suite') if name in pids])
    _note_kill(scene, name, 'killed', _KILLED_S)
    with suppress(ProcessLookupError):
        os.kill(pids[name], signal.SIGKILL)


def _note_kill(scene: Scenario, name: str, how: str, lasts_s: float) -> None:
    scene.note(f'{name} {how}', '', lasts_s, blind=name in _BLIND, drive=name == 'roller_speed')
    if name in ('roller_speed', 'hunt run'):
        scene.stops.append(time.time())
    if name in ('bag_recorder', 'suite') and not (scene.full or scene.clock):
        scene.kills.append(time.time())


def _stop(scene: Scenario, operator: Operator) -> Callable[[], object]:
    pids = scene.pids()
    name = scene.random.choice([name for name in (*_NODES, 'suite') if name in pids])
    # What `hunt run` has started it ends, and starts it again.
    _note_kill(scene, name, 'stopped', math.inf if name == 'hunt run' else _KILLED_S)
    deed = scene.deeds[-1]
    with suppress(ProcessLookupError):
        os.kill(pids[name], signal.SIGSTOP)

    def go_on() -> None:
        with suppress(ProcessLookupError):
            os.kill(pids[name], signal.SIGCONT)
        if name == 'hunt run':
            deed.end_s = time.time()

    return go_on


def _operate(scene: Scenario, operator: Operator) -> None:
    words = _KEYS if scene.keyboard >= 0 and scene.random.random() < 0.7 else _CALLS
    for _ in range(scene.random.randint(1, 8)):
        scene.ask(operator, scene.random.choice(words))
        time.sleep(scene.random.uniform(0.05, 1.0))


def _fill(scene: Scenario, operator: Operator) -> Callable[[], object] | None:
    if not scene.full:
        return _move(scene, operator)
    scene.note('disk full', '')
    block = scene.recordings / 'other'
    with suppress(OSError), block.open('wb') as file:
        while True:
            file.write(bytes(1 << 16))
            file.flush()
    return lambda: block.unlink(missing_ok=True)


def _move(scene: Scenario, operator: Operator) -> None:
    """Tidy up: the folder of the recordings gets another name."""
    scene.note('folder moved', '')
    scene.recordings.rename(scene.folder / f'tidied_{len(scene.deeds)}')


def _set_clock(scene: Scenario, operator: Operator) -> None:
    """Set the clock of the machine, by up to an hour."""
    size_s = 10.0 ** scene.random.uniform(-0.5, 3.5)
    step_s = round(scene.random.choice((-1.0, 1.0)) * size_s, 1)
    scene.note('clock set', f'{step_s:+.1f} s')
    assert scene.clock is not None
    with scene.clock.open('r+b') as file:  # it is in the memory of the suite
        file.write(struct.pack('q', round(1e9 * step_s)))
    scene.tell('clock', step_s)


def _again(scene: Scenario, operator: Operator) -> None:
    """End the suite, and start it again: nothing may move before a person says so."""
    scene.note('run ended, started again', '')
    scene.stops.append(time.time())
    scene.end(scene.random.choice((signal.SIGTERM, signal.SIGHUP, signal.SIGINT)))
    scene.start()
    time.sleep(12.0)


FORMS = {
    'right': (),
    'none': (),
    'late': (('v_c: 8.0', 'v_c: 12.0'),),
    'early': (('v_c: 8.0', 'v_c: 6.0'),),
    'too small': (('D10: -360.0', 'D10: -3600.0'), ('D15: -42000000.0', 'D15: -4200000000.0')),
    'no fold': (('D10: -360.0', 'D10: 360.0'),),
}
_ONE, _ANY = 'LATERAL YAW', 'LATERAL YAW DRIVE'
FAULTS: list[Fault] = [
    _broken('sensor frozen', _ONE, ('sensor', 'frozen', 0.0)),
    _broken('sensor tells no number', _ONE, ('sensor', 'nan', 0.0)),
    _broken('sensor has lost its target', _ONE, ('sensor', 'lost', 0.0), blind=False),
    _broken('sensor noisy', _ONE, ('sensor', 'noisy', 100.0), blind=False),
    _broken('sensors swapped', 'LATERAL+YAW', ('sensor', 'swapped', 0.0), blind=False),
    _broken('sensor mis-scaled', _ONE, ('sensor', 'scaled', 0.5), blind=False),
    _broken('sensor mis-scaled', _ONE, ('sensor', 'scaled', 3.0), blind=False),
    _broken('link mute', _ANY, ('cable', 'mute', 0.0)),
    _broken('link cut', _ANY, ('cable', 'cut', 0.0)),
    _broken('link slow', _ANY, ('cable', 'well', 0.25), blind=False),
    _broken('link slow', _ANY, ('cable', 'well', 1.0), blind=False),
    _broken('drive ignores set points', 'DRIVE', ('drive', 'deaf', 0.0), blind=False),
    _broken('drive is faster than told', 'DRIVE', ('drive', 'faster', 1.3), blind=False),
    _broken('drive reports less', 'DRIVE', ('drive', 'reports', 0.85), blind=False),
    _broken('drive tells no speed', 'DRIVE', ('drive', 'silent', 0.0)),
    *[_kill] * 5,
    *[_stop] * 5,
    *[_operate] * 3,
    _fill,
    _again,
]


class Operator:
    """Calls services, and does not wait for what does not answer."""

    def __init__(self) -> None:
        rclpy.init()
        self._node = rclpy.create_node('operator', namespace='rig')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._clients = {
            word: self._node.create_client(Trigger, word)
            for word in _CALLS
            if word not in ('arm', 'disarm')
        }
        self._switch = self._node.create_client(SetBool, 'speed/arm_interlock')

    def call(self, word: str, wait_s: float = 0.3) -> bool:
        """Call a service; return True if it answers in time that it is done."""
        switch = word in ('arm', 'disarm')
        client = self._switch if switch else self._clients[word]
        request = SetBool.Request(data=word == 'arm') if switch else Trigger.Request()
        if not client.service_is_ready():
            self._executor.spin_once(timeout_sec=0.0)
            return False
        future = client.call_async(request)
        self._executor.spin_until_future_complete(future, wait_s)
        return bool(future.done() and future.result().success)


def _read(path: Path) -> tuple[float, float] | str:
    """Return begin and end of the samples of a file, s; or why it cannot be read."""
    from hunt_ros.bag import read_record

    try:
        stamps = [series.stamps_ns for series in read_record(path).values()]
    except Exception as error:
        # A reader that joins late may wait for seconds for the middleware: sound, and empty.
        empty = 'hold no messages' in str(error)
        return (math.inf, -math.inf) if empty else f'{type(error).__name__}: {error}'
    return min(each[0] for each in stamps) * 1e-9, max(each[-1] for each in stamps) * 1e-9


def one(number: int, patience_s: float, operator: Operator, truth: tuple[float, float]) -> dict:
    """Play a scenario; return what came of it."""
    print(f'scenario {number}', flush=True)
    folder = Path(tempfile.mkdtemp(prefix=f'gauntlet_{number}_'))
    scene = Scenario(number, patience_s, folder)
    try:
        seen = scene.play(operator)
        violations, unjudged = judge(seen, *truth)
    finally:
        if scene.full:
            subprocess.run(['umount', '-l', scene.recordings], check=False)
    result = {
        'number': number,
        'kinds': [deed.kind for deed in seen.deeds],
        'violations': {} if unjudged else violations,
        'unjudged': unjudged,
        'rig_s': max(0.0, seen.run_s[1] - seen.run_s[0]) if not unjudged else 0.0,
    }
    words = f'not judged: {unjudged}' if unjudged else violations or 'no violation'
    late_s = seen.late_s(*seen.run_s) if not unjudged else 0.0
    print(
        f'  form {scene.form}, {scene.top_mps:.2f} m/s, {np.diff(seen.run_s)[0]:.0f} s, late'
        f' {late_s:.1f} s: {words}',
        flush=True,
    )
    if violations:
        print(f'  kept in {folder}', flush=True)
    else:
        shutil.rmtree(folder, ignore_errors=True)
    return result


def main() -> None:
    """Play the scenarios, print the table; exit code 1 where a rule was violated."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--first', type=int, default=0, help='number of the first scenario')
    parser.add_argument('--scenarios', type=int, default=500)
    parser.add_argument(
        '--patience',
        type=float,
        default=0.5,
        help='limits of silence, s: of a machine that is busy',
    )
    parser.add_argument('--results', type=Path, help='file that collects results of several calls')
    parser.add_argument('--publish', action='store_true', help='into docs/faults.md')
    arguments = parser.parse_args()
    if _INSIDE not in os.environ:
        alone = ['unshare', '--net', '--mount', '--pid', '--fork', '--kill-child', '--mount-proc']
        alone += ['--map-root-user'] if os.getuid() else []
        # Of the memory, too: the middleware of others on this machine would meet there.
        alone += ['sh', '-c', 'ip link set lo up; mount -t tmpfs tmpfs /dev/shm; exec "$@"', 'sh']
        os.environ[_INSIDE] = '1'
        os.execvp(alone[0], [*alone, sys.executable, *sys.argv])
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup has it ignored, by `hunt run` too
    truth, operator = true_limits(), Operator()
    results = []
    path = arguments.results
    if path and path.exists():
        results = [json.loads(line) for line in path.read_text().splitlines()]
    subprocess.Popen([sys.executable, '-c', _VISITOR])  # the end of the namespace is its own
    for number in range(arguments.first, arguments.first + arguments.scenarios):
        result = one(number, arguments.patience, operator, truth)
        results.append(result)
        if path:
            with path.open('a') as file:
                file.write(json.dumps(result) + '\n')
    text = report(results, truth, arguments.patience)
    publish('gauntlet', 'The gauntlet', text, arguments.publish, ROOT / 'docs' / 'faults.md')
    sys.exit(any(result['violations'] for result in results))


def report(results: list[dict], truth: tuple[float, float], patience_s: float) -> str:
    """Return the table and what its letters mean."""
    rules = '\n'.join(f'- {letter}: {words}' for letter, words in RULES.items())
    minutes = sum(result['rig_s'] for result in results) / 60.0
    lines = markdown(['fault', 'scenarios', 'not judged', *RULES], table(results))
    return (
        f'{len(results)} scenarios of `hunt run`, {minutes:.0f} min of the rig that were judged;'
        f' true v_n {truth[0]:.2f} m/s, limits of silence {patience_s:g} s. A scenario stands in'
        ' the row of each fault that it had. Violations of the rules, which are:\n\n'
        f'{rules}\n\n{lines}'
    )


if __name__ == '__main__':
    main()
