"""Where work is done: in this process, or by a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from hunt_ros.errors import IdentificationError

#: Told which fraction of the work is done.
Tell = Callable[[float], None]
#: As the built-in `map`: gives the results in the order of the arguments.
Mapper = Callable[..., Iterator[Any]]
#: A scheduler that does not answer within this is not there.
_ANSWER_S = 10


@contextmanager
def mapper(cluster: str = '') -> Iterator[Mapper]:
    """
    Open what maps a function; in this process each piece is done when its result is asked for.

    Parameters
    ----------
    cluster : str
        Address of a Dask scheduler, tcp://host:8786; '' for this process.

    Raises
    ------
    IdentificationError
        If the scheduler cannot be reached, or its library is not installed.
    """
    if not cluster:
        yield map
        return
    try:
        import distributed
    except ImportError:
        raise IdentificationError(
            'a cluster needs the library distributed: pip install hunt_ros[cluster]'
        ) from None
    try:
        client: Any = distributed.Client(  # type: ignore[no-untyped-call]
            cluster, timeout=_ANSWER_S, set_as_default=False
        )
    except (OSError, ValueError) as error:
        raise IdentificationError(
            f'cluster: no Dask scheduler answers at {cluster} ({error})'
        ) from error
    with client, client.get_executor(pure=False) as pool:
        yield pool.map
