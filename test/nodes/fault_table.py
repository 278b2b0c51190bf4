"""The table of docs/faults.md: what came of each fault, one row a fault."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

#: How often a fault is tried.
_ATTEMPTS = 5
_HEAD = '| fault | mode | interlock | until the set point falls, s | told |'


@dataclass(frozen=True)
class Fault:
    """
    What is done to the suite, and what is expected of it.

    Parameters
    ----------
    what : str
        For the table.
    begin : callable
        Makes it happen.
    state : str
        Of the interlock after it: tripped, armed, disarmed.
    words : str
        Stands in the cause that the operator is told.
    """

    what: str
    begin: Callable[..., object]
    state: str = 'tripped'
    words: str = ''


@dataclass
class Row:
    """
    What came of a fault.

    Parameters
    ----------
    what : str
        The fault.
    mode : str
        Of the interlock.
    state : str
        Of the interlock after it, and the set point.
    safe_s : float or None
        Until the first lower set point; None where it does not fall.
    told : str
        What the operator is told.
    """

    what: str
    mode: str
    state: str
    safe_s: float | None
    told: str

    def __str__(self) -> str:
        slow = '-' if self.safe_s is None else f'{self.safe_s:.2f}'
        return f'| {self.what} | {self.mode} | {self.state} | {slow} | {self.told} |'


def observed(
    what: str,
    attempt: Callable[[int], Row | None],
    status: Callable[[], object],
) -> Row:
    """
    Return what came of a fault, by the first attempt that shows it.

    A busy machine may be silent by itself, and then that is the cause: it is tried again, with
    more patience by the number of the attempt.
    """
    why = ''
    for number in range(_ATTEMPTS):
        try:
            row = attempt(number)
        except AssertionError as error:  # a wait was in vain
            row, why = None, str(error)
        if row is not None:
            return row
    pytest.fail(f'{what}: {why or status()}')


def publish(rows: list[Row], path: Path) -> None:
    """Put the rows in the place of those that a file ends with."""
    before, _, _ = path.read_text(encoding='utf-8').partition(_HEAD)
    lines = [_HEAD, '|---|---|---|---|---|', *map(str, rows)]
    path.write_text(before + '\n'.join(lines) + '\n', encoding='utf-8')
