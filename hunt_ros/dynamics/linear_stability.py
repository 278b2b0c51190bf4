"""
The linear theory, Appendix B: eigenvalues, critical speed, hunting frequency.

The hunting mode is the least damped oscillation of the wheelset about its centre. At the end the
quiet wheelset under roughness and broadband excitation: linear response and covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.wheelset import Wheelset
from hunt_ros.errors import ConfigError

Complex = NDArray[np.complex128]
#: At the critical speed itself an eigenvalue is off zero by rounding, some 1e-15 of the others.
_ROUNDING = 1e-9


def eigenvalues(rig: RigParameters, speed: ArrayLike) -> Complex:
    """
    Eigenvalues of A, Eq. (6), the least damped first.

    Parameters
    ----------
    rig : RigParameters
        The rig.
    speed : array_like, shape (...)
        m/s.

    Returns
    -------
    ndarray, shape (..., 4)
        1/s and rad/s; of a pair the one with positive imaginary part comes first.

    Raises
    ------
    ConfigError
        For a speed that is not positive.
    """
    values = np.linalg.eigvals(Wheelset(rig).linear_matrix(speed)).astype(np.complex128)
    order = np.lexsort((-values.imag, -np.round(values.real, 12)), axis=-1)
    sorted_values: Complex = np.take_along_axis(values, order, axis=-1) / rig.time_scale
    return sorted_values


@dataclass(frozen=True, eq=False)
class Mode:
    """
    The hunting mode at one speed.

    Parameters
    ----------
    eigenvalue : complex
        Growth rate (1/s) and angular frequency (rad/s).
    shape : ndarray, shape (4,)
        Right eigenvector in (y*, dy*/dt*, psi, dpsi/dt*), its y* component 1.
    adjoint : ndarray, shape (4,)
        Left eigenvector l with l . shape = 1 (no conjugation).
    """

    eigenvalue: complex
    shape: Complex
    adjoint: Complex

    @property
    def growth_rate(self) -> float:
        """1/s."""
        return self.eigenvalue.real

    @property
    def frequency_hz(self) -> float:
        """Hz."""
        return self.eigenvalue.imag / (2.0 * math.pi)


def hunting_mode(rig: RigParameters, speed: float) -> Mode:
    """
    Eigenvalue and eigenvectors of the least damped oscillation at a speed in m/s.

    Raises
    ------
    ConfigError
        Where nothing oscillates (creep damping at very low speed), or the
        eigenvalue is a double one, which has no pair of eigenvectors.
    """
    matrix = Wheelset(rig).linear_matrix(speed)
    values, vectors = np.linalg.eig(matrix)
    if not (values.imag > 1e-12).any():
        raise ConfigError(f'{rig.name}: no oscillating mode at {speed} m/s')
    place = int(np.argmax(np.where(values.imag > 1e-12, values.real, -np.inf)))
    shape = vectors[:, place] / vectors[0, place]
    adjoint = np.linalg.inv(vectors)[place] * vectors[0, place]
    others = np.delete(values, place)
    if np.abs(others - values[place]).min() < 1e-7:
        raise ConfigError(f'{rig.name}: eigenvalue {values[place]:.6g} is double at {speed} m/s')
    return Mode(complex(values[place]) / rig.time_scale, shape, adjoint)


def critical_frequency(rig: RigParameters) -> float:
    """Dimensionless hunting frequency at the critical speed, omega of Eq. (B-1)."""
    return math.sqrt((rig.d11 * rig.k22 + rig.d22 * rig.k11) / (rig.d11 + rig.d22))


def critical_speed(rig: RigParameters) -> float:
    """
    Linear critical speed v_c, m/s: where the hunting mode stops being damped.

    With i omega of Eq. (B-1) in the characteristic polynomial,
    d11 d22 / v_c*^2 = omega^2 + (k11 k22 - k12 k21) / omega^2 - k11 - k22.

    Raises
    ------
    ConfigError
        If there is none (the rig is stable at every speed).
    """
    omega2 = critical_frequency(rig) ** 2
    stiffness = rig.k11 * rig.k22 - rig.k12 * rig.k21
    damping = omega2 + stiffness / omega2 - rig.k11 - rig.k22
    if damping <= 0.0:
        raise ConfigError(
            f'{rig.name}: no Hopf point, the wheelset is stable at every speed'
            f' (tread_angle = {rig.tread_angle:g}, d11 d22 / v_c^2 would be {damping:.3g})'
        )
    return rig.speed_scale * math.sqrt(rig.d11 * rig.d22 / damping)


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


def settles(matrix: NDArray[np.float64]) -> bool:
    """Return True where a linear motion of this matrix dies out: below the critical speed."""
    values = np.linalg.eigvals(matrix)
    return bool(values.real.max() < -_ROUNDING * np.abs(values).max())


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
    if not settles(matrix):
        raise ConfigError(
            f'{rig.name}: no stationary state at {speed} m/s, nothing dies out there'
        )
    drive = np.zeros((4, 4))
    drive[3, 3] = -(broadband**2)
    # As one system of 16 equations: scipy's solver is 20 MB more in every process that simulates.
    one = np.eye(4)
    both = np.kron(matrix, one) + np.kron(one, matrix)
    covariance = np.linalg.solve(both, drive.ravel()).reshape(4, 4)
    symmetric: NDArray[np.float64] = 0.5 * (covariance + covariance.T)
    return symmetric
