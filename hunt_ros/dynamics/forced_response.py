"""The quiet wheelset under roughness and broadband excitation: linear response and covariance."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.wheelset import Wheelset
from hunt_ros.errors import ConfigError


def direction_response(
    rig: RigParameters, speed: ArrayLike, order: float
) -> NDArray[np.complex128]:
    """
    Linear response to a rolling direction that oscillates with the roller.

    The direction adds to psi in the lateral creep force, so that Eq. (2) has
    d11 exp(i order theta) on its right-hand side, theta the roller angle.

    Parameters
    ----------
    rig : RigParameters
        The rig.
    speed : array_like, shape (...)
        m/s.
    order : float
        Of the roller: 1 is f_r = v / (pi D), Eq. (1); D / (2 r0) is the wheel's own.

    Returns
    -------
    ndarray, shape (..., 4)
        Phasors of (y*, dy*/dt*, psi, dpsi/dt*) for each rad of direction.
    """
    v = np.asarray(speed, dtype=np.float64)
    frequency = order * 2.0 * v / rig.roller_diameter_m * rig.time_scale
    matrix = 1j * frequency[..., None, None] * np.eye(4) - Wheelset(rig).linear_matrix(v)
    push = np.zeros((*v.shape, 4, 1), dtype=np.complex128)
    push[..., 1, 0] = rig.d11
    return np.asarray(np.linalg.solve(matrix, push)[..., 0], dtype=np.complex128)


def quiet_covariance(rig: RigParameters, speed: float, broadband: float) -> NDArray[np.float64]:
    """
    Stationary covariance of the quiet wheelset under white yaw forcing.

    Solves A P + P A' + wn^2 e e' = 0 with e the direction of dpsi/dt*.

    Parameters
    ----------
    rig : RigParameters
        The rig.
    speed : float
        m/s, below the critical speed.
    broadband : float
        wn, strength of the forcing in dimensionless time.

    Returns
    -------
    ndarray, shape (4, 4)
        Of (y*, dy*/dt*, psi, dpsi/dt*).

    Raises
    ------
    ConfigError
        At or above the critical speed, where nothing is stationary.
    """
    matrix = Wheelset(rig).linear_matrix(speed)
    if np.linalg.eigvals(matrix).real.max() >= 0.0:
        raise ConfigError(f'{rig.name}: no stationary state at {speed} m/s, it is unstable there')
    drive = np.zeros((4, 4))
    drive[3, 3] = -(broadband**2)
    # As one system of 16 equations: scipy's solver is 20 MB more in every process that simulates.
    one = np.eye(4)
    both = np.kron(matrix, one) + np.kron(one, matrix)
    covariance = np.linalg.solve(both, drive.ravel()).reshape(4, 4)
    symmetric: NDArray[np.float64] = 0.5 * (covariance + covariance.T)
    return symmetric
