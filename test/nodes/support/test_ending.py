"""A node process ends, whatever its main thread is in."""

from __future__ import annotations

import signal
import subprocess
import sys

#: Holds the lock of Python as Fast DDS did where it hung in the end of a participant.
HANGS = """
import ctypes
from hunt_ros.nodes.support.ending import Ending
ending = Ending('a node')
ending.grant('closing', 0.1)
ctypes.PyDLL(None).sleep(600)
"""


def test_a_library_that_hangs_with_the_lock_of_python_does_not_keep_it(machine) -> None:
    node = subprocess.Popen([sys.executable, '-c', HANGS])
    assert machine.wait_for(node, 30.0) == -signal.SIGALRM
