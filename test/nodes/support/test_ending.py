"""A node process ends, whatever its main thread is in."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

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


@pytest.mark.skipif(not os.path.exists('/dev/full'), reason='this system has none')
def test_a_full_disk_takes_the_words_of_a_node_and_not_the_node() -> None:
    script = "from hunt_ros.nodes.support.ending import Ending\nending = Ending('a node')\n"
    script += "ending.say('starting')\nending.leave(0)"
    with open('/dev/full', 'w') as full:
        assert subprocess.run([sys.executable, '-c', script], stderr=full).returncode == 0
