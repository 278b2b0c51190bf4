"""
Equations of motion (2), (3): the right-hand side and its Jacobian.

States are x = (y*, dy*/dt*, psi, dpsi/dt*), Eq. (7), in the dimensionless time
t* = omega_psi t. No flange and no disturbance here: these belong to the simulation.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.dynamics.parameters import CUBIC_KEYS, QUINTIC_KEYS, RigParameters
from hunt_ros.errors import ConfigError

Array = NDArray[np.float64]

#: Imaginary step by which derivatives are taken: its square is nothing.
TINY = 1e-30


class Wheelset:
    """
    The vector field of a rig, vectorised over states and speeds.

    Parameters
    ----------
    rig : RigParameters
        Its dimensionless coefficients (4) are used.
    """

    def __init__(self, rig: RigParameters) -> None:
        self.rig = rig

    @cached_property
    def cubic(self) -> Array:
        """Rows alpha, beta; columns 30, 21, 12, 03: shape (2, 4)."""
        rows = (self.rig.alpha, self.rig.beta)
        return np.array([[row.get(key, 0.0) for key in CUBIC_KEYS] for row in rows])

    @cached_property
    def quintic(self) -> Array:
        """Rows alpha, beta; columns 50, 41, 32, 23, 14, 05: shape (2, 6)."""
        rows = (self.rig.alpha, self.rig.beta)
        return np.array([[row.get(key, 0.0) for key in QUINTIC_KEYS] for row in rows])

    def linear_matrix(self, speed: ArrayLike) -> Array:
        """
        Matrix A of Eq. (6).

        Parameters
        ----------
        speed : array_like, shape (...)
            Running speed v, m/s.

        Returns
        -------
        ndarray, shape (..., 4, 4)
            Per unit of dimensionless time.

        Raises
        ------
        ConfigError
            For a speed that is not positive: the creep damping is d / v*.
        """
        v = np.asarray(speed, dtype=np.float64) / self.rig.speed_scale
        if not np.all(v > 0.0):
            raise ConfigError(f'speed must be positive, got {np.min(speed)} m/s')
        matrix = np.zeros((*v.shape, 4, 4))
        matrix[..., 0, 1] = 1.0
        matrix[..., 1, 0] = -self.rig.k11
        matrix[..., 1, 1] = -self.rig.d11 / v
        matrix[..., 1, 2] = -self.rig.k12
        matrix[..., 2, 3] = 1.0
        matrix[..., 3, 0] = -self.rig.k21
        matrix[..., 3, 2] = -self.rig.k22
        matrix[..., 3, 3] = -self.rig.d22 / v
        return matrix

    def nonlinear_forces(self, y: ArrayLike, psi: ArrayLike) -> Array:
        """
        Cubic and quintic terms of Eqs. (2) and (3), on the left-hand side as there.

        Parameters
        ----------
        y, psi : array_like, shape (...)
            y* and psi.

        Returns
        -------
        ndarray, shape (..., 2)
            Sums of the alpha and of the beta terms.
        """
        y, psi = np.broadcast_arrays(y, psi)
        third = np.stack([y ** (3 - j) * psi**j for j in range(4)], axis=-1)
        fifth = np.stack([y ** (5 - j) * psi**j for j in range(6)], axis=-1)
        forces: Array = third @ self.cubic.T + fifth @ self.quintic.T
        return forces

    def derivative(self, state: ArrayLike, speed: ArrayLike) -> Array:
        """
        Right-hand side of Eq. (6).

        Parameters
        ----------
        state : array_like, shape (..., 4)
            (y*, dy*/dt*, psi, dpsi/dt*).
        speed : array_like, shape (...)
            Running speed v, m/s; broadcast with the states.

        Returns
        -------
        ndarray, shape (..., 4)
            Per unit of dimensionless time.
        """
        x = np.asarray(state)
        result: Array = np.einsum('...ij,...j->...i', self.linear_matrix(speed), x)
        result[..., 1::2] -= self.nonlinear_forces(x[..., 0], x[..., 2])
        return result

    def jacobian(self, state: ArrayLike, speed: ArrayLike) -> Array:
        """
        Derivative of `derivative` with respect to the state, by a complex step: exact to rounding.

        Parameters
        ----------
        state : array_like, shape (..., 4)
            (y*, dy*/dt*, psi, dpsi/dt*).
        speed : array_like, shape (...)
            Running speed v, m/s; broadcast with the states.

        Returns
        -------
        ndarray, shape (..., 4, 4)

        References
        ----------
        Squire, W., Trapp, G. (1998), SIAM Review 40, 110-112.
        """
        x = np.asarray(state, dtype=np.float64)[..., None, :] + 1j * TINY * np.eye(4)
        columns = self.derivative(x, np.asarray(speed)[..., None]).imag / TINY
        matrix: Array = np.swapaxes(columns, -1, -2)
        return matrix
