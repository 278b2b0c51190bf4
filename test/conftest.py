"""
What all tests lean on: how quick this machine is, what property tests may take, browser, hardware.

The hardware is a Modbus server of pymodbus, serial lines are pseudo-terminals.
"""

from __future__ import annotations

import asyncio
import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

import hypothesis
import pytest

# For what tests of several rooms share, and for the benchmarks, which are tested too.
sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / 'benchmark')]
# Before numpy is imported: the matrices here are small, and threads that wait for each other
# cost more than they compute where the cores have other work too.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
# For rclpy in the process of a test: without a home it finds no place for its log.
if 'HOME' not in os.environ:
    os.environ.setdefault('ROS_LOG_DIR', tempfile.gettempdir())
# What is tested is hung up as a terminal does it: not ignored, as under nohup.
signal.signal(signal.SIGHUP, signal.SIG_DFL)

# No time limit an example: the first one compiles a kernel, and other programs may run. The
# same examples on every machine, and nothing kept in the source tree.
hypothesis.settings.register_profile(
    'anywhere',
    deadline=None,
    derandomize=True,
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
)
hypothesis.settings.load_profile('anywhere')


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that hold long tests: side by side, what comes last should be short."""
    long = {item.path for item in items if item.get_closest_marker('slow')}
    items.sort(key=lambda item: item.path not in long)


#: What a node does when it starts, and as much again of plain work.
_PROBE = """
try:
    import rclpy
except ImportError:
    import numpy, scipy.signal
else:
    rclpy.init(domain_id=101)
    rclpy.create_node('probe')
    rclpy.shutdown()
total = 0
for k in range(1_000_000):
    total += k * k
