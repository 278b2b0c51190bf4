"""
An identification in a process of its own, for the node that asks for it.

What it takes of memory it gives back, a library that crashes ends nothing else, and the one
interpreter of the node, which may be that of the detector and of the interlock too, stays free.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from multiprocessing import active_children, get_context, parent_process
from pathlib import Path
from threading import Event, Thread

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
    HuntError
        If it is to end before it is done.
    RuntimeError
        If the process is killed; and what nobody expected, as it was raised there.
    """
    with ProcessPoolExecutor(1, get_context('spawn'), _prepare) as pool:
        job = pool.submit(_identified, recordings, settings, whole)
        while not wait([job], _LOOK_S).done:
            if stopping.is_set():
                for child in active_children():
                    child.kill()
        try:
            return job.result()
        except BrokenProcessPool:
            if stopping.is_set():
                raise HuntError('ended before it was done') from None
            raise RuntimeError('its process was killed') from None


def _identified(
    recordings: Sequence[Path], settings: IdentificationSettings, whole: Path
) -> Refit:
    """Identify, in the process of its own."""
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
    why = '; '.join(reasons)
    return replace(found, problem=f'the recordings do not determine a normal form: {why}')


def _prepare() -> None:
    """Begin a process that identifies."""
    os.setsid()  # Ctrl-C is for the node, which ends this
    os.nice(_NICENESS)
    Thread(target=_end_without_node, daemon=True).start()
    on_compilation(lambda text: print(f'identification: {text}', file=sys.stderr, flush=True))


def _end_without_node() -> None:
    """End this process when that of the node is gone, however it went."""
    node = parent_process()
    assert node is not None
    node.join()
    os._exit(1)
