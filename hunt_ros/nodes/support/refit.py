"""
An identification in a process of its own, for the node that asks for it.

What it takes of memory it gives back, a library that crashes ends nothing else, and the one
interpreter of the node, which may be that of the detector and of the interlock too, stays free.
The order comes as JSON on standard input, and the answer goes as JSON to standard output.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from hunt_ros.bag.columns import read_record
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
    recordings : tuple of str
        What it rests on.
    unreadable : dict of str to str
        Recordings that cannot be read, and why.
    warnings : tuple of str
    problem : str
        Why nothing can be identified; '' where it can.
    """

    form: str = ''
    recordings: tuple[str, ...] = ()
    unreadable: dict[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
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
        If the process ends without an answer.
    """
    order = {
        'recordings': [str(path) for path in recordings],
        'settings': asdict(settings),
        'whole': str(whole),
    }
    pipe = subprocess.PIPE
    words = [sys.executable, '-m', 'hunt_ros.nodes.support.refit']
    with subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as child:
        text: str | None = json.dumps(order)
        while True:
            try:
                answer, errors = child.communicate(text, timeout=_LOOK_S)
                break
            except subprocess.TimeoutExpired:
                text = None  # it has been sent
                if stopping.is_set():
                    child.kill()
    if stopping.is_set():
        return Refit(problem='ended before it was done')
    if child.returncode:
        said = errors.strip().splitlines() or ['']
        raise RuntimeError(said[-1] or f'its process has ended with {child.returncode}')
    return Refit(**json.loads(answer))


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
    form = '' if result.normal_form is None else result.normal_form.to_yaml()
    return Refit(form, tuple(records), unreadable, tuple(result.warnings))


def _tuple(value: Any) -> Any:
    """Return lists as the tuples that they were before they were JSON."""
    return tuple(map(_tuple, value)) if isinstance(value, list) else value


def main() -> None:
    """Take an order, and answer it."""
    os.nice(_NICENESS)
    order = json.load(sys.stdin)
    print(json.dumps(asdict(_answer(order))))


if __name__ == '__main__':
    main()
