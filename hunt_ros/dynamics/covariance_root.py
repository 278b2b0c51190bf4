"""A covariance as the inverse of an information, and its root, which makes draws of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def covariance_root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Root R of a covariance, R R^T = covariance, of which there is only one.

    A root made of eigenvectors alone has their signs and their order, which are those of the
    linear algebra library in use: the same seed would draw other numbers on another machine.
    The symmetric root of a matrix is unique. It is taken of the correlations, since
    variances may span twenty powers of ten and the small ones would be lost in rounding.

    Parameters
    ----------
    covariance : ndarray, shape (n, n)
        Symmetric, positive semidefinite to rounding; a variance of zero is allowed.

    Returns
    -------
    ndarray, shape (n, n)
        A standard normal vector z of shape (n,) becomes the draw R z.
    """
    std = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    scale = np.where(std > 0.0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    root: NDArray[np.float64] = (vectors * np.sqrt(np.clip(values, 0.0, None))) @ vectors.T
    return std[:, None] * root


def inverse_of(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse, brought to a unit diagonal first; zeros for what was held."""
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    unit = np.where(size > 0.0, size, 1.0)
    scaled = np.linalg.pinv(information / np.outer(unit, unit), rcond=1e-13, hermitian=True)
    # Exactly: an eigenvector of a zero may have traces of the others.
    varied = (size > 0.0).astype(np.float64)
    inverse: NDArray[np.float64] = scaled * np.outer(varied / unit, varied / unit)
    return inverse
