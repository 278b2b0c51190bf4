"""
What the page shows at one moment, immutable, and the difference between two such moments.

A view has sections, small documents that are replaced as a whole, and streams, to which rows
are appended. It is made once for all viewers. What a viewer is sent is the difference between
the view that it has and the newest one: a viewer that is slow gets fewer and larger
differences, a new one the difference to nothing, which is the whole.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

Row = tuple[Any, ...]


@dataclass(frozen=True)
class Section:
    """
    A document that is replaced as a whole.

    Parameters
    ----------
    version : int
        Another one for other data.
    data : object
        For JSON, without NaN and inf.
    """

    version: int
    data: Any


@dataclass(frozen=True)
class Stream:
    """
    The last rows of a stream.

    Parameters
    ----------
    generation : int
        Another one where the rows do not follow those before: all are sent anew.
    first : int
        Number of the first of `rows`, counted from the first row of the generation.
    rows : tuple of tuple
        In order.
    """

    generation: int
    first: int
    rows: tuple[Row, ...]

    @property
    def end(self) -> int:
        """Number of the row that comes next."""
        return self.first + len(self.rows)


@dataclass(frozen=True)
class View:
    """
    What the page shows at one moment.

    Parameters
    ----------
    sections : mapping of str to Section
    streams : mapping of str to Stream
    """

    sections: Mapping[str, Section] = field(default_factory=dict)
    streams: Mapping[str, Stream] = field(default_factory=dict)


def changes(before: View, after: View) -> dict[str, Any]:
    """
    Return what turns one view into a later one.

    Parameters
    ----------
    before, after : View
        `View()` as the first: everything is sent.

    Returns
    -------
    dict
        `sections`: name to data, those that changed. `streams`: name to `keep` (number of the
        first row that is still shown; rows before it go), `fresh` (True: forget all rows of
        before), `first` (number of the first of the rows sent) and `rows`; those that changed.
    """
    sections = {
        name: section.data
        for name, section in after.sections.items()
        if name not in before.sections or before.sections[name].version != section.version
    }
    streams = {}
    for name, stream in after.streams.items():
        old = before.streams.get(name)
        fresh = old is None or old.generation != stream.generation or old.end < stream.first
        have = stream.first if fresh or old is None else old.end
        if fresh or have < stream.end:
            rows = stream.rows[have - stream.first :]
            streams[name] = {'fresh': fresh, 'keep': stream.first, 'first': have, 'rows': rows}
    return {'sections': sections, 'streams': streams}


class Rows:
    """
    The rows of a stream as they come.

    Parameters
    ----------
    most : int
        Rows that are kept.
    """

    def __init__(self, most: int) -> None:
        self._rows: deque[Row] = deque(maxlen=most)
        self._generation = 0
        self._count = 0
        self._seen: Stream | None = None

    def append(self, rows: Iterable[Row]) -> None:
        """Add rows at the end; the oldest go."""
        before = self._count
        for row in rows:
            self._rows.append(row)
            self._count += 1
        if self._count != before:
            self._seen = None

    def replace(self, rows: Iterable[Row]) -> None:
        """Forget all rows, and begin anew with others."""
        self._rows.clear()
        self._generation += 1
        self._count = 0
        self._seen = None
        self.append(rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Any:
        return iter(self._rows)

    @property
    def stream(self) -> Stream:
        """What is to be shown now."""
        if self._seen is None:
            rows = tuple(self._rows)
            self._seen = Stream(self._generation, self._count - len(rows), rows)
        return self._seen
