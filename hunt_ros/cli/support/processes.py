"""
Starting the nodes as processes of their own, and ending every one of them again.

Each process gets a session of its own, so that Ctrl-C on the terminal reaches
only this program, which then ends them in order: what records is ended last.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, NoReturn

from hunt_ros.errors import HuntError

_PR_SET_PDEATHSIG = 1
#: What ends a run; all of them let it close its recording.
_ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
#: What the nodes themselves listen for, see `hunt_ros.nodes.support.ending`.
_HELD_BACK = (signal.SIGINT, signal.SIGTERM)
_GRACE_S = {signal.SIGINT: 8.0, signal.SIGTERM: 2.0, signal.SIGKILL: 2.0}


@dataclass(frozen=True)
class NodeSpec:
    """
    A process to start: one node, or several.

    Parameters
    ----------
    module : str
        Module of `hunt_ros.nodes`; the name of the process where it is several.
    parameters : mapping
        ROS parameters; values as YAML takes them.
    parameter_files : sequence of Path
        ROS parameter files, read before `parameters`.
    piped : bool
        True for the console: its standard streams are ours.
    nodes : sequence of str
        The modules, where it is several.
    needed : bool
        False for one whose end does not end the run: it is only told.
    """

    module: str
    parameters: Mapping[str, object] = field(default_factory=dict)
    parameter_files: Sequence[Path] = ()
    piped: bool = False
    nodes: Sequence[str] = ()
    needed: bool = True

    def command(self, namespace: str) -> list[str]:
        """Return the command line of the process."""
        entry = [sys.executable, '-m', 'hunt_ros.nodes.entry']
        return [*entry, *(self.nodes or (self.module,)), *self.ros_arguments(namespace)]

    def ros_arguments(self, namespace: str) -> list[str]:
        """Return the part of it that rclpy reads."""
        where = f'/{namespace.strip("/")}'
        # Under SROS2 each process has the key of its own enclave, else it is only a name.
        words = ['--ros-args', '-r', f'__ns:={where}', '--enclave', f'{where}/{self.module}']
        for path in self.parameter_files:
            words += ['--params-file', str(path)]
        for name, value in self.parameters.items():
            words += ['-p', f'{name}:={_yaml(value)}']
        return words


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


class Processes:
    """
    The processes of one run; a context manager that leaves none behind.

    Parameters
    ----------
    namespace : str
        ROS namespace of all nodes.
    log_directory : Path
        Gets a folder for this run, with a file for each node's output.
    private : bool
        True for a ROS graph of this run alone, on this machine only (a demo must not
        meet a real rig); False to use the user's ROS environment as it is.

    Raises
    ------
    HuntError
        If ROS is not installed.
    """

    def __init__(self, namespace: str, log_directory: Path, private: bool) -> None:
        require_ros()
        self._namespace = namespace
        self._log_directory = log_directory
        self.environment = dict(os.environ)
        if private:
            self._claim = socket.socket(socket.AF_UNIX)
            self.environment['ROS_DOMAIN_ID'] = str(claim_domain(self._claim))
            self.environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
            if os.environ.get('ROS_DISTRO') == 'humble':
                self.environment['ROS_LOCALHOST_ONLY'] = '1'  # newer ones warn about it
        self._running: dict[str, subprocess.Popen[str]] = {}
        self._not_needed: set[str] = set()  # of them, those whose end has not been told
        self._read: dict[str, int] = {}
        self._handlers: dict[signal.Signals, Any] = {}

    @cached_property
    def logs(self) -> Path:
        """Folder with the logs of this run; those of other runs stay."""
        path = base = self._log_directory / f'{datetime.now():%Y%m%d_%H%M%S}'
        number = 0
        while True:
            try:
                path.mkdir(parents=True)
                return path
            except FileExistsError:
                number += 1
                path = base.with_name(f'{base.name}_{number}')

    def start(self, spec: NodeSpec) -> subprocess.Popen[str]:
        """Start a node; its output goes to a log file unless it is piped."""
        self._read.pop(spec.module, None)
        with (self.logs / f'{spec.module}.log').open('w') as log:
            process = subprocess.Popen(
                spec.command(self._namespace),
                stdin=subprocess.PIPE if spec.piped else subprocess.DEVNULL,
                stdout=subprocess.PIPE if spec.piped else log,
                stderr=log,
                text=True,
                env=self.environment,
                start_new_session=True,
                preexec_fn=_in_child,
            )
        self._running[spec.module] = process
        if not spec.needed:
            self._not_needed.add(spec.module)
        return process

    def pids(self) -> dict[str, int]:
        """Return the process id of each node."""
        return {module: process.pid for module, process in self._running.items()}

    def failed(self) -> str | None:
        """Return one line on a needed process that ended by itself, or None while all run."""
        for module, process in self._running.items():
            if module not in self._not_needed and process.poll() is not None:
                return self._ending(module)
        return None

    def lost(self) -> dict[str, str]:
        """Return one line on each process that is not needed and has ended; forget them."""
        ended = [name for name in self._not_needed if self._running[name].poll() is not None]
        lines = {module: self._ending(module) for module in ended}
        for module in ended:
            self._not_needed.remove(module)
            del self._running[module]
        return lines

    def _ending(self, module: str) -> str:
        code = self._running[module].poll()
        return f'{module} ended with exit code {code}: {self.last_line(module)}'

    def last_line(self, module: str) -> str:
        """Return the last line a node has written, for messages."""
        path = self.logs / f'{module}.log'
        lines = path.read_text(errors='replace').strip().splitlines() if path.exists() else []
        return lines[-1] if lines else f'(see {path})'

    def progress(self) -> list[str]:
        """Return what nodes have said of their compilation since this was asked before."""
        lines = []
        for module in self._running:
            path = self.logs / f'{module}.log'
            text = path.read_text(errors='replace') if path.exists() else ''
            whole = text[: text.rfind('\n') + 1]
            lines += whole[self._read.get(module, 0) :].splitlines()
            self._read[module] = len(whole)
        return [line for line in lines if ': compiling kernels' in line]

    def stop(self, module: str) -> None:
        """End one node, and wait for it."""
        process = self._running.pop(module, None)
        if process is not None:
            _end([process])

    def close(self) -> None:
        """End every node: the recorder last, so that it records the end of the others."""
        recorder = self._running.pop('bag_recorder', None)
        _end(list(self._running.values()))
        self._running.clear()
        if recorder is not None:
            _end([recorder])

    def __enter__(self) -> Processes:
        if threading.current_thread() is threading.main_thread():
            for number in _ENDINGS:
                self._handlers[number] = signal.signal(number, _interrupt)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for number in self._handlers:  # a second Ctrl-C must not leave processes behind
            signal.signal(number, signal.SIG_IGN)
        try:
            self.close()
        finally:
            for number, handler in self._handlers.items():
                signal.signal(number, handler)


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


def _end(processes: Sequence[subprocess.Popen[str]]) -> None:
    """Escalate the stop signals until every process has ended."""
    for number, grace_s in _GRACE_S.items():
        waiting = [process for process in processes if process.poll() is None]
        for process in waiting:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, number)
        deadline = time.monotonic() + grace_s
        for process in waiting:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=max(0.0, deadline - time.monotonic()))


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    """Take every signal that ends a run as Ctrl-C is taken."""
    raise KeyboardInterrupt


def _in_child() -> None:
    """Hold signals back until the node listens, and be interrupted when the parent dies."""
    signal.pthread_sigmask(signal.SIG_BLOCK, _HELD_BACK)
    if sys.platform == 'linux':
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGINT)


def _yaml(value: object) -> str:
    """Write a parameter value the way ROS reads it from a command line."""
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, list | tuple):
        return '[' + ', '.join(_yaml(each) for each in value) + ']'
    if isinstance(value, float):
        # ROS reads 7 as an integer and then refuses it for a float parameter.
        text = repr(value)
        return text if any(mark in text for mark in '.einf') else f'{text}.0'
    return json.dumps(value) if isinstance(value, str) else str(value)
