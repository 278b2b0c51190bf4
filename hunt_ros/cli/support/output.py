"""What every verb shares in what it prints: JSON for machines, progress for people."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeAlias

from hunt_ros.files import write_whole

#: Shows in the progress bar which fraction of the work is done, 0 to 1.
Advance: TypeAlias = Callable[[float], None]


def write_json(document: Mapping[str, Any], target: str) -> None:
    """
    Write a result for machines.

    Parameters
    ----------
    document : mapping
        JSON types and numpy numbers; no NaN and no inf: what is not known is None.
    target : str
        Path of a file, or '-' for standard output.

    Raises
    ------
    HuntError
        If the file cannot be written.
    ValueError
        If a number is not finite (a fault of the caller).
    """
    text = json.dumps(document, indent=2, allow_nan=False, default=_plain) + '\n'
    if target == '-':
        sys.stdout.write(text)
        sys.stdout.flush()
        return
    write_whole(target, text, 'result')


def tell(
    target: str | None, document: Callable[[], Mapping[str, Any]], text: Callable[[], str]
) -> None:
    """
    Say what a verb has found: as JSON where `--json` asks for it, and to a person.

    Parameters
    ----------
    target : str or None
        Of `--json`; where it is '-' nothing else stands on standard output.
    document, text : callable
        Return it.
    """
    if target:  # first: a reader that goes away (`hunt ... | head`) ends the printing
        write_json(document(), target)
    if target != '-':
        print(text())


def _plain(value: Any) -> Any:
    """Turn numpy scalars and arrays into plain Python."""
    if hasattr(value, 'tolist'):
        return value.tolist()
    raise TypeError(f'{type(value).__name__} is no JSON type')


@contextmanager
def progress(title: str) -> Iterator[Advance]:
    """
    Show a progress bar with the time remaining on standard error, if that is a terminal.

    Parameters
    ----------
    title : str
        What is being done.

    Yields
    ------
    Advance
        Call it with the fraction that is done.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda fraction: None
        return
    columns = (TextColumn('{task.description}'), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(title, total=1.0)

        def advance(fraction: float) -> None:
            """Move the bar."""
            bar.update(task, completed=fraction)

        yield advance