"""
#: How long that takes on a quick machine that does nothing else, s.
_QUICK_S = 0.6 if find_spec('rclpy') else 0.8


class Machine:
    """
    This machine, compared with a quick one that does nothing else.

    Attributes
    ----------
    slowness : float
        How many times longer a process takes here, when last measured; at least 1.
    """

    def __init__(self) -> None:
        self.slowness = 1.0
        self.measure()

    def measure(self) -> float:
        """Measure again, with the load there is now; return the slowness."""
        begin = time.monotonic()
        subprocess.run([sys.executable, '-c', _PROBE], check=True, capture_output=True)
        self.slowness = max((time.monotonic() - begin) / _QUICK_S, 1.0)
        return self.slowness

    def deadline(self, timeout_s: float) -> Deadline:
        """Return the end of a wait; `timeout_s` is in seconds of a quick idle machine."""
        return Deadline(self, timeout_s)

    def until(
        self,
        done: Callable[[], object],
        timeout_s: float = 30.0,
        told: Callable[[], object] = lambda: '',
    ) -> None:
        """Wait until a condition holds; `told` is for the failing assertion."""
        deadline = self.deadline(timeout_s)
        while not done():
            assert not deadline.passed, f'in vain {deadline}; {told()}'
            time.sleep(0.02)

    def wait_for(self, process: subprocess.Popen, timeout_s: float = 30.0) -> int:
        """Return the exit code of a process that is expected to end."""
        self.until(lambda: process.poll() is not None, timeout_s, lambda: process.args)
        return process.returncode


class Deadline:
    """
    End of a wait on a condition.

    It is asked only while the condition does not hold. When it has come, the machine is
    measured again: what made the wait long, another program or the nodes themselves, may
    have begun after the last measurement.
    """

    def __init__(self, machine: Machine, timeout_s: float) -> None:
        self._machine = machine
        self._timeout_s = timeout_s
        self._slowness = machine.slowness
        self._begin = time.monotonic()

    @property
    def passed(self) -> bool:
        waited = time.monotonic() - self._begin
        if waited < self._timeout_s * self._slowness:
            return False
        self._slowness = max(self._slowness, self._machine.measure())
        return waited >= self._timeout_s * self._slowness

    def __str__(self) -> str:
        waited = time.monotonic() - self._begin
        return (
            f'after {waited:.0f} s (a machine {self._slowness:.1f} times slower than a quick one)'
        )


@pytest.fixture(scope='session')
def machine() -> Machine:
    return Machine()


@pytest.fixture(scope='module')
def browser() -> Iterator[object]:
    """A real browser without a window."""
    playwright = pytest.importorskip('playwright.sync_api', reason='playwright is not installed')
    found = filter(None, map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome')))
    if not (program := next(found, '')):
        pytest.skip('no Chromium here: apt install chromium')
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=program, args=['--no-sandbox'])
        yield opened
        opened.close()


@pytest.fixture
def new_page(browser, machine) -> Iterator[Callable[[], object]]:
    """Return a function that opens a tab of a browser of its own; `errors`: what went wrong."""
    contexts = []

    def make() -> object:
        contexts.append(browser.new_context(viewport={'width': 1280, 'height': 800}))
        page = contexts[-1].new_page()
        page.errors = []
        page.on('pageerror', lambda error: page.errors.append(str(error)))
        page.on('requestfailed', lambda request: page.errors.append(request.url))
        page.set_default_timeout(20_000 * machine.slowness)
        return page

    yield make
    for context in contexts:
        context.close()


class ModbusServer:
    """
    A device with 200 registers that every function reads and writes.

    Attributes
    ----------
    words : dict of int to int
        What registers hold from now on; `written` what was written, (address, words), in order.
    """

    def __init__(self, serial_port: str = '') -> None:
        self.port = _free_port()
        self._serial_port = serial_port
        self.words: dict[int, int] = {}
        self.written: list[tuple[int, list]] = []
        self._loop: asyncio.AbstractEventLoop | None = None

    def start(self) -> None:
        """Listen; also again after `stop`."""
        ready = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve(ready)), daemon=True
        )
        self._thread.start()
        assert ready.wait(30.0)

    def stop(self) -> None:
        """Cut every connection and listen no more."""
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._ended.set)
            self._thread.join()
            self._loop = None

    def put(self, address: int, *words: int) -> None:
        """Let registers hold these words."""
        self.words.update({address + k: word & 0xFFFF for k, word in enumerate(words)})

    async def _serve(self, ready: threading.Event) -> None:
        from pymodbus.server import ModbusSerialServer, ModbusTcpServer
        from pymodbus.simulator import DataType, SimData, SimDevice

        self._loop, self._ended = asyncio.get_running_loop(), asyncio.Event()
        registers = SimData(0, count=200, values=0, datatype=DataType.REGISTERS)
        device = SimDevice(1, simdata=[registers], action=self._act)
        server = (
            ModbusSerialServer(device, port=self._serial_port, baudrate=115200)
            if self._serial_port
            else ModbusTcpServer(device, address=('127.0.0.1', self.port))
        )
        await server.serve_forever(background=True)
        ready.set()
        await self._ended.wait()
        await server.shutdown()

    async def _act(self, function, start, address, count, current, values) -> None:
        for place, word in self.words.items():
            current[place - start] = word
        if values is not None:
            self.written.append((address, list(values)))


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def modbus_server() -> Iterator[ModbusServer]:
    pytest.importorskip('pymodbus', reason='the extra modbus is not installed')
    server = ModbusServer()
    server.start()
    yield server
    server.stop()


@dataclass
class PseudoTerminal:
    """
    The far end of a serial line: what is written into it, a driver reads from `port`.

    `port` can be opened as any serial port; closing this end is pulling the plug.
    """

    far: int
    near: int
    port: str = field(init=False)

    def __post_init__(self) -> None:
        tty.setraw(self.near)
        self.port = os.ttyname(self.near)

    def send(self, data: bytes) -> None:
        os.write(self.far, data)

    def close(self) -> None:
        for end in (self.far, self.near):
            if end >= 0:
                os.close(end)
        self.far = self.near = -1


@pytest.fixture
def terminal() -> Iterator[PseudoTerminal]:
    terminal = PseudoTerminal(*os.openpty())
    yield terminal
    terminal.close()


@pytest.fixture
def serial_cable() -> Iterator[tuple[str, str]]:
    """Two serial ports with a cable between them."""
    ends = PseudoTerminal(*os.openpty()), PseudoTerminal(*os.openpty())
    running = True

    def carry() -> None:
        other = {ends[0].far: ends[1].far, ends[1].far: ends[0].far}
        while running:
            for end in select.select(list(other), [], [], 0.05)[0]:
                os.write(other[end], os.read(end, 4096))

    thread = threading.Thread(target=carry, daemon=True)
    thread.start()
    yield ends[0].port, ends[1].port
    running = False
    thread.join()
    for end in ends:
        end.close()


@pytest.fixture
def modbus_rtu(serial_cable) -> Iterator[tuple[ModbusServer, str]]:
    """A device on a serial bus, and the port at the other end of the bus."""
    pytest.importorskip('pymodbus', reason='the extra modbus is not installed')
    server = ModbusServer(serial_cable[0])
    server.start()
    yield server, serial_cable[1]
    server.stop()
