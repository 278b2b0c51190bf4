"""What several tests of nodes share: processes, and messages."""

from __future__ import annotations

import sys
from pathlib import Path

from sensor_msgs.msg import JointState

from hunt_ros.nodes.support.conversions import to_time

#: What starts the program.
HUNT = [sys.executable, '-u', '-m', 'hunt_ros.cli.main']


def children(parent: int, word: str) -> list[int]:
    """Return the processes that a process has started with this word on their command line."""
    found = []
    for path in Path('/proc').glob('[0-9]*'):
        try:
            started_by = int((path / 'stat').read_text().rpartition(')')[2].split()[1])
            words = (path / 'cmdline').read_bytes().split(b'\0')
        except OSError:
            continue  # it ended meanwhile
        if started_by == parent and word.encode() in words:
            found.append(int(path.name))
    return found


def joint(name: str, stamp_ns: int, value: float) -> JointState:
    """Return a reading."""
    message = JointState(name=[name], position=[value])
    message.header.stamp = to_time(stamp_ns)
    return message
