"""Real nodes in processes of their own, on a ROS graph nobody else is in."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

rclpy = pytest.importorskip('rclpy', reason='the extra ros is not installed')

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from rcl_interfaces.srv import SetParameters  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.signals import SignalHandlerOptions  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from hunt_ros.cli.support.processes import claim_domain  # noqa: E402
from hunt_ros.cli.support.suite import free_port  # noqa: E402
from hunt_ros.compiled import compile_all  # noqa: E402
from hunt_ros.nodes.support.caller import INTRODUCED_S  # noqa: E402
from hunt_ros.nodes.support.conversions import read_diagnostic, to_ns  # noqa: E402

sys.path.insert(0, str(Path(__file__).parent))  # for what several tests share

#: The tree under test, also for the nodes, which run in a folder of their own.
ROOT = Path(__file__).resolve().parents[2]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """All tests of this room need ROS."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker('ros')


class Told(list[dict[str, str]]):
    """Statuses as texts, as they came: level, name, message, stamp_ns, and the values of each."""

    @property
    def last(self) -> dict[str, str]:
        return self[-1] if self else {}

    @property
    def events(self) -> list[str]:
        return [one['event'] for one in self]

    def says(self, words: str = '', **values: str) -> bool:
        """Return True if a status has these values, and the words in its message."""
        return any(words in one['message'] and values.items() <= one.items() for one in self)


class Graph:
    """One ROS graph: starts nodes, listens to topics, calls services."""

    def __init__(self, folder: Path, machine) -> None:
        self.folder = folder
        self.machine = machine
        self.port = free_port()
        self._processes: dict[str, subprocess.Popen[str]] = {}
        self._clients: dict[tuple[type, str], object] = {}
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = rclpy.create_node('probe', namespace='rig', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    @staticmethod
    def _words(module: str, *files: Path, **parameters: object) -> list[str]:
        words = [sys.executable, '-m', 'hunt_ros.nodes.entry', module, '--ros-args']
        words += ['-r', '__ns:=/rig']
        for path in files:
            words += ['--params-file', str(path)]
        for name, value in parameters.items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            words += ['-p', f'{name}:={text}']
        return words

    def start(self, module: str, *files: Path, **parameters: object) -> subprocess.Popen[str]:
        with self.log(module).open('w') as log:
            process = subprocess.Popen(
                self._words(module, *files, **parameters),
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                text=True,
                cwd=self.folder,
            )
        self._processes[module] = process
        return process

    def orphan(self, module: str, speaks: Callable[[], object], **parameters: object) -> int:
        """Start a node whose starter dies once it speaks, interrupt it, and return its process."""
        starter = ['sh', '-c', '"$@" & echo $!; wait', 'sh', *self._words(module, **parameters)]
        with subprocess.Popen(starter, stdout=subprocess.PIPE, text=True) as started:
            node = int(started.stdout.readline())
            self.spin_until(speaks, 60.0)
            started.kill()
            os.kill(node, signal.SIGINT)
        return node

    def profile(self, *steps: str) -> Path:
        """Write a speed profile of these steps, and return its file."""
        path = self.folder / 'profile.yaml'
        path.write_text('profile:\n' + ''.join(f'- {step}\n' for step in steps))
        return path

    def beside(self, name: str):
        """Return another node of the probe's process and namespace."""
        return rclpy.create_node(name, namespace='rig', context=self._context)

    def log(self, module: str) -> Path:
        return self.folder / f'{module}.log'

    def collect(self, kind: type, topic: str, qos: object = 1000) -> list:
        """Return a list that fills with the messages of a topic while the graph spins."""
        messages: list = []
        self.node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def told(self, topic: str = '/diagnostics', qos: object = 1000, of: str = '') -> Told:
        """Return what fills with the statuses of a topic, those `of` a node alone if given."""
        told = Told()

        def take(message: DiagnosticArray) -> None:
            texts = read_diagnostic(message)
            if texts.get('name', '').endswith(of):
                told.append({**texts, 'stamp_ns': str(to_ns(message.header.stamp))})

        self.node.create_subscription(DiagnosticArray, topic, take, qos)
        return told

    def spin(self, seconds: float) -> None:
        """Let time pass; to wait for something, use `spin_until`."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.05)

    def spin_until(self, done: Callable[[], object], timeout_s: float = 30.0) -> None:
        """Spin until a condition holds; `timeout_s`: of a quick idle machine."""
        deadline = self.machine.deadline(timeout_s)
        while not done():
            assert not deadline.passed, f'in vain {deadline}; {self.tails()}'
            self._executor.spin_once(timeout_sec=0.05)

    def client(self, kind: type, service: str):
        """Return the client of a service; each that the node has makes its spinning slower."""
        key = kind, service
        if key not in self._clients:
            self._clients[key] = self.node.create_client(kind, service)
        return self._clients[key]

    def ask(self, kind: type, service: str, timeout_s: float = 30.0, **request: object):
        """Return the answer of a service, once that is there and knows who asks."""
        known = (kind, service) in self._clients
        client = self.client(kind, service)
        self.spin_until(client.service_is_ready, timeout_s)
        if not known:
            self.spin(INTRODUCED_S)
        future = client.call_async(kind.Request(**request))
        self.spin_until(future.done, timeout_s)
        return future.result()

    def call(self, service: str, timeout_s: float = 30.0) -> Trigger.Response:
        return self.ask(Trigger, service, timeout_s)

    def set_parameters(self, node: str, **values: object) -> str:
        """Set parameters of a node that runs; return '' or why it refuses one."""
        wanted = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
        ]
        answer = self.ask(SetParameters, f'{node}/set_parameters', parameters=wanted)
        return '; '.join(each.reason for each in answer.results if not each.successful)

    def end(self, module: str, number: int = signal.SIGINT, timeout_s: float = 15.0) -> int:
        self._processes[module].send_signal(number)
        return self.wait(module, timeout_s)

    def wait(self, module: str, timeout_s: float = 30.0) -> int:
        """Return the exit code of a node that is expected to end."""
        code = self.machine.wait_for(self._processes[module], timeout_s)
        del self._processes[module]
        return code

    def tails(self) -> str:
        """Return the last lines of every node, for a failing assertion."""
        logs = (self.log(module) for module in self._processes)
        return '; '.join(f'{log.name}: {log.read_text()[-300:]!r}' for log in logs)

    def close(self) -> None:
        for process in self._processes.values():
            process.terminate()
        for process in self._processes.values():
            try:
                process.wait(timeout=10.0 * self.machine.slowness)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture(scope='session', autouse=True)
def _machine_code() -> None:
    """Have the kernels compiled, as `make install` has them: nodes compile nothing."""
    compile_all()


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Enter a ROS domain that no other test, and no demo, on this machine is in."""
    with socket.socket(socket.AF_UNIX) as claim:
        number = claim_domain(claim)
        monkeypatch.setenv('ROS_DOMAIN_ID', str(number))
        monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        yield number


@pytest.fixture
def graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, machine, domain) -> Iterator[Graph]:
    monkeypatch.setenv('PYTHONPATH', str(ROOT), prepend=os.pathsep)
    graph = Graph(tmp_path, machine)
    yield graph
    graph.close()


