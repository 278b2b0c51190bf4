"""What all tests lean on: how quick this machine is now, and what property tests may take."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from importlib.util import find_spec

import hypothesis
import pytest

# Before numpy is imported: the matrices here are small, and threads that wait for each other
# cost more than they compute where the cores have other work too.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

# No time limit an example: the first one compiles a kernel, and other programs may run. The
# same examples on every machine, and nothing kept in the source tree.
hypothesis.settings.register_profile(
    'anywhere',
    deadline=None,
    derandomize=True,
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
)
hypothesis.settings.load_profile('anywhere')


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

    def wait_for(self, process: subprocess.Popen, timeout_s: float = 30.0) -> int:
        """Return the exit code of a process that is expected to end."""
        deadline = self.deadline(timeout_s)
        while process.poll() is None:
            assert not deadline.passed, f'{process.args} runs on {deadline}'
            time.sleep(0.02)
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
