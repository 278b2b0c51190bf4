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
from contextlib import suppress
from dataclasses import is_dataclass
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from inspect import getsourcefile
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from hunt_ros.errors import IdentificationError
from hunt_ros.identification.work.places import Tell, Workers
from hunt_ros.samples import Record

_PACKAGE = Path(__file__).parents[2]
#: On which the numbers rest beside the program's own text.
_LIBRARIES = ('numpy', 'scipy', 'numba')
_OTHERS_WRITE = 0o002


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
        Made where it does not exist. Its content is trusted (it is unpickled).

    Raises
    ------
    IdentificationError
        If nothing can be written there, or others may write there.
    """

    def __init__(self, workers: Workers, folder: str | Path) -> None:
        self._workers, self._folder = workers, Path(folder)
        try:
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self._folder):
                pass
            state = self._folder.stat()
        except OSError as error:
            raise IdentificationError(
                f'work folder: {folder} is no folder that can be written ({error.strerror})'
            ) from error
        if state.st_uid != os.getuid() or state.st_mode & _OTHERS_WRITE:
            raise IdentificationError(
                f'work folder: {folder} is not yours alone: expected one that nobody else may'
                ' write, because what is in it is trusted'
            )

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
            """Pass on which share of all is there, of the share of the rest that is done."""
            if tell:
                tell((known + part * len(rest)) / max(len(handles), 1))

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
        """Write a result, whole or not at all; where that fails it costs only the next time."""
        if not key:
            return
        name = ''
        try:
            with tempfile.NamedTemporaryFile(dir=self._folder, delete=False) as file:
                name = file.name
                file.write(pickle.dumps(result))
            os.replace(name, self._file(key))
        except OSError:
            if name:
                with suppress(OSError):
                    os.unlink(name)

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
        names = [_program(), *map(_name, arguments)]
        text = '\n'.join([f'{work.__module__}.{work.__qualname__}', *names])
        #: '' where an argument is a thing of which nobody can say whether it has changed.
        self.key = hashlib.sha256(text.encode()).hexdigest() if all(names) else ''
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
    if isinstance(value, Record):
        return ''  # samples that somebody else holds
    if isinstance(value, np.ndarray):
        value = (value.dtype.str, value.shape, value.tobytes())
    try:
        name = hashlib.sha256(pickle.dumps(value)).hexdigest()
        return f'{name} {_read_by(value)}' if callable(value) else name
    except (OSError, TypeError, AttributeError, ValueError, pickle.PicklingError):
        return ''  # what cannot be pickled, or files that are not there


def _read_by(source: Callable[..., Any]) -> str:
    """
    Return the states of all files on which rests what a source reads.

    They are the paths among its arguments, and the text of its own module.

    Raises
    ------
    ValueError
        For a source whose arguments are not known, as a lambda.
    """
    if isinstance(source, partial) and isinstance(source.func, FunctionType):
        own: Any = source.func
        arguments = [*source.args, *source.keywords.values()]
    elif is_dataclass(source):
        own, arguments = type(source), list(vars(source).values())
    else:
        raise ValueError(source)
    given = [Path(one) for one in arguments if isinstance(one, str | Path) and str(one)]
    files: list[Path] = []
    for path in given:
        if path.is_dir():
            files += path.rglob('*')
        elif path.exists():
            files += path.parent.glob(f'{path.name}*')  # a database has its journal beside it
    if not files:
        raise ValueError(source)
    files.append(Path(getsourcefile(own) or ''))
    states = [(str(file), file.stat().st_size, file.stat().st_mtime_ns) for file in sorted(files)]
    return str(states)


@cache
def _program() -> str:
    """Return what tells this program from an earlier one; '' where its text is not at hand."""
    files = sorted(_PACKAGE.rglob('*.py'))
    if not files:
        return ''
    digest = hashlib.sha256()
    for name in _LIBRARIES:
        with suppress(PackageNotFoundError):
            digest.update(f'{name} {version(name)} '.encode())
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()
