"""
The bootstrap: fit again with runs (or blocks of a run) drawn with replacement.

A replication depends on nothing but the fit, the seed and its own number, so that one
process, all cores and a cluster give the same numbers.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.errors import IdentificationError
from hunt_ros.identification.fit import FittedLaw, refit
from hunt_ros.identification.settings import IdentificationSettings

#: Replications in one task: long enough to outweigh handing it over.
_CHUNK = 8


def replications(
    fitted: FittedLaw, settings: IdentificationSettings, first: int, last: int
) -> NDArray[np.float64]:
    """
    Laws of the replications first .. last - 1.

    Parameters
    ----------
    fitted : FittedLaw
        The law as fitted to all clusters.
    settings : IdentificationSettings
        For the seed and the priors.
    first, last : int
        Numbers of the replications.

    Returns
    -------
    ndarray, shape (last - first, terms)
        NaN rows where a replication did not converge.
    """
    active = np.unique(fitted.path.cluster)
    rows = []
    for number in range(first, last):
        generator = np.random.default_rng([settings.seed, number])
        drawn = generator.choice(active, active.size)
        weight = np.bincount(drawn, minlength=fitted.path.clusters).astype(np.float64)
        fit = refit(fitted, settings, weight)
        rows.append(fit.law if fit.converged else np.full(fit.law.size, np.nan))
    return np.stack(rows)


def bootstrap(
    fitted: FittedLaw,
    settings: IdentificationSettings,
    count: int,
    progress: Callable[[float], None] | None = None,
) -> NDArray[np.float64]:
    """
    Run the replications: in this process, on all cores, or on a Dask cluster.

    Parameters
    ----------
    fitted : FittedLaw
        The law as fitted to all clusters.
    settings : IdentificationSettings
        `jobs` processes, or the scheduler at `cluster`.
    count : int
        Number of replications.
    progress : callable, optional
        Told which fraction is done.

    Returns
    -------
    ndarray, shape (count, terms)
        In the order of their numbers, wherever they were run.

    Raises
    ------
    IdentificationError
        If the scheduler cannot be reached, or its library is not installed.
    """
    tell = progress or (lambda fraction: None)
    parts = [(low, min(low + _CHUNK, count)) for low in range(0, count, _CHUNK)]
    if settings.cluster:
        return np.concatenate(_on_cluster(fitted, settings, parts, tell))
    jobs = settings.jobs or os.cpu_count() or 1
    if jobs == 1 or len(parts) == 1:
        rows = []
        for done, (low, high) in enumerate(parts, start=1):
            rows.append(replications(fitted, settings, low, high))
            tell(done / len(parts))
        return np.concatenate(rows)
    # Spawned, not forked: a fork of a process with threads may hang.
    with ProcessPoolExecutor(min(jobs, len(parts)), mp_context=get_context('spawn')) as pool:
        futures = {
            pool.submit(replications, fitted, settings, low, high): low for low, high in parts
        }
        results: dict[int, NDArray[np.float64]] = {}
        for future in as_completed(futures):
            results[futures[future]] = future.result()
            tell(len(results) / len(parts))
    return np.concatenate([results[low] for low, _ in parts])


def _on_cluster(
    fitted: FittedLaw,
    settings: IdentificationSettings,
    parts: Sequence[tuple[int, int]],
    tell: Callable[[float], None],
) -> list[NDArray[np.float64]]:
    """Run the parts on the workers of a Dask scheduler."""
    try:
        import distributed
    except ImportError:
        raise IdentificationError(
            'a cluster needs the library distributed: pip install hunt_ros[cluster]'
        ) from None
    try:
        client: Any = distributed.Client(  # type: ignore[no-untyped-call]
            settings.cluster, timeout='10s'
        )
    except (OSError, ValueError) as error:
        raise IdentificationError(
            f'cluster: no Dask scheduler answers at {settings.cluster} ({error})'
        ) from error
    completed: Any = distributed.as_completed
    with client:
        shared = client.scatter(fitted, broadcast=True)
        futures = [
            client.submit(replications, shared, settings, low, high, pure=False)
            for low, high in parts
        ]
        for done, _ in enumerate(completed(futures), start=1):
            tell(done / len(parts))
        gathered: list[NDArray[np.float64]] = client.gather(futures)
    return gathered
