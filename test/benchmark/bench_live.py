"""
What the live suite costs: CPU and memory of every process, latency, messages lost.

Seven real nodes on the simulated rig, one minute at each sensor rate. CPU and
memory are the kernel's own accounts of each process; latency is from a sample's
stamp to the arrival, in another process, of the first amplitude message that
contains it.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState
from tables import markdown, publish

from hunt_ros.cli import suite
from hunt_ros.cli.processes import Processes
from hunt_ros.nodes.conversions import JointReader, read_diagnostic
from hunt_ros.nodes.qos import STATUS, stream

RATES_HZ = (500.0, 1000.0, 2000.0)
ORDER = ('rig_simulator', 'lateral_sensor', 'yaw_sensor', 'roller_speed', *sorted(suite.LISTENERS))
#: Who loses what: nodes, and the value in their diagnostics.
_LOSSES = {
    'sensors': (('lateral_sensor', 'yaw_sensor'), 'lost'),
    'detector': (('hunting_detector',), 'dropped'),
    'recorder': (('bag_recorder',), 'dropped'),
}
_TICKS = os.sysconf('SC_CLK_TCK')


@dataclass
class Usage:
    """CPU seconds and peak resident memory (MB) of a process so far."""

    cpu_s: float
    memory_mb: float

    @classmethod
    def of(cls, pid: int) -> Usage:
        parts = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
        status = Path(f'/proc/{pid}/status').read_text()
        memory = int(status.partition('VmHWM:')[2].split()[0]) / 1024.0
        return cls((int(parts[11]) + int(parts[12])) / _TICKS, memory)


class Probe:
    """Listens to the amplitude and to the nodes' health, and notes when messages came."""

    def __init__(self) -> None:
        rclpy.init()
        self._node = rclpy.create_node('bench_probe', namespace='rig')
        self._reader = JointReader('lateral_amplitude')
        self.arrivals: list[tuple[int, int]] = []
        self.health: dict[str, dict[str, str]] = {}
        self._node.create_subscription(
            JointState, 'hunting/amplitude', self._on_amplitude, stream(1000), raw=True
        )
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_health, STATUS)
        try:
            from rclpy.experimental import EventsExecutor

            self._executor = EventsExecutor()
        except ImportError:
            self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)

    def spin(self, seconds: float) -> None:
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.05)

    def _on_amplitude(self, wire: bytes) -> None:
        now_ns = time.time_ns()
        found = self._reader.read(wire)
        if found is not None:
            self.arrivals.append((now_ns, found[0]))

    def _on_health(self, message: DiagnosticArray) -> None:
        health = read_diagnostic(message)
        self.health[health['name'].rsplit('/', 1)[-1]] = health

    def latencies_ms(self, rate_hz: float) -> np.ndarray:
        """Latency of every sample: stamps are taken as evenly spaced between two estimates."""
        arrivals, stamps = np.array(self.arrivals, dtype=np.int64).T
        spans = np.diff(stamps)
        count = np.maximum(1, np.rint(spans * 1e-9 * rate_hz).astype(int))
        ages = [
            (arrival - stamp + span * np.arange(n) / n) * 1e-6
            for arrival, stamp, span, n in zip(arrivals[1:], stamps[1:], spans, count, strict=True)
        ]
        return np.concatenate(ages)

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown()


def measure(rate_hz: float, seconds: float) -> dict[str, object]:
    """Run the suite at one rate; return the figures."""
    port = suite.free_port()
    rate: dict[str, object] = {'sample_rate_hz': rate_hz, 'port': port}
    with tempfile.TemporaryDirectory() as folder:
        directory = {'directory': folder}
        parameters = {
            'rig_simulator': {**rate, 'initial_speed_mps': 7.2},
            'lateral_sensor': rate,
            'yaw_sensor': rate,
            'roller_speed': {'port': port},
            'bag_recorder': directory,
            'normal_form_identifier': directory,
        }
        with Processes('rig', Path(folder) / 'logs', private=True) as processes:
            os.environ |= {
                key: processes.environment[key]
                for key in ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE')
            }
            probe = Probe()
            suite.start_nodes(processes, suite.LISTENERS, {}, parameters)
            suite.start_nodes(processes, ['rig_simulator', *suite.SOURCES], {}, parameters)
            pids = processes.pids()
            probe.spin(15.0)  # start-up and compilation
            probe.arrivals.clear()
            before = {name: Usage.of(pid) for name, pid in pids.items()}
            earlier = dict(probe.health)
            began = time.monotonic()
            probe.spin(seconds)
            elapsed = time.monotonic() - began
            after = {name: Usage.of(pid) for name, pid in pids.items()}
            probe.spin(1.5)  # one more report of everybody's health
            latencies = (
                probe.latencies_ms(rate_hz) if len(probe.arrivals) > 2 else np.array([np.nan])
            )
            health = probe.health
            probe.close()
    return {
        'cpu': {n: 100.0 * (after[n].cpu_s - before[n].cpu_s) / elapsed for n in pids},
        'memory': {n: after[n].memory_mb for n in pids},
        'latency': (
            float(np.median(latencies)),
            float(np.quantile(latencies, 0.99)),
            float(latencies.max()),
        ),
        'lost': {
            who: sum(int(health[n][key]) - int(earlier[n][key]) for n in nodes)
            for who, (nodes, key) in _LOSSES.items()
        },
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=60.0)
    seconds = parser.parse_args().seconds
    results = {rate: measure(rate, seconds) for rate in RATES_HZ}
    header = ['', *(f'{rate:.0f} Hz' for rate in RATES_HZ)]
    rows: list[list[object]] = []
    for name in ORDER:
        rows.append(
            [f'{name}, % of a core'] + [round(r['cpu'][name], 1) for r in results.values()]
        )
    totals = [round(sum(r['cpu'].values()), 1) for r in results.values()]
    rows.append(['**seven nodes, % of a core**', *totals])
    for k, what in enumerate(('median', '99 %', 'worst')):
        rows.append(
            [f'latency {what}, ms'] + [round(r['latency'][k], 1) for r in results.values()]
        )
    for who in _LOSSES:
        rows.append([f'lost, {who}'] + [r['lost'][who] for r in results.values()])
    memory = [round(sum(r['memory'].values())) for r in results.values()]
    rows.append(['memory, seven nodes, MB', *memory])
    text = (
        f'Sensors at the rate of the column, speed and roller at 100 Hz, estimates at 100 Hz;'
        f' {seconds:.0f} s each. Latency is from the stamp of a sample to the arrival of the first'
        f' amplitude message that contains it, so the period of the estimates (10 ms) is part of'
        f' it.\n\n{markdown(header, rows)}'
    )
    publish('bench-live', 'The live suite', text)


if __name__ == '__main__':
    main()
