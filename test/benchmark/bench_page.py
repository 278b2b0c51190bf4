"""
What the page costs: CPU of the node `dashboard` against a bare process with the same messages.

A source publishes lateral and yaw at 1 kHz, status at 20 Hz and the rest as a rig does. It is
heard, in the same minute, by the node, with none to three viewers, and by a bare rclpy
process with subscriptions that do nothing. A viewer here is a websocket that reads: what a
browser costs is not the server's. CPU is the kernel's own account of each process.
"""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from sensor_msgs.msg import JointState
from tables import markdown, publish

from hunt_ros.cli.support.processes import claim_domain
from hunt_ros.nodes.support.conversions import diagnostic, joint_layout
from hunt_ros.nodes.support.qos import STATUS, stream
from hunt_ros.nodes.support.runtime import cheapest_executor

_TICKS = os.sysconf('SC_CLK_TCK')
_VALUES = {
    'state': 'quiet',
    'region': 'hysteresis',
    **{f'number_{k}': 0.123456789 * k for k in range(60)},
    'speed_mps': 7.2,
    'amplitude_m': 1e-4,
    'amplitude_std_m': 1e-5,
    'frequency_hz': 2.8,
}


class Source(Node):
    """Publishes what a rig with sensors at 1 kHz does, in bursts of 10 ms as sensors do."""

    def __init__(self) -> None:
        super().__init__('source', namespace='rig')
        self._layouts = {name: joint_layout([name], 'rig') for name in ('lateral', 'yaw')}
        self._joints = {
            name: self.create_publisher(JointState, name, stream(1000)) for name in self._layouts
        }
        self._status = self.create_publisher(DiagnosticArray, 'hunting/status', STATUS)
        self._health = self.create_publisher(DiagnosticArray, '/diagnostics', STATUS)
        self._count = 0
        self.create_timer(0.01, self._publish)

    def _publish(self) -> None:
        now_ns = self.get_clock().now().nanoseconds
        for k in range(10):
            for name, publisher in self._joints.items():
                value = 1e-4 * ((self._count * 10 + k) % 357) / 357
                publisher.publish(self._layouts[name].encode(now_ns - (9 - k) * 10**6, value))
        if self._count % 5 == 0:
            self._status.publish(diagnostic(now_ns, 'hunting', 'OK', 'quiet', _VALUES, 'rig'))
        if self._count % 13 == 0:  # eight nodes, once a second each
            name = f'rig/node_{self._count % 8}'
            self._health.publish(diagnostic(now_ns, name, 'OK', 'well', {'rate_hz': 1000.0}, 'pc'))
        self._count += 1


class Bare(Node):
    """Hears the same, and does nothing."""

    def __init__(self) -> None:
        super().__init__('bare', namespace='rig')
        for name in ('lateral', 'yaw'):
            self.create_subscription(JointState, name, _nothing, stream(2000), raw=True)
        for name in ('hunting/status', '/diagnostics'):
            self.create_subscription(DiagnosticArray, name, _nothing, STATUS, raw=True)


def _nothing(message: bytes) -> None:
    pass


def spin(make: type[Node]) -> None:
    rclpy.init()
    executor = cheapest_executor()
    executor.add_node(make())
    while True:
        executor.spin_once(timeout_sec=0.05)


def view(port: str) -> None:
    """Read what the server sends."""
    import asyncio

    from tornado.websocket import websocket_connect

    async def read() -> None:
        link = await websocket_connect(f'ws://127.0.0.1:{port}/live')
        while await link.read_message() is not None:
            pass

    asyncio.run(read())


def cpu_s(process: subprocess.Popen) -> float:
    parts = Path(f'/proc/{process.pid}/stat').read_text().rpartition(')')[2].split()
    return (int(parts[11]) + int(parts[12])) / _TICKS


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument('--seconds', type=float, default=20.0)
    parser.add_argument('role', nargs='*')
    arguments = parser.parse_args()
    if arguments.role:
        role, *rest = arguments.role
        {'source': lambda: spin(Source), 'bare': lambda: spin(Bare), 'view': view}[role](*rest)
        return
    port = free_port()
    own = [sys.executable, __file__]
    node = [sys.executable, '-m', 'hunt_ros.nodes.entry', 'dashboard', '--ros-args']
    node += ['-r', '__ns:=/rig', '-p', f'port:={port}']
    with socket.socket(socket.AF_UNIX) as claim, tempfile.TemporaryFile() as log:
        os.environ['ROS_DOMAIN_ID'] = str(claim_domain(claim))
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
        running: list[subprocess.Popen] = []

        def start(command: list[str]) -> subprocess.Popen:
            running.append(subprocess.Popen(command, stdout=log, stderr=log))
            return running[-1]

        try:
            bare, page = start([*own, 'bare']), start(node)
            start([*own, 'source'])
            _wait_for(port)
            rows = []
            for viewers in (0, 1, 2, 3):
                if viewers:
                    start([*own, 'view', str(port)])
                time.sleep(4.0)
                before = cpu_s(bare), cpu_s(page)
                time.sleep(arguments.seconds)
                used = cpu_s(bare) - before[0], cpu_s(page) - before[1]
                percent = [100.0 * each / arguments.seconds for each in used]
                rows.append({'viewers': viewers, 'bare': percent[0], 'page': percent[1]})
                print(rows[-1], file=sys.stderr, flush=True)
        finally:
            for process in running:
                process.kill()
    publish('bench-page', "The operator's page", report(rows))


def report(rows: Sequence[Mapping[str, float]]) -> str:
    """Return the table; a further viewer is measured against the bare process beside it."""
    before = [rows[0], *rows]
    cells = [
        [
            row['viewers'],
            f'{row["bare"]:.1f}',
            f'{row["page"]:.1f}',
            f'{row["page"] / row["bare"]:.2f}',
            '-' if not row['viewers'] else f'{(row["page"] - one["page"]) / row["bare"]:.2f}',
        ]
        for one, row in zip(before, rows, strict=False)
    ]
    header = ['viewers', 'bare process, % of a core', 'page, % of a core']
    header += ['times a bare one', 'the last viewer, of a bare one']
    return (
        'A source publishes lateral and yaw at 1 kHz and all else as a rig does; a bare process'
        ' receives the same messages with empty callbacks; each viewer takes 20 updates a second.'
        ' Goals: the page at most 2 times the bare process, each further viewer half a bare one'
        f' more.\n\n{markdown(header, cells)}'
    )


def _wait_for(port: int) -> None:
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline:
        with socket.socket() as probe:
            if probe.connect_ex(('127.0.0.1', port)) == 0:
                return
        time.sleep(0.2)
    raise SystemExit('the page did not come up')


if __name__ == '__main__':
    main()