class Resident:
    """A node that runs in the process of the test, in a thread, on a graph of its own."""

    def __init__(self, make: Callable[[], object], **parameters: object) -> None:
        words = ['--ros-args', '-r', '__ns:=/rig']
        for name, value in parameters.items():
            words += ['-p', f'{name}:={str(value).lower() if value in (True, False) else value}']
        rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
        try:
            self.node = make()
        except BaseException:
            rclpy.shutdown()
            raise
        if hasattr(self.node, 'begin'):
            self.node.begin()
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._running = True
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        while self._running:
            self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        self._running = False
        self._thread.join()
        self._executor.shutdown()
        if hasattr(self.node, 'close'):
            self.node.close()
        self.node.destroy_node()
        rclpy.shutdown()


class Called:
    """A program that alarm outputs call; `then` are lines of a shell that decide how it ends."""

    def __init__(self, folder: Path, then: str = '', name: str = 'notify') -> None:
        self.program, self._log = folder / name, folder / f'{name}.log'
        self.program.write_text(f'#!/bin/sh\necho "$1: $2" >> {self._log}\n{then}\n')
        self.program.chmod(0o755)

    def __call__(self) -> list[str]:
        """Return what it was called with so far."""
        return self._log.read_text().splitlines() if self._log.exists() else []


@pytest.fixture
def called(tmp_path: Path) -> Callable[..., Called]:
    return partial(Called, tmp_path)


@pytest.fixture
def resident(graph) -> Iterator[Callable[..., object]]:
    """Return a function that starts a node (its class, parameters) beside the graph's probe."""
    started: list[Resident] = []

    def start(make: Callable[[], object], **parameters: object) -> object:
        started.append(Resident(make, **parameters))
        return started[-1].node

    yield start
    for each in reversed(started):
        each.close()


@pytest.fixture
def detector(graph) -> Iterator[object]:
    """A detector that says what the test wants, 20 times a second."""
    from speed_rig import Detector

    detector = Detector(graph)
    yield detector
    detector.close()
