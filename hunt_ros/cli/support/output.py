"""What every verb shares in what it prints: JSON for machines, progress for people."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeAlias

from hunt_ros.files import write_whole

#: Shows in the progress bar which fraction of the work is done, 0 to 1.
Advance: TypeAlias = Callable[[float], None]


class Found(NamedTuple):
    """
    What a verb has found.

    Parameters
    ----------
    document : mapping
        For machines: JSON types and numpy numbers; no NaN and no inf: what is not known is None.
    lines : sequence of str
        For a person.
    code : int
        Exit code.
    """

    document: Mapping[str, Any]
    lines: Sequence[str]
    code: int = 0


def tell(found: Found, target: str | None) -> int:
    """
    Say what a verb has found: as JSON where `--json` asks for it, and to a person.

    Parameters
    ----------
    found : Found
        What it is.
    target : str or None
        Of `--json`: path of a file; where it is '-' nothing else stands on standard output.

    Returns
    -------
    int
        The exit code.

    Raises
    ------
    HuntError
        If the file cannot be written.
    ValueError
        If a number is not finite (a fault of the verb).
    """
    text = '\n'.join(found.lines)
    if target:  # first: a reader that goes away (`hunt ... | head`) ends the printing
        document = json.dumps(found.document, indent=2, allow_nan=False, default=_plain)
        if target == '-':
            text = document
        else:
            write_whole(target, document + '\n', 'result')
    print(text, flush=True)
    return found.code


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
    columns = (TextColumn('{task.description}'), BarColumn(), TimeRemainingColumn())
    silent = not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=silent) as bar:
        task = bar.add_task(title, total=1.0)

        def advance(fraction: float) -> None:
            """Move the bar."""
            bar.update(task, completed=fraction)

        yield advance
