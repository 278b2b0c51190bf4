"""How a recording reads the law: with a gain, a scale of the speed and noise of its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.growth_law import TERMS, reading

Array = NDArray[np.float64]

#: What a recording has of its own: logarithms of its gain and of its scale of the speed, the
#: relative shift of its critical speed, and logarithms of its forcing Q and noise R.
OWN = 5


def as_read(theta: Array, own: Array) -> Array:
    """
    Return law and noise as the readings of a recording have them.

    Parameters
    ----------
    theta : ndarray, shape (..., 15 + cells)
        Law and noise of the rig, as in `path_likelihood.innovations`.
    own : ndarray, shape (..., 5)
        What the recording has of its own.

    Returns
    -------
    ndarray, shape (..., 15 + cells)
    """
    read: Array = np.broadcast_to(theta, (*own.shape[:-1], theta.shape[-1])).copy()
    gain, speed, shift, push, noise = np.moveaxis(own, -1, 0)
    read[..., 0] -= shift * read[..., 1]
    read[..., :TERMS] = np.einsum('...ij,...j->...i', reading(gain, speed), read[..., :TERMS])
    faster = np.expm1(speed)
    read[..., TERMS + 2] += read[..., TERMS] * faster + 2.0 * gain + push
    read[..., TERMS + 3] += noise
    read[..., TERMS] *= 1.0 + faster
    read[..., TERMS + 1] *= np.exp(-2.0 * gain)
    return read
