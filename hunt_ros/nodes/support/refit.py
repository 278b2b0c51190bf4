"""
An identification in a process of its own, for the node that asks for it.

What it takes of memory it gives back, a library that crashes ends nothing else, and the one
interpreter of the node, which may be that of the detector and of the interlock too, stays free.
The order comes on standard input, and the answer goes to standard output; standard error is that
of the node.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from hunt_ros.bag.columns import read_record
from hunt_ros.compiled import on_compilation
from hunt_ros.errors import HuntError
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.samples import Unknown

_LOOK_S = 0.2
#: Alarm and interlock come first on a machine that has other work.
_NICENESS = 10


@dataclass(frozen=True)
class Refit:
    """
    What came of it.

    Parameters
    ----------
    form : str
        The parameter file; '' where the recordings do not determine a normal form.
    recordings : sequence of str
        What it rests on.
    unreadable : dict of str to str
        Recordings that cannot be read, and why.
    warnings : sequence of str
    problem : str
        Why nothing can be identified, or no normal form; '' where there is one.
    """

    form: str = ''
    recordings: Sequence[str] = ()
    unreadable: dict[str, str] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    problem: str = ''


def refit(
    recordings: Sequence[Path],
    settings: IdentificationSettings,
    whole: Path,
    stopping: threading.Event,
) -> Refit:
    """
    Identify from recordings, and wait for it.

    Parameters
    ----------
    recordings : sequence of Path
        One that cannot be read does not spoil the others.
    settings : IdentificationSettings
        What is known of the rig.
    whole : Path
        Where everything but the samples is written, if there is a normal form.
    stopping : Event
        Set: ends the process, and nothing came of it.

    Raises
    ------
    RuntimeError
        If the process ends without an answer, or with an error that nobody expected.
    """
    order = pickle.dumps((os.getpid(), list(recordings), settings, whole))
    words = [sys.executable, '-m', 'hunt_ros.nodes.support.refit']
    pipe = subprocess.PIPE
    # A session of its own: Ctrl-C is for the node, which ends this.
    with subprocess.Popen(words, stdin=pipe, stdout=pipe, start_new_session=True) as child:
        with suppress(OSError):  # it has ended already
            os.setpriority(os.PRIO_PROCESS, child.pid, os.nice(0) + _NICENESS)
        sent: bytes | None = order
        while True:
            try:
                answer, _ = child.communicate(sent, timeout=_LOOK_S)
                break
            except subprocess.TimeoutExpired:
                sent = None
                if stopping.is_set():
                    child.kill()
    if stopping.is_set():
        return Refit(problem='ended before it was done')
    if child.returncode < 0:
        raise RuntimeError(f'its process was ended by {signal.Signals(-child.returncode).name}')
    if child.returncode:
        raise RuntimeError(f'its process has ended with {child.returncode}')
    found = pickle.loads(answer)
    if isinstance(found, str):
        raise RuntimeError(found)
    assert isinstance(found, Refit)
    return found


def _identified(
    recordings: Sequence[Path], settings: IdentificationSettings, whole: Path
) -> Refit:
    """Do the work of an order."""
    from hunt_ros.dynamics.normal_form import COEFFICIENTS
    from hunt_ros.identification import identify

    records, unreadable = {}, {}
    for path in map(str, recordings):
        try:
            records[path] = read_record(path)
        except HuntError as error:
            unreadable[path] = str(error)
    if not records:
        return Refit(unreadable=unreadable)
    try:
        result = identify(list(records.values()), settings)
        if result.normal_form is not None:
            result.save(whole)
    except HuntError as error:
        return Refit(unreadable=unreadable, problem=str(error))
    found = Refit('', tuple(records), unreadable, tuple(result.warnings))
    if result.normal_form is not None:
        return replace(found, form=result.normal_form.to_yaml())
    missing = [each for each in map(result.quantity, COEFFICIENTS) if isinstance(each, Unknown)]
    reasons = dict.fromkeys(each.reason for each in missing) or result.notices
    return replace(found, problem='; '.join(reasons))


def _end_without(parent: int) -> None:
    """End this process when that of the node is gone, however it went."""
    while os.getppid() == parent:
        time.sleep(_LOOK_S)
    os._exit(1)


def main() -> None:
    """Take an order, and answer it: with a text where an error came that nobody expected."""
    answer = os.fdopen(os.dup(1), 'wb')
    os.dup2(2, 1)  # what a library prints is no answer
    parent, *order = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_without, args=(parent,), daemon=True).start()
    on_compilation(lambda text: print(f'identification: {text}', file=sys.stderr, flush=True))
    try:
        found: Refit | str = _identified(*order)
    except Exception as error:  # any: numbers of a rig that nobody has seen
        traceback.print_exc()
        found = f'{type(error).__name__}: {error}'
    with answer:
        pickle.dump(found, answer)


if __name__ == '__main__':
    # By its own name, not __main__: an answer is read by another process.
    from hunt_ros.nodes.support import refit as here

    here.main()
