"""
Where the work of an identification is done: here, on all cores, or on a Dask cluster.

Work is a function of a module with arguments of its own. What it returns is named by a handle,
which other work may take as an argument: on a cluster the thing itself stays with the worker that
made it, and only what is collected comes here. The numbers are the same wherever it is done, since
all is collected in the order in which it was asked for.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any, Protocol

from hunt_ros.errors import IdentificationError

#: Told which fraction of the work is done.
Tell = Callable[[float], None]
#: A scheduler that does not answer within this is not there.
_ANSWER_S = 10


class Workers(Protocol):
    """Who does the work."""

    def share(self, value: Any) -> Any:
        """Return a handle of a value that much of the work takes."""

    def map(self, work: Callable[..., Any], *arguments: Iterable[Any]) -> list[Any]:
        """
        Begin the work, once for each set of arguments, as the built-in `map`.

        Parameters
        ----------
        work : callable
            A function of a module.
        *arguments : iterables
            Of values or handles.

        Returns
        -------
        list
            Handles, in the order of the arguments.
        """

    def collect(self, handles: Sequence[Any], tell: Tell | None = None) -> list[Any]:
        """
        Wait for work; return its results in the order of the handles.

        Raises
        ------
        Exception
            What the work raised.
        """


class Here:
    """The process itself: a handle is work that is done when its result is asked for."""

    def share(self, value: Any) -> Any:
        """Return the value."""
        return value

    def map(self, work: Callable[..., Any], *arguments: Iterable[Any]) -> list[Any]:
        """Remember the work: it is done when it is collected, or when other work takes it."""
        return [_Later(work, row) for row in zip(*arguments, strict=True)]

    def collect(self, handles: Sequence[Any], tell: Tell | None = None) -> list[Any]:
        """Do the work that is not done yet."""
        results = []
        for done, handle in enumerate(handles, start=1):
            results.append(_value(handle))
            if tell:
                tell(done / len(handles))
        return results


class _Later:
    """Work that is done once, when its result is asked for."""

    def __init__(self, work: Callable[..., Any], arguments: Sequence[Any]) -> None:
        self._work, self._arguments = work, arguments
        self._done = False
        self._result: Any = None

    def value(self) -> Any:
        """Return the result."""
        if not self._done:
            self._result = self._work(*map(_value, self._arguments))
            self._done, self._arguments = True, ()
        return self._result


def _value(handle: Any) -> Any:
    """Return what a handle names."""
    if isinstance(handle, _Later):
        return handle.value()
    return handle.result() if isinstance(handle, Future) else handle


class Cores:
    """Processes on this machine."""

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self._pool = pool

    def share(self, value: Any) -> Any:
        """Return the value: each process is given it with its work."""
        return value

    def map(self, work: Callable[..., Any], *arguments: Iterable[Any]) -> list[Any]:
        """Begin the work."""
        rows = zip(*arguments, strict=True)
        return [self._pool.submit(work, *map(_value, row)) for row in rows]

    def collect(self, handles: Sequence[Any], tell: Tell | None = None) -> list[Any]:
        """Wait for the work."""
        for done, future in enumerate(as_completed(handles), start=1):
            future.result()
            if tell:
                tell(done / len(handles))
        return [future.result() for future in handles]


class Cluster:
    """The workers of a Dask scheduler; what a lost one held is made again by the others."""

    def __init__(self, client: Any) -> None:
        self._client = client

    def share(self, value: Any) -> Any:
        """Give the value to every worker."""
        return self._client.scatter(value, broadcast=True)

    def map(self, work: Callable[..., Any], *arguments: Iterable[Any]) -> list[Any]:
        """Begin the work, where its arguments are."""
        rows = zip(*arguments, strict=True)
        return [self._client.submit(work, *row, pure=False) for row in rows]

    def collect(self, handles: Sequence[Any], tell: Tell | None = None) -> list[Any]:
        """Wait for the work, and bring the results here."""
        from distributed import as_completed as completed

        if tell:
            finished: Any = completed(handles, loop=self._client.loop)  # type: ignore[no-untyped-call]
            for done, _ in enumerate(finished, start=1):
                tell(done / len(handles))
        results: list[Any] = self._client.gather(list(handles))
        return results


@contextmanager
def cores(jobs: int, tasks: int) -> Iterator[Workers]:
    """
    Use processes of this machine.

    Parameters
    ----------
    jobs : int
        How many; 0 for one a core.
    tasks : int
        No more than there is work for; a single one is done here.
    """
    count = min(jobs or os.cpu_count() or 1, tasks)
    if count <= 1:
        yield Here()
        return
    # Spawned, not forked: a fork of a process with threads may hang.
    with ProcessPoolExecutor(count, mp_context=get_context('spawn')) as pool:
        yield Cores(pool)


@contextmanager
def cluster(address: str) -> Iterator[Workers]:
    """
    Use the workers of a Dask scheduler.

    Parameters
    ----------
    address : str
        tcp://host:8786; '' for this process.

    Raises
    ------
    IdentificationError
        If the scheduler cannot be reached, or its library is not installed.
    """
    if not address:
        yield Here()
        return
    try:
        import distributed
    except ImportError:
        raise IdentificationError(
            'a cluster needs the library distributed: pip install hunt_ros[cluster]'
        ) from None
    try:
        client: Any = distributed.Client(  # type: ignore[no-untyped-call]
            address, timeout=_ANSWER_S, set_as_default=False
        )
    except (OSError, ValueError) as error:
        raise IdentificationError(
            f'cluster: no Dask scheduler answers at {address} ({error})'
        ) from error
    with client:
        yield Cluster(client)
