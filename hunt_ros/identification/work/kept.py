"""
What was worked out of each recording, kept in a folder, so that another adds only its own work.

A result is known by what it follows from: the work, its arguments, the files of the recording as
they are now, and this program. Where one of them has changed the work is done again.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from hunt_ros.errors import IdentificationError
from hunt_ros.identification.work.places import Tell, Workers
from hunt_ros.samples import Record

_PACKAGE = Path(__file__).parents[2]
#: In a key, of what cannot be told apart from other things of its kind.
_UNKNOWN = ''


class Kept:
    """
    Workers who remember what was collected of them.

    Only what is collected is kept: what other work takes, as the samples of a recording, is made
    again where that is not known already.

    Parameters
    ----------
    workers : Workers
        Who does what is not kept.
    folder : str or Path
        Made where it does not exist.

    Raises
    ------
    IdentificationError
        If nothing can be written there.
    """

    def __init__(self, workers: Workers, folder: str | Path) -> None:
        self._workers, self._folder = workers, Path(folder)
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self._folder):
                pass
        except OSError as error:
            raise IdentificationError(
                f'keep: {folder} is no folder that can be written ({error.strerror})'
            ) from error

    def share(self, value: Any) -> Any:
        """Return the value: each work is given it."""
        return value

    def map(self, work: Callable[..., Any], *arguments: Iterable[Any]) -> list[Any]:
        """Name the work; none of it is begun before it is collected."""
        return [_Work(self._workers, work, row) for row in zip(*arguments, strict=True)]

    def collect(self, handles: Sequence[Any], tell: Tell | None = None) -> list[Any]:
        """Read what is kept, and let the workers do the rest."""
        results = dict(self._found(handles))
        known = len(results)
        rest = [place for place in range(len(handles)) if place not in results]

        def advance(part: float) -> None:
            if tell:
                tell((known + part * len(rest)) / len(handles))

        advance(0.0)
        done = self._workers.collect([handles[place].begun() for place in rest], advance)
        for place, result in zip(rest, done, strict=True):
            self._keep(handles[place].key, result)
            results[place] = result
        return [results[place] for place in range(len(handles))]

    def _found(self, handles: Sequence[_Work]) -> Iterator[tuple[int, Any]]:
        """Yield the places of what is kept, and what it is."""
        for place, handle in enumerate(handles):
            if not handle.key:
                continue
            try:
                yield place, pickle.loads(self._file(handle.key).read_bytes())
            except Exception:  # whatever unpickling a damaged file raises
                continue

    def _keep(self, key: str, result: Any) -> None:
        """Write a result, whole or not at all; a disk that is full costs only the next time."""
        if not key:
            return
        try:
            with tempfile.NamedTemporaryFile(dir=self._folder, delete=False) as file:
                file.write(pickle.dumps(result))
            os.replace(file.name, self._file(key))
        except OSError:
            Path(file.name).unlink(missing_ok=True)

    def _file(self, key: str) -> Path:
        return self._folder / f'{key}.pickle'


def remembering(workers: Workers, folder: str) -> Workers:
    """Return workers who keep in a folder what they did; '' for none."""
    return Kept(workers, folder) if folder else workers


class _Work:
    """Work that is begun when somebody needs its result."""

    def __init__(
        self, workers: Workers, work: Callable[..., Any], arguments: Sequence[Any]
    ) -> None:
        self._workers, self._work, self._arguments = workers, work, arguments
        names = [_name(value) for value in (work, *arguments)]
        text = '\n'.join([_program(), *names])
        #: '' where an argument is a thing of which nobody can say whether it has changed.
        self.key = '' if _UNKNOWN in names else hashlib.sha256(text.encode()).hexdigest()
        self._handle: Any = None

    def begun(self) -> Any:
        """Return a handle of the workers."""
        if self._handle is None:
            row = [one.begun() if isinstance(one, _Work) else one for one in self._arguments]
            (self._handle,) = self._workers.map(self._work, *([one] for one in row))
        return self._handle


def _name(value: Any) -> str:
    """Return what tells an argument from every other one; '' where nothing does."""
    if isinstance(value, _Work):
        return value.key
    if isinstance(value, np.ndarray):
        return f'{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}'
    if isinstance(value, Record):
        return _UNKNOWN  # samples that somebody else holds
    if not callable(value):
        return repr(value)
    if isinstance(value, partial):
        given = (_name(value.func), value.args, value.keywords)
        return _with_files(repr(given), [*value.args, *value.keywords.values()])
    if hasattr(value, '__qualname__'):
        return f'{value.__module__}.{value.__qualname__}'
    return _with_files(repr(value), getattr(value, '__dict__', {}).values())


def _with_files(text: str, arguments: Iterable[Any]) -> str:
    """Return the name of what reads files, with their sizes and times; '' if it reads none."""
    given = [Path(one) for one in arguments if isinstance(one, str | Path) and str(one)]
    paths = [path for path in given if path.exists()]
    files = [file for path in paths for file in ([path] if path.is_file() else path.rglob('*'))]
    states = [(str(file), file.stat().st_size, file.stat().st_mtime_ns) for file in sorted(files)]
    return f'{text} {states}' if states else _UNKNOWN


@cache
def _program() -> str:
    """Return what tells this program from an earlier one: a hash of its text."""
    digest = hashlib.sha256(np.__version__.encode())
    for file in sorted(_PACKAGE.rglob('*.py')):
        digest.update(file.read_bytes())
    return digest.hexdigest()
