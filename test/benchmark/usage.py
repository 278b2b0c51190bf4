"""What a process of the suite takes, by the kernel's own account, and what its nodes lost."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

#: Who loses what: nodes, and the value in their diagnostics.
LOSSES = {
    'sensors': (('lateral_sensor', 'yaw_sensor'), 'lost'),
    'detector, too late': (('hunting_detector',), 'dropped'),
    'detector, on the way': (('hunting_detector',), 'missed'),
    'recorder': (('bag_recorder',), 'dropped'),
}
_TICKS = os.sysconf('SC_CLK_TCK')


@dataclass
class Usage:
    """
    CPU seconds of a process so far, and its share of the memory.

    `memory_mb` is its share of all (PSS, MB). `own_mb` is the part of it that no file backs: what
    the process itself asked for. The share of a file's pages changes too when another program
    that has mapped the file begins or ends.
    """

    cpu_s: float
    memory_mb: float
    own_mb: float

    @classmethod
    def of(cls, pid: int) -> Usage:
        """Ask the kernel."""
        parts = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
        lines = Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines()[1:]
        kib = {line.split(':')[0]: int(line.split()[1]) for line in lines}
        cpu_s = (int(parts[11]) + int(parts[12])) / _TICKS
        own = kib['Pss_Anon'] + kib['Pss_Shmem']
        return cls(cpu_s, kib['Pss'] / 1024.0, own / 1024.0)


def losses(health: Mapping[str, Mapping[str, str]]) -> dict[str, int]:
    """Return what was lost so far, by who lost it, from what each node last said of itself."""
    return {
        who: sum(int(health[node][key]) for node in nodes) for who, (nodes, key) in LOSSES.items()
    }
