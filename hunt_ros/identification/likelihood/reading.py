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
    theta : ndarray, shape (15,)
        Law and noise of the rig, as in `path_likelihood.innovations`.
    own : ndarray, shape (5,)
        What the recording has of its own.

    Returns
    -------
    ndarray, shape (15,)
    """
    gain, speed, shift, push, noise = own.tolist()
    read: Array = theta.copy()
    read[0] -= shift * theta[1]
    read[:TERMS] = reading(gain, speed) @ read[:TERMS]
    by_speed, by_power = theta[TERMS : TERMS + 2]
    faster = np.expm1(speed)
    read[TERMS:-1] = (
        by_speed * (1.0 + faster),
        by_power * np.exp(-2.0 * gain),
        theta[TERMS + 2] + by_speed * faster + 2.0 * gain + push,
        theta[TERMS + 3] + noise,
    )
    return read


def derivatives(theta: Array, own: Array) -> Array:
    """
    Return the derivatives of `as_read` by theta and by what the recording has.

    Parameters
    ----------
    theta, own : ndarray, shape (15,) and (5,)
        As for `as_read`.

    Returns
    -------
    ndarray, shape (15, 15 + 5)
    """
    matrix = np.zeros((theta.size, theta.size + OWN))
    matrix[:TERMS, :TERMS] = reading(own[0], own[1])
    matrix[:TERMS, 1] -= own[2] * matrix[:TERMS, 0]
    faster = np.expm1(own[1])
    noise = np.arange(TERMS, theta.size)
    matrix[noise, noise] = 1.0 + faster, np.exp(-2.0 * own[0]), 1.0, 1.0, 1.0
    matrix[TERMS + 2, TERMS] = faster
    for k in range(OWN):
        step = 1e-6 * np.eye(OWN)[k]
        matrix[:, theta.size + k] = (
            as_read(theta, own + step) - as_read(theta, own - step)
        ) / 2e-6
    return matrix
