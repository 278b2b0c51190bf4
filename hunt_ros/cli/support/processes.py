"""How a node is started as a process of its own, and asked for one answer."""

from __future__ import annotations

import contextlib
import json
import random
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hunt_ros.errors import HuntError


@dataclass(frozen=True)
class NodeSpec:
    """
    A process to start: one node, or several.

    Parameters
    ----------
    module : str
        Module of `hunt_ros.nodes`; the name of the process where it is several.
    parameters : mapping
        ROS parameters.
    parameter_files : sequence of Path
        ROS parameter files, read before `parameters`.
    piped : bool
        True for the console: its standard streams are ours.
    nodes : sequence of str
        The modules, where it is several.
    """

    module: str
    parameters: Mapping[str, object] = field(default_factory=dict)
    parameter_files: Sequence[Path] = ()
    piped: bool = False
    nodes: Sequence[str] = ()

    def command(self, namespace: str) -> list[str]:
        """Return the command line of the process."""
        where = f'/{namespace.strip("/")}'
        words = [sys.executable, '-m', 'hunt_ros.nodes.entry', *(self.nodes or (self.module,))]
        # Under SROS2 each process has the key of its own enclave, else it is only a name.
        words += ['--ros-args', '-r', f'__ns:={where}', '--enclave', f'{where}/{self.module}']
        for path in self.parameter_files:
            words += ['--params-file', str(path)]
        for name, value in self.parameters.items():
            words += ['-p', f'{name}:={json.dumps(value, ensure_ascii=False)}']
        return [for_ros(word) for word in words]


def for_ros(text: str) -> str:
    """Return a text as it is; raises HuntError where it is none that ROS can read."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        part = text[max(0, error.start - 40) : error.end + 40]
        raise HuntError(f'{part!r}: not UTF-8, as ROS wants it') from error
    return text


def claim_domain(claim: socket.socket) -> int:
    """
    Choose a ROS domain in which no other private run on this machine is.

    Parameters
    ----------
    claim : socket
        Of the Unix family, new; the domain is claimed until it is closed.

    Returns
    -------
    int
        1 to 100: higher numbers take ports that any program may get.
    """
    numbers = random.SystemRandom().sample(range(1, 101), 100)
    for number in numbers:
        with contextlib.suppress(OSError):
            claim.bind(f'\0hunt_ros private domain {number}')  # a name without a file
            return number
    return numbers[0]  # all are taken, or this system has no such names


def ask(spec: NodeSpec, namespace: str) -> dict[str, Any]:
    """
    Run a node that prints one object and ends, and return that object.

    Raises
    ------
    HuntError
        If ROS is not installed, or the node fails, with its last line.
    """
    require_ros()
    done = subprocess.run(spec.command(namespace), capture_output=True, text=True)
    for line in done.stdout.splitlines():
        try:
            answer: dict[str, Any] = json.loads(line)
        except ValueError:
            continue  # a line of some library
        return answer
    last = done.stderr.strip().splitlines()
    raise HuntError(f'{spec.module} failed: {last[-1] if last else f"code {done.returncode}"}')


def require_ros() -> None:
    """
    Fail where ROS is not installed.

    Raises
    ------
    HuntError
        With what to install.
    """
    from importlib.util import find_spec

    if find_spec('rclpy') is None:
        raise HuntError(
            'rclpy is not installed: source a ROS 2 set-up, or pip install "hunt_ros[ros]"'
        )
