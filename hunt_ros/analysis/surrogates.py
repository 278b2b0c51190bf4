"""
Is there more to a signal than its spectrum? A test by surrogates.

A surrogate has the spectrum of the record and random phases: a linear, Gaussian process.
Where neighbours of the record stay together better than those of all surrogates, there
is more to the record than its spectrum. Sharp lines stay sharp lines whatever their phases:
hunting over roughness is as predictable as its surrogates.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree


def phase_randomised(
    values: NDArray[np.float64], generator: np.random.Generator
) -> NDArray[np.float64]:
    """
    Return a signal of the same power spectrum with random phases.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Uniform samples.
    generator : numpy Generator
        Of the phases.

    References
    ----------
    Theiler, Eubank, Longtin, Galdrikian and Farmer 1992, Physica D 58, 77-94.
    """
    spectrum = np.fft.rfft(values)
    phases = generator.uniform(0.0, 2.0 * np.pi, spectrum.size)
    phases[0] = 0.0
    if values.size % 2 == 0:
        phases[-1] = 0.0
    return np.asarray(np.fft.irfft(np.abs(spectrum) * np.exp(1j * phases), values.size))


def delay_vectors(values: NDArray[np.float64], embedding: int, delay: int) -> NDArray[np.float64]:
    """Return the delay embedding, shape (n - (embedding - 1) delay, embedding)."""
    size = values.size - (embedding - 1) * delay
    return np.stack([values[k * delay : k * delay + size] for k in range(embedding)], axis=1)


def neighbour_pairs(
    orbit: NDArray[np.float64],
    usable: int,
    most_points: int,
    neighbours: int,
    theiler: int,
) -> NDArray[np.int64]:
    """
    Pairs of near points further apart in time than the Theiler window.

    Parameters
    ----------
    orbit : ndarray, shape (n, embedding)
        Delay vectors.
    usable : int
        Only the first of them are paired: the rest is needed to follow them.
    most_points : int
        Points whose neighbours are sought, spread over the orbit.
    neighbours : int
        Pairs for each point, at most.
    theiler : int
        Window, samples.

    Returns
    -------
    ndarray of int64, shape (m, 2)
    """
    starts = np.unique(np.linspace(0, usable - 1, min(most_points, usable)).astype(np.int64))
    # Those inside the window come first and are thrown away: ask for more than needed.
    asked = min(neighbours + 2 * theiler + 1, usable, 60 + neighbours)
    _, found = cKDTree(orbit[:usable]).query(orbit[starts], k=asked)
    pairs: list[tuple[int, int]] = []
    for start, near in zip(starts.tolist(), found, strict=True):
        apart = near[np.abs(near - start) > theiler][:neighbours]
        pairs.extend((start, int(other)) for other in apart)
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def is_nonlinear(
    values: NDArray[np.float64],
    embedding: int,
    delay: int,
    period: int,
    surrogates: int = 19,
    most_points: int = 500,
    seed: int = 0,
) -> bool:
    """
    Return True if neighbours are closer after one period than those of every surrogate.

    With 19 surrogates a linear response to noise passes for nonlinear once in twenty.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Uniform samples.
    embedding, delay, period : int
        Dimension, delay and mean period in samples.
    surrogates, most_points, seed : int
        Number of surrogates, of points followed in each, and the seed of their phases.
    """
    generator = np.random.default_rng(seed)

    def apart(signal: NDArray[np.float64]) -> float:
        """Return how far, in the logarithm, neighbours are apart a period later."""
        orbit = delay_vectors(signal / np.std(signal), embedding, delay)
        pairs = neighbour_pairs(orbit, len(orbit) - period, most_points, 1, period)
        if not len(pairs):
            return np.inf
        later = np.linalg.norm(orbit[pairs[:, 0] + period] - orbit[pairs[:, 1] + period], axis=1)
        return float(np.mean(np.log(np.maximum(later, 1e-12))))

    own = apart(values)
    return all(own < apart(phase_randomised(values, generator)) for _ in range(surrogates))
