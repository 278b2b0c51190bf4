"""
The bootstrap: fit again with runs (or blocks of a run) drawn with replacement.

A replication depends on nothing but the fit, the seed and its own number, so that one
process, all cores and a cluster give the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hunt_ros.identification.fit import FittedLaw, refit
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.identification.work.places import cluster, cores

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
    low = range(0, count, _CHUNK)
    high = [min(first + _CHUNK, count) for first in low]
    with cluster(settings.cluster) if settings.cluster else cores(settings.jobs, len(low)) as who:
        shared = [who.share(fitted)] * len(low)
        parts = who.map(replications, shared, [settings] * len(low), low, high)
        return np.concatenate(who.collect(parts, progress))
