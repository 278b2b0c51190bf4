"""
An identification in a process of its own, for the node that asks for it.

What it takes of memory it gives back, a library that crashes ends nothing else, and the one
interpreter of the node, which may be that of the detector and of the interlock too, stays free.
"""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Event, Thread
from typing import Any

from hunt_ros.bag.columns import read_record
from hunt_ros.compiled import on_compilation
from hunt_ros.errors import HuntError, one_line
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
    stopping: Event,
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
    context = get_context('spawn')
    found, answer = context.Pipe(duplex=False)
    child = context.Process(target=_work, args=(answer, list(recordings), settings, whole))
    child.start()
    assert child.pid is not None
    os.setpriority(os.PRIO_PROCESS, child.pid, os.nice(0) + _NICENESS)
    answer.close()
    with found:
        try:
            while not found.poll(_LOOK_S):
                if stopping.is_set():
                    child.kill()
                    return Refit(problem='ended before it was done')
            said = found.recv()
        except EOFError:
            child.join()
            code = child.exitcode or 0
            how = f'by {signal.Signals(-code).name}' if code < 0 else f'with exit code {code}'
            raise RuntimeError(f'its process was ended {how}') from None
    child.join()
    if isinstance(said, str):
        raise RuntimeError(said)
    assert isinstance(said, Refit)
    return said


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


def _work(answer: Connection, *order: Any) -> None:
    """Answer an order, in the process of its own: with a text where nobody expected the error."""
    os.setsid()  # Ctrl-C is for the node, which ends this
    Thread(target=_end_without_node, daemon=True).start()
    on_compilation(lambda text: print(f'identification: {text}', file=sys.stderr, flush=True))
    try:
        answer.send(_identified(*order))
    except Exception as error:  # any: numbers of a rig that nobody has seen
        traceback.print_exc()
        answer.send(one_line(error))


def _end_without_node() -> None:
    """End this process when that of the node is gone, however it went."""
    node = parent_process()
    assert node is not None
    node.join()
    os._exit(1)
