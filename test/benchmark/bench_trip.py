"""
How soon the roller is told to slow down when the detector falls silent.

The speed node runs in a process of its own, on a drive that is a Modbus server on loopback, with
the interlock in `protect` and its defaults. A detector that all is well with speaks 20 times a
second, and then no more: counted is the time from its last status to the first lower set point
in the register of the drive. Then it speaks again, the interlock is armed, the profile goes on.
Both on the machine as it is, and with a busy loop beside for every core.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from runpy import run_path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger
from tables import asked, markdown, publish

from hunt_ros.cli.support.processes import claim_domain
from hunt_ros.nodes.support.conversions import diagnostic, read_diagnostic
from hunt_ros.nodes.support.qos import STATUS, latched

_ModbusServer = run_path(str(Path(__file__).parents[1] / 'conftest.py'))['ModbusServer']
_SET_POINT, _ACTUAL = 40, 50
#: Set point of the profile, as the register has it.
_RUNNING = 600
_WELL = {'amplitude_m': 1e-5, 'v_n_mps': 5.0, 'v_c_mps': 7.0}
#: Of one step of the procedure, s: on a machine that is busy a service may take its time.
_PATIENCE_S = 60.0


class Drive(_ModbusServer):  # type: ignore[misc, valid-type]
    """A drive that obeys at once, and notes when it was told what."""

    def __init__(self) -> None:
        super().__init__()
        self.told: list[tuple[float, int]] = []
        self.put(_ACTUAL, _RUNNING)

    async def _act(self, function, start, address, count, current, values) -> None:  # type: ignore[no-untyped-def]
        await super()._act(function, start, address, count, current, values)
        if values is not None:
            self.told.append((time.monotonic(), int(values[0])))
            self.put(_ACTUAL, int(values[0]))


class Bench:
    """A detector that is played, and the services of the speed node."""

    def __init__(self, drive: Drive) -> None:
        rclpy.init()
        self.drive = drive
        self.node = rclpy.create_node('bench', namespace='rig')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self._status = self.node.create_publisher(DiagnosticArray, 'hunting/status', STATUS)
        self.node.create_subscription(DiagnosticArray, 'speed/status', self._hear, latched())
        self._cause = ''
        self._sequence = 0
        self.last_s = self._asked_s = 0.0
        self._services = {
            name: self.node.create_client(Trigger, f'speed/{name}')
            for name in ('start_profile', 'resume_profile', 'rearm')
        }

    def _hear(self, message: DiagnosticArray) -> None:
        self._cause = read_diagnostic(message)['interlock_cause']

    def speak(self) -> None:
        """Say that all is well; note when."""
        self._sequence += 5
        now_ns = time.time_ns()
        values = {'sequence': self._sequence, **_WELL}
        self.last_s = time.monotonic()
        self._status.publish(diagnostic(now_ns, 'hunting', 'OK', 'quiet', values, 'rig'))

    def speak_until(self, done: Callable[[], object]) -> None:
        """Speak 20 times a second until something is so."""
        begin_s = time.monotonic()
        while not done():
            if time.monotonic() > begin_s + _PATIENCE_S:
                raise SystemExit(f'in vain for {_PATIENCE_S:g} s')
            if time.monotonic() >= self.last_s + 0.05:
                self.speak()
            self.executor.spin_once(timeout_sec=0.005)

    def ask(self, service: str) -> None:
        """Call a service again and again, speaking, until it is done."""

        def done() -> bool:
            client = self._services[service]
            if not client.service_is_ready():
                return False
            answer = client.call_async(Trigger.Request())
            self.speak_until(answer.done)
            return bool(answer.result().success)

        self.speak_until(done)

    def _runs(self) -> bool:
        """Return True at the speed of the profile, and guarded; else arm and resume."""
        told = self.drive.told
        if told and told[-1][1] == _RUNNING:
            # Silence trips it only once all has been well for a while.
            return bool(self._cause) and not self._cause.startswith('waits')
        if time.monotonic() > self._asked_s + 0.2:
            self._asked_s = time.monotonic()
            for service in ('rearm', 'resume_profile'):
                self._services[service].call_async(Trigger.Request())
        return False

    def trip_s(self) -> float:
        """Fall silent; return the time from the last status to the first lower set point, s."""
        told = self.drive.told
        self.speak_until(self._runs)
        self.speak()
        silent_s, count = self.last_s, len(told)
        while time.monotonic() < silent_s + _PATIENCE_S:
            lower = [at_s for at_s, number in told[count:] if number < _RUNNING]
            if lower:
                return lower[0] - silent_s
            time.sleep(0.002)
        raise SystemExit(f'no lower set point for {_PATIENCE_S:g} s')


def percentiles(times_s: list[float]) -> list[object]:
    """Return the median, p99 and longest of times, ms, as they are printed."""
    milliseconds = 1e3 * np.array(times_s)
    return [
        f'{value:.0f}' for value in (*np.percentile(milliseconds, [50, 99]), milliseconds.max())
    ]


def main() -> None:
    """Measure, print and publish."""
    arguments = asked(__doc__, trips=(200, 3))
    drive = Drive()
    drive.start()
    rows: list[list[object]] = []
    loops: list[subprocess.Popen[bytes]] = []
    with (
        socket.socket(socket.AF_UNIX) as claim,
        tempfile.TemporaryDirectory() as folder,
        open(os.devnull, 'wb') as nowhere,
    ):
        os.environ['ROS_DOMAIN_ID'] = str(claim_domain(claim))
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
        profile = Path(folder) / 'hold.yaml'
        profile.write_text('profile: [{hold: {speed_mps: 6.0, duration_s: 600000}}]')
        parameters = {
            'driver': 'modbus', 'port': drive.port, 'speed_register': _SET_POINT,
            'actual_register': _ACTUAL, 'profile': profile,
        }  # fmt: skip
        command = [sys.executable, '-m', 'hunt_ros.nodes.entry', 'roller_speed', '--ros-args']
        command += ['-r', '__ns:=/rig']
        for name, value in parameters.items():
            command += ['-p', f'{name}:={value}']
        node = subprocess.Popen(command, stdout=nowhere, stderr=nowhere)
        try:
            bench = Bench(drive)
            bench.ask('start_profile')
            for words, busy in (('as it is', 0), ('a busy loop a core', os.cpu_count() or 1)):
                forever = [sys.executable, '-c', 'while True: pass']
                loops += [subprocess.Popen(forever) for _ in range(busy)]
                times_s = []
                for k in range(arguments.trips):
                    times_s.append(bench.trip_s())
                    if k % 20 == 19:
                        print(f'{words}: {k + 1} of {arguments.trips}', file=sys.stderr)
                rows.append([words, len(times_s), *percentiles(times_s)])
        finally:
            for process in (node, *loops):
                process.kill()
            drive.stop()
            rclpy.try_shutdown()
    text = (
        'From the last status of a detector that falls silent to the first lower set point in the'
        " drive's register, through the real speed node, ms. `status_timeout_s` is 300 ms of it."
        ' Goal: p99 under 350 ms with the machine loaded.\n\n'
        + markdown(['machine', 'trips', 'median', 'p99', 'longest'], rows)
    )
    publish('bench-trip', 'From silence to a lower set point', text, arguments.publish)


if __name__ == '__main__':
    main()
