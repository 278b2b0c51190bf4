"""
An identification in a process of its own, for the node that asks for it.

What it takes of memory it gives back, a library that crashes ends nothing else, and the one
interpreter of the node, which may be that of the detector and of the interlock too, stays free.
The order comes as JSON on standard input, and the answer goes as the last line of standard output;
standard error is that of the node.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from hunt_ros.bag.columns import read_record
from hunt_ros.compiled import on_compilation
from hunt_ros.errors import HuntError
from hunt_ros.identification.settings import IdentificationSettings

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
        Why nothing can be identified; '' where it can.
    failure : str
        An error that nobody expected, on a line; '' for none.
    """

    form: str = ''
    recordings: Sequence[str] = ()
    unreadable: dict[str, str] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    problem: str = ''
    failure: str = ''


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
    order = {
        'recordings': [str(path) for path in recordings],
        'settings': asdict(settings),
        'whole': str(whole),
        'parent': os.getpid(),
    }
    words = [sys.executable, '-m', 'hunt_ros.nodes.support.refit']
    pipe = subprocess.PIPE
    # A session of its own: Ctrl-C is for the node, which ends this.
    with subprocess.Popen(
        words, stdin=pipe, stdout=pipe, text=True, start_new_session=True
    ) as child:
        with suppress(OSError):  # it has ended already
            os.setpriority(os.PRIO_PROCESS, child.pid, os.nice(0) + _NICENESS)
        text: str | None = json.dumps(order)
        while True:
            try:
                answer, _ = child.communicate(text, timeout=_LOOK_S)
                break
            except subprocess.TimeoutExpired:
                text = None  # it has been sent
                if stopping.is_set():
                    child.kill()
    if stopping.is_set():
        return Refit(problem='ended before it was done')
    if child.returncode < 0:
        raise RuntimeError(f'its process was ended by {signal.Signals(-child.returncode).name}')
    if child.returncode:
        raise RuntimeError(f'its process has ended with {child.returncode}')
    found = Refit(**json.loads(answer.splitlines()[-1]))
    if found.failure:
        raise RuntimeError(found.failure)
    return found


def _answer(order: dict[str, Any]) -> Refit:
    """Do the work of an order."""
    from hunt_ros.identification import identify

    records, unreadable = {}, {}
    for path in order['recordings']:
        try:
            records[path] = read_record(path)
        except HuntError as error:
            unreadable[path] = str(error)
    if not records:
        return Refit(unreadable=unreadable)
    given = {name: _tuple(value) for name, value in order['settings'].items()}
    try:
        result = identify(list(records.values()), IdentificationSettings(**given))
        if result.normal_form is not None:
            result.save(order['whole'])
    except HuntError as error:
        return Refit(unreadable=unreadable, problem=str(error))
    except Exception as error:  # any: numbers of a rig that nobody has seen
        traceback.print_exc()
        return Refit(unreadable=unreadable, failure=f'{type(error).__name__}: {error}')
    form = '' if result.normal_form is None else result.normal_form.to_yaml()
    return Refit(form, tuple(records), unreadable, tuple(result.warnings))


def _tuple(value: Any) -> Any:
    """Return lists as the tuples that they were before they were JSON."""
    return tuple(map(_tuple, value)) if isinstance(value, list) else value


def _end_without(parent: int) -> None:
    """End this process when that of the node is gone, however it went."""
    while os.getppid() == parent:
        time.sleep(_LOOK_S)
    os._exit(1)


def main() -> None:
    """Take an order, and answer it."""
    order = json.load(sys.stdin)
    threading.Thread(target=_end_without, args=(order['parent'],), daemon=True).start()
    on_compilation(lambda text: print(f'identification: {text}', file=sys.stderr, flush=True))
    print(json.dumps(asdict(_answer(order))))


if __name__ == '__main__':
    main()
