"""Sensors and drive on one host, detector on another: a bad line, a cut one, and a mended one."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from hunt_ros.suite import SIMULATOR, SOURCES

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
_CABLE = Path(__file__).with_name('cable.py')
_ADDRESSES = {'rig': '10.93.0.1', 'lab': '10.93.0.2'}
_DELAY_S, _LOSS = 0.05, 0.05
#: What is lost is sent again after a heartbeat, every 0.05 s, and a way there and back, and one in
#: twenty is lost again: a sensor may be silent for half of this.
_PATIENCE_S = 4.0


class Process:
    """A process on one of the hosts, and its lines as they come."""

    def __init__(self, words: list[str], log: Path) -> None:
        self.lines: list[str] = []
        pipe = subprocess.PIPE
        with log.open('w') as errors:
            self._process = subprocess.Popen(
                words, stdin=pipe, stdout=pipe, stderr=errors, text=True, cwd=log.parent
            )
        self.pid = self._process.pid
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self._process.stdout:
            self.lines.append(line.rstrip('\n'))

    def say(self, words: str) -> None:
        self._process.stdin.write(f'{words}\n')
        self._process.stdin.flush()

    def end(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(timeout=20.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    @property
    def ended(self) -> bool:
        return self._process.poll() is not None


class Hosts:
    """Two network namespaces with a cable between them."""

    def __init__(self, folder: Path, machine) -> None:
        self._folder, self._machine = folder, machine
        self._started = ExitStack()
        self._holders: dict[str, int] = {}
        self._number = 0

    def plug(self) -> None:
        """Make both and the cable; raises OSError with what the machine does not allow."""
        hold = ['sh', '-c', 'echo held; exec sleep 3600']
        first = self._hold('rig', ['unshare', '--user', '--map-root-user', '--net', *hold])
        self._hold('lab', [*_enter(first), 'unshare', '--net', *hold])
        self.cable = self._start(
            [*_enter(first), sys.executable, str(_CABLE), str(self._holders['lab'])]
        )
        self._first_line(self.cable, 'plugged')
        for name, address in _ADDRESSES.items():
            orders = (
                'link set lo up',
                f'address add {address}/24 dev cable0',
                'link set cable0 up',
            )
            for order in orders:
                words = [*_enter(self._holders[name]), 'ip', *order.split()]
                done = subprocess.run(words, capture_output=True, text=True)
                if done.returncode:
                    raise OSError(f'ip {order}: {done.stderr.strip()}')

    def _hold(self, name: str, words: list[str]) -> int:
        """Start what keeps a namespace alive; return its process."""
        holder = self._start(words)
        self._first_line(holder, 'held')
        # `unshare` becomes the program; `nsenter`, which leads to it, too.
        self._holders[name] = holder.pid
        return holder.pid

    def _first_line(self, process: Process, expected: str) -> None:
        self.wait(lambda: process.lines or process.ended, 10.0)
        if process.lines != [expected]:
            raise OSError(self._log().read_text().strip().splitlines()[-1:] or expected)

    def _log(self) -> Path:
        return self._folder / f'{self._number}.log'

    def _start(self, words: list[str]) -> Process:
        self._number += 1
        process = Process(words, self._log())
        self._started.callback(process.end)
        return process

    def start(self, host: str, *words: str) -> Process:
        """Start a process of nodes on one of them."""
        entry = [sys.executable, '-m', 'hunt_ros.nodes.entry', *words]
        return self._start([*_enter(self._holders[host]), *entry, '-r', '__ns:=/rig'])

    def order(self, *words: object) -> None:
        """Tell the cable something; return when it has done so."""
        said = ' '.join(map(str, words))
        count = len(self.cable.lines)
        self.cable.say(said)
        self.wait(lambda: len(self.cable.lines) > count, 10.0)
        assert self.cable.lines[-1] == said

    def wait(self, done: Callable[[], object], timeout_s: float) -> None:
        """Wait until a condition holds; `timeout_s`: of a quick idle machine."""

        def tails() -> list[str]:
            return [log.read_text()[-300:] for log in sorted(self._folder.glob('*.log'))]

        self._machine.until(done, timeout_s, tails)

    def close(self) -> None:
        self._started.close()


def _enter(pid: int) -> list[str]:
    words = ['nsenter', '--target', str(pid), '--user', '--net', '--preserve-credentials']
    return [*words, '--']


@pytest.fixture
def hosts(tmp_path, machine, domain, monkeypatch) -> Iterator[Hosts]:
    monkeypatch.delenv('ROS_AUTOMATIC_DISCOVERY_RANGE')
    monkeypatch.delenv('ROS_LOCALHOST_ONLY', raising=False)
    monkeypatch.setenv('PYTHONPATH', str(ROOT))
    hosts = Hosts(tmp_path, machine)
    try:
        try:
            hosts.plug()
        except OSError as error:
            pytest.skip(f'no two hosts on this machine: {error}')
        yield hosts
    finally:
        hosts.close()


def _told(console: Process, topic: str) -> list[dict[str, Any]]:
    """Return what a console has printed of a topic."""
    mark = f'{{"topic": "{topic}"'
    return [json.loads(line) for line in list(console.lines) if line.startswith(mark)]


def _rig_file(folder: Path) -> Path:
    """Write the parameters of the host at the rig."""
    path = folder / 'rig.yaml'
    of_nodes = {
        '/**': {'sample_rate_hz': 100.0},
        f'/**/{SIMULATOR}': {'initial_speed_mps': 7.2},
        '/**/roller_speed': {'interlock': 'measure', 'status_timeout_s': _PATIENCE_S},
    }
    path.write_text(
        json.dumps({name: {'ros__parameters': values} for name, values in of_nodes.items()})
    )
    return path


def test_a_line_that_delays_and_loses_and_is_cut_and_mended(hosts, tmp_path) -> None:
    hosts.order('weather', _DELAY_S, _LOSS)
    lab = hosts.start('lab', 'console', '--ros-args')
    rig = hosts.start('rig', 'console', '--ros-args')
    words = ['hunting_detector', '--ros-args', '--params-file', str(ROOT / 'bags/paper.yaml')]
    hosts.start('lab', *words, '-p', f'sensor_timeout_s:={0.5 * _PATIENCE_S}')
    words = [SIMULATOR, *SOURCES, '--ros-args', '--params-file']
    hosts.start('rig', *words, str(_rig_file(tmp_path)))

    def level() -> str:
        return _told(lab, 'hunting/status')[-1]['level']

    def interlock() -> str:
        return _told(rig, 'speed/status')[-1]['interlock_state']

    asked_s = 0.0

    def is_armed() -> bool:
        """Ask again where it was refused: the line is bad, and samples come late at times."""
        nonlocal asked_s
        if interlock() == 'tripped' and time.monotonic() - asked_s > 1.0:
            lab.say('rearm')
            asked_s = time.monotonic()
        return interlock() == 'armed'

    def watches() -> bool:
        """Return True if the interlock is armed and has heard that all is well."""
        told = _told(rig, 'speed/status')
        # A machine that is busy may have tripped it before: a person arms it again.
        return told and is_armed() and told[-1]['interlock_cause'] == 'no reason to trip'

    def is_well() -> bool:
        told = _told(lab, 'hunting/status')
        return told[-1:] and told[-1]['level'] == 'WARN' and told[-1]['region'] == 'hysteresis'

    hosts.wait(is_well, 90.0)
    hosts.wait(watches, 90.0)

    def follows() -> bool:
        """Return True if the detector knows how far the clock of the rig is off."""
        told = _told(lab, 'hunting/status')[-1]
        return float(told.get('clock_offset_s lateral', 'nan')) > 0.9 * _DELAY_S

    hosts.wait(follows, 30.0)

    hosts.order('cut')
    cut_ns = time.time_ns()
    hosts.wait(lambda: level() == 'STALE', 30.0)
    hosts.wait(lambda: interlock() == 'tripped', 30.0)
    mended_ns = time.time_ns()
    hosts.order('mend')
    hosts.wait(lambda: level() in ('OK', 'WARN'), 90.0)
    told = _told(lab, 'hunting/status')
    levels = [each['level'] for each in told if cut_ns < each['stamp_ns'] < mended_ns]
    blind = levels[levels.index('STALE') :]
    assert set(blind) == {'STALE'}, 'nobody is well who hears nothing'
    events = [event['event'] for event in _told(lab, 'hunting/events')]
    assert 'input_stale' in events
    assert 'input_recovered' in events[events.index('input_stale') :]
    assert interlock() == 'tripped', 'only a person arms it again'
    hosts.wait(is_armed, 60.0)
