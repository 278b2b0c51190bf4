"""
The supervisor: starts the nodes, starts again what dies, and ends all of them where it is safe.

A guard keeps the rig safe, and only a wanted end ends it: first of all it takes the roller to the
safe speed, while everything else still runs. Every process is started again when it ends by
itself or stands still; to the guards the loss of another is what silence is. Each is a process
group of its own, so that Ctrl-C on the terminal reaches only this program, and is interrupted
where this program dies; one that is stopped goes on then, for the kernel continues what becomes an
orphan in its session. Where the alarm outputs are gone, this program calls by the same outputs.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import os
import signal
import socket
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from functools import cached_property, partial
from pathlib import Path
from queue import Queue
from types import FrameType, MappingProxyType
from typing import IO, Any

from hunt_ros.cli.support.processes import NodeSpec, claim_domain, require_ros
from hunt_ros.compiled import compile_all
from hunt_ros.drivers.alarm_output import AlarmOutput, Condition
from hunt_ros.errors import HuntError, one_line
from hunt_ros.suite import AGAIN, ALARM_OUTPUTS, DRIVE, GUARDS, OPTIONAL, SIMULATOR, START_S, SUITE

_PR_SET_PDEATHSIG = 1
#: What ends a run; all of them let it take the roller down and close its recording.
_ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
#: With these a shell stops what is to start again what dies: Ctrl-Z, a key, `hunt run &`.
_STOPS = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
#: What the nodes themselves listen for, see `hunt_ros.nodes.support.ending`.
_HELD_BACK = (signal.SIGINT, signal.SIGTERM)
_GRACE_S = {signal.SIGINT: 8.0, signal.SIGTERM: 2.0, signal.SIGKILL: 2.0}
#: Writing what waits takes as long as the disk takes.
_RECORDER, _CLOSING_S = 'bag_recorder', 60.0
_RECORDS = {_RECORDER, SUITE}
#: A process stands still where two nodes beside it have told their health, which each does once a
#: second, so often since it has; and so often since its start where it never has, which can hang
#: in the middleware: twice as often where it has failed before, on a machine that is slow.
_SILENT, _NEVER_HEARD = 10, 60
#: What ends again and again is started again after this, after twice as long, and so on, s.
_AGAIN_S, _AGAIN_MOST_S = 0.5, 30.0
#: Exit codes of a node that refuses its settings, or cannot have what it needs; of ROS where the
#: middleware of RMW_IMPLEMENTATION is not there.
_REFUSED = (2, 102)
_DEAF = (
    f'no node of this run is heard for {START_S:g} s, and no alarm of theirs is shown here: does a'
    ' firewall, a profile of Fast DDS or a crowded ROS domain keep them apart? (docs/lab-pc.md)'
)
#: Ctrl-C that comes sooner after the end was asked for is the same one, s.
_SAME_S = 0.5
#: A guard that is killed on the way to the safe speed is started again so often.
_TRIES = 3


class _Child:
    """A process that is kept running."""

    def __init__(self, spec: NodeSpec, attach: Callable[[subprocess.Popen[str]], None]) -> None:
        self.spec = spec
        self.attach = attach
        self.process: subprocess.Popen[str] | None = None
        self.began_s = self.due_s = 0.0
        self.failures = 0
        #: How often each other node has told its health since this one did or was started, and
        #: how often is too often.
        self.others: Counter[str] = Counter()
        self.patience = _NEVER_HEARD

    def put_off(self) -> None:
        """Have it started again: at once, and after longer each time that it has not lasted."""
        wait_s = _AGAIN_S * (2.0 ** min(self.failures, 10) - 1.0)
        self.due_s = time.monotonic() + min(wait_s, _AGAIN_MOST_S)
        self.failures += 1

    @property
    def stands_still(self) -> bool:
        """
        True where it is stopped, or the others speak and it does not.

        Silence of all is that of the console.
        """
        if self.process is None or not self.runs:
            return False
        stopped = os.WSTOPPED | os.WNOHANG | os.WNOWAIT
        with contextlib.suppress(ChildProcessError):  # it has ended since
            if os.waitid(os.P_PID, self.process.pid, stopped) is not None:
                return True
        # The console tells no health.
        silent = sum(count >= self.patience for count in self.others.values()) >= 2
        return silent and not self.spec.piped

    def ended(self) -> int | None:
        """Return the exit code of one that has ended since it was started; else None."""
        return None if self.process is None else self.process.poll()

    @property
    def runs(self) -> bool:
        """True while its process has not ended."""
        return self.process is not None and self.process.poll() is None

    def wait(self, timeout_s: float) -> None:
        """Wait until its process has ended, but no longer."""
        if self.process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(timeout_s)

    def pass_on(self, number: int) -> None:
        """Send its whole group a signal, where it still runs."""
        if self.process is not None and self.runs:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, number)


class Supervisor:
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
    keep : bool
        Start again what ends by itself; False for a measurement: its end ends the run.
    alarms : mapping of str to AlarmOutput
        By which somebody is called when the process that does so has ended; by name.

    Raises
    ------
    HuntError
        If ROS is not installed.
    """

    def __init__(
        self,
        namespace: str,
        log_directory: Path,
        private: bool,
        keep: bool = True,
        alarms: Mapping[str, AlarmOutput] = MappingProxyType({}),
    ) -> None:
        require_ros()
        self._namespace = namespace
        self._log_directory = log_directory
        self._keep = keep
        self._alarms = alarms
        self._told: Queue[str] = Queue()  # what came of calls
        self._files: list[IO[bytes]] = []  # parameter files as they were at the start
        self.environment = dict(os.environ)
        if private:
            self._claim = socket.socket(socket.AF_UNIX)
            self.environment['ROS_DOMAIN_ID'] = str(claim_domain(self._claim))
            self.environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
            if os.environ.get('ROS_DISTRO') == 'humble':
                self.environment['ROS_LOCALHOST_ONLY'] = '1'  # newer ones warn about it
        self._children: dict[str, _Child] = {}
        self._handlers: dict[signal.Signals, Any] = {}
        self._asked_s: float | None = None  # when the end was asked for
        self._hurry = self._winding = False
        #: When any node of the run was heard last, and whether it was said that none is.
        self._heard_s, self._deaf = math.inf, False

    @cached_property
    def logs(self) -> Path:
        """Folder with the logs of this run; those of other runs stay."""
        return self._log_directory / f'{datetime.now():%Y%m%d_%H%M%S_%f}'

    def start(
        self,
        spec: NodeSpec,
        attach: Callable[[subprocess.Popen[str]], None] = lambda process: None,
    ) -> None:
        """
        Start a node, and keep it running; its output goes to a log file unless it is piped.

        Parameters
        ----------
        spec : NodeSpec
            Its name is new in this run.
        attach : callable
            Gets the process, each time that it is started.

        Raises
        ------
        KeyboardInterrupt
            Where the end was asked for.
        """
        self._interrupt()
        self._heard_s = min(self._heard_s, time.monotonic())
        child = self._children[spec.module] = _Child(spec, attach)
        self._launch(child)
        kept = [self.in_memory(path.name, path.read_bytes()) for path in spec.parameter_files]
        child.spec = replace(spec, parameter_files=kept)

    def in_memory(self, name: str, content: bytes) -> Path:
        """Return a file that no full disk, nor who edits or deletes one, takes from a guard."""
        self._files.append(os.fdopen(os.memfd_create(name), 'wb'))
        self._files[-1].write(content)
        self._files[-1].flush()
        # Of the node itself, which has it open from its start: it outlives this process.
        return Path(f'/proc/self/fd/{self._files[-1].fileno()}')

    def _launch(self, child: _Child) -> None:
        spec = child.spec
        with self._log(spec.module) as log:
            child.process = subprocess.Popen(
                spec.command(self._namespace),
                stdin=subprocess.PIPE if spec.piped else subprocess.DEVNULL,
                stdout=subprocess.PIPE if spec.piped else log,
                stderr=log,
                text=True,
                env=self.environment | ({AGAIN: '1'} if child.began_s else {}),
                preexec_fn=partial(_in_child, os.getpid()),
                pass_fds=[one.fileno() for one in self._files],
            )
        child.began_s, child.others = time.monotonic(), Counter()
        child.patience = _NEVER_HEARD * (2 if child.failures else 1)
        child.attach(child.process)

    def _log(self, name: str) -> IO[str]:
        """Open the log of a node; a folder that is gone, or a full disk, holds no start up."""
        path = self.logs / f'{name}.log'
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            return path.open('a')
        except OSError:
            return open(os.devnull, 'a')

    def pids(self) -> dict[str, int]:
        """Return the process id of each node that runs."""
        running = {name: child.process for name, child in self._children.items()}
        return {name: process.pid for name, process in running.items() if process is not None}

    def look(self) -> list[str]:
        """
        Start again what has ended; return what has happened, in lines.

        Raises
        ------
        HuntError
            If a node refused its settings at its first start, or ended where nothing is kept.
        KeyboardInterrupt
            Where the end was asked for.
        """
        self._interrupt()
        lines = [self._told.get() for _ in range(self._told.qsize())]
        if (deaf := time.monotonic() - self._heard_s > START_S) != self._deaf:
            self._deaf = deaf
            lines.append(_DEAF if deaf else 'nodes of this run are heard again')
        for name, child in list(self._children.items()):
            if self._winding and name in GUARDS:
                continue
            if child.stands_still and self._keep and not self._winding:
                child.others = Counter()
                child.pass_on(signal.SIGKILL)
                lines.append(f'{name} stands still: it is ended')
            now_s, code = time.monotonic(), child.ended()
            lasted = child.process is not None and now_s - child.began_s > START_S
            if code is not None:
                child.process = None
                # Of one that was killed the last line says nothing of its end.
                why = f': {self._last_line(name)}' if code >= 0 else ''
                line = f'{name} ended with exit code {code}{why}'
                refused = code in _REFUSED and not child.failures
                if refused or not self._keep:
                    if name not in OPTIONAL:
                        raise HuntError(line)
                    del self._children[name]
                    lines.append(f'{line}; {OPTIONAL[name]}')
                    continue
                child.put_off()
                lines.append(f'{line}; it is started again')
                if name == ALARM_OUTPUTS:
                    self._call(line)
            elif lasted:
                child.failures = 0
            elif child.process is None and now_s >= child.due_s:
                try:
                    self._launch(child)
                except OSError as error:  # no memory, no process more
                    child.put_off()
                    lines.append(f'{name} cannot be started: {error}; it is tried again')
        return lines

    def _call(self, cause: str) -> None:
        """Call somebody; an output that hangs holds up nothing else."""
        for name, output in self._alarms.items():
            threading.Thread(target=self._show, args=(name, output, cause), daemon=True).start()

    def _show(self, name: str, output: AlarmOutput, cause: str) -> None:
        try:
            output.show(Condition.DOUBT, cause)
        except Exception as error:  # whatever a library of the hardware raises
            self._told.put(f'{name}: {one_line(error)}')

    def heard(self, node: str) -> None:
        """Take note that a node, with its full name, has told its health."""
        namespace, _, name = node.rpartition('/')
        if namespace.strip('/') != self._namespace.strip('/'):
            return
        self._heard_s = time.monotonic()
        for module, child in self._children.items():
            if name in (child.spec.nodes or (module,)):
                child.others, child.patience = Counter(), _SILENT
            else:
                child.others[name] += 1

    def _last_line(self, name: str) -> str:
        path = self.logs / f'{name}.log'
        lines = path.read_text(errors='replace').strip().splitlines() if path.exists() else []
        return lines[-1] if lines else f'(see {path})'

    def wind_down(self, meanwhile: Callable[[], object] = lambda: time.sleep(0.1)) -> str:
        """
        Let the guard take the roller to the safe speed; return '' or why it is not there.

        From now on signals end nothing, but a second Ctrl-C: it ends the guard at once.

        Parameters
        ----------
        meanwhile : callable
            Called again and again until then; it says how far the roller is. What it raises of a
            terminal that is gone, or a full disk, holds nothing up.
        """
        if self._asked_s is None:
            self._asked_s = time.monotonic()
        guard = self._children.get(DRIVE)
        if guard is None or (guard.process is None and not guard.failures):
            return ''  # it was never there
        if not self._winding:
            self._winding = True
            self.look()
            guard.pass_on(signal.SIGINT)
        for _ in range(_TRIES):
            self._wait(guard, meanwhile)
            if self._hurry or guard.ended() in range(256):
                break
            # It was killed on its way: it starts tripped, and goes on where it has started.
            guard.put_off()
            with contextlib.suppress(OSError):
                self._launch(guard)
                guard.pass_on(signal.SIGINT)
        if guard.runs:
            guard.pass_on(signal.SIGKILL)
            guard.wait(_GRACE_S[signal.SIGKILL])
            return 'ended at once'
        return '' if guard.ended() == 0 else self._last_line(DRIVE)

    def _wait(self, guard: _Child, meanwhile: Callable[[], object]) -> None:
        """Wait until a guard has ended."""
        while guard.runs and not self._hurry:
            if guard.stands_still:
                guard.pass_on(signal.SIGKILL)
            with contextlib.suppress(OSError, HuntError):
                meanwhile()
            time.sleep(0.02)

    def close(self) -> None:
        """End every node: the guards first, for all is safe; the recorder last, it hears them."""
        last = (SIMULATOR, _RECORDER)
        rest = tuple(name for name in self._children if name not in (*GUARDS, *last))
        for names in (GUARDS, rest, (SIMULATOR,), (_RECORDER,)):
            _end([self._children.pop(name) for name in names if name in self._children])

    def __enter__(self) -> Supervisor:
        compile_all()  # here, where somebody may wait and interrupt: a node compiles nothing
        if threading.current_thread() is threading.main_thread():
            for number in (*_ENDINGS, *_STOPS):
                ignored = signal.getsignal(number) is signal.SIG_IGN
                handler = signal.SIG_IGN if number in _STOPS else self._on_signal
                if not (number == signal.SIGHUP and ignored):  # as nohup leaves it
                    self._handlers[number] = signal.signal(number, handler)
        return self

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        """Take every signal that ends a run as Ctrl-C is taken; a second Ctrl-C is in a hurry."""
        now_s = time.monotonic()
        if self._asked_s is None:
            self._asked_s = now_s
        elif number == signal.SIGINT and now_s - self._asked_s > _SAME_S:
            self._hurry = True

    def _interrupt(self) -> None:
        """
        End the run here where that was asked for.

        What a signal raises by itself is lost in a callback of a library, or leaves a process
        that has just been started to nobody.
        """
        if self._asked_s is not None and not self._winding:
            raise KeyboardInterrupt

    def __exit__(self, *error: object) -> None:
        self._asked_s = self._asked_s or time.monotonic()  # no signal interrupts the end
        try:
            self.wind_down()
        finally:
            self.close()
            for number, handler in self._handlers.items():
                signal.signal(number, handler)


def _end(children: Sequence[_Child]) -> None:
    """Escalate the stop signals until every process has ended; one that is stopped goes on."""
    for child in children:
        child.pass_on(signal.SIGCONT)
    for number, grace_s in _GRACE_S.items():
        waiting = [child for child in children if child.runs]
        for child in waiting:
            child.pass_on(number)
        if number == signal.SIGINT and {child.spec.module for child in waiting} & _RECORDS:
            grace_s = _CLOSING_S
        deadline = time.monotonic() + grace_s
        for child in waiting:
            child.wait(max(0.0, deadline - time.monotonic()))


def _in_child(parent: int) -> None:
    """Hold signals back until the node listens, and be interrupted when the parent dies."""
    os.setpgrp()
    signal.pthread_sigmask(signal.SIG_BLOCK, _HELD_BACK)
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGINT)
    if os.getppid() != parent:  # it has died already: nobody would say so
        os.kill(os.getpid(), signal.SIGINT)
