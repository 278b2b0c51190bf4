"""
From white yaw forcing of the full model to diffusion of the amplitude of hunting.

The amplitude is a function of the state; forcing of dpsi/dt* moves it at the rate of
its gradient's fourth component p4. Averaged over a cycle, D = wn^2 <p4^2> / 2 in
dimensionless time. At rest the gradient is the left eigenvector of the hunting mode;
on the unstable limit cycle it is the left Floquet vector of its unstable multiplier.
"""

from __future__ import annotations

import math

import numpy as np

from hunt_ros.dynamics.center_manifold import ComplexNormalForm
from hunt_ros.dynamics.collocation import FLOQUET_STEPS, fundamental_matrices
from hunt_ros.dynamics.limit_cycle import Branch
from hunt_ros.dynamics.linear_stability import hunting_mode
from hunt_ros.dynamics.noise.escape import AmplitudeDiffusion
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.errors import ConfigError


def quiet_diffusion(rig: RigParameters, speed: float, broadband: float) -> float:
    """
    D of a small amplitude, m^2/s: wn^2 |l4|^2 d0^2 omega_psi, with l . v = 1 and v_y* = 1.

    Parameters
    ----------
    rig : RigParameters
        The rig.
    speed : float
        m/s.
    broadband : float
        wn, dimensionless.
    """
    sensitivity = abs(hunting_mode(rig, speed).adjoint[3])
    return float((broadband * sensitivity * rig.length_scale) ** 2 / rig.time_scale)


def amplitude_diffusion(
    rig: RigParameters, speed: float, broadband: float, branch: Branch | None = None
) -> AmplitudeDiffusion:
    """
    Diffusion of the amplitude at one speed, from rest to the unstable limit cycle.

    Parameters
    ----------
    rig : RigParameters
        The rig.
    speed : float
        m/s.
    broadband : float
        wn, dimensionless.
    branch : Branch, optional
        Limit cycles of the rig. Without it, or where it has no unstable cycle at
        this speed, the diffusion is taken as that at rest.

    Returns
    -------
    AmplitudeDiffusion
        Through the values at rest and on the unstable cycle.
    """
    quiet = quiet_diffusion(rig, speed, broadband)
    cycle = _unstable_cycle(branch, speed) if branch is not None else None
    if cycle is None or quiet == 0.0:
        return AmplitudeDiffusion(quiet)
    on_cycle = _cycle_sensitivity(cycle) * (broadband * rig.length_scale) ** 2 / rig.time_scale
    amplitude = float(cycle.amplitude[0])
    return AmplitudeDiffusion(quiet, math.log(on_cycle / quiet) / amplitude**2)


def local_form(theory: ComplexNormalForm, branch: Branch, speed: float) -> NormalForm:
    """
    Normal form that is exact about one speed of the full model, for escape from rest there.

    D1 and D4 are those of theory; D7, D10 and D15 give the full model's growth
    rate at rest, its unstable amplitude, and the Floquet exponent of that cycle,
    which are what the rate of escape depends on.

    Parameters
    ----------
    theory : ComplexNormalForm
        Of the rig.
    branch : Branch
        Limit cycles of the rig.
    speed : float
        m/s, in the hysteresis region.

    Returns
    -------
    NormalForm
        To be used near `speed` only.

    Raises
    ------
    ConfigError
        Where there is no unstable cycle at the speed.
    """
    cycle = _unstable_cycle(branch, speed)
    if cycle is None:
        raise ConfigError(f'no unstable limit cycle at {speed} m/s')
    start = theory.amplitude_coordinate
    eps = speed / start.critical_speed - 1.0
    rest = hunting_mode(branch.system.rig, speed).growth_rate * start.time_scale
    exponent = float(cycle.exponent[0]) * start.time_scale
    r2 = float(cycle.amplitude[0] / (2.0 * start.length_scale)) ** 2
    # s = rest + c1 r^2 + c2 r^4 with s = 0 and r ds/dr = exponent on the cycle
    c2 = (0.5 * exponent + rest) / r2**2
    c1 = -rest / r2 - c2 * r2
    return NormalForm(
        critical_speed=start.critical_speed,
        D1=start.D1,
        D4=start.D4,
        D7=(rest - start.D1 * eps) / eps**2,
        D10=(c1 - start.D4) / eps,
        D15=c2,
        length_scale=start.length_scale,
        time_scale=start.time_scale,
        frequency_hz=start.frequency_hz,
    )


def _unstable_cycle(branch: Branch, speed: float) -> Branch | None:
    cycles = branch.at_speed(speed)
    places = np.flatnonzero(~cycles.stable)
    return cycles[places[:1]] if len(places) else None


def _cycle_sensitivity(cycle: Branch) -> float:
    """<p4^2> / 2 on one unstable cycle, with p the gradient of the amplitude of y*."""
    system, x = cycle.system, cycle.unknowns
    steps = 4 * FLOQUET_STEPS
    matrices = fundamental_matrices(system, x, steps)[:, 0]
    values, right = np.linalg.eig(matrices[-1])
    left = np.linalg.inv(right)
    place = int(np.argmax(np.where(np.abs(values + 1.0) > 1e-6, np.abs(values), 0.0)))
    # Half a period multiplies the vector by `values[place]`, negative as the cycle itself.
    decay = np.abs(values[place]) ** (-np.arange(steps + 1) / steps)
    q = np.einsum('kij,j->ki', matrices, right[:, place].real) * decay[:, None]
    p = np.linalg.solve(np.swapaxes(matrices, 1, 2), left[place].real[None, :, None])[..., 0]
    p = p / decay[:, None]
    # fundamental of q_y in phase with that of y, which is real and positive by the phase condition
    phase = np.pi * np.arange(steps) / steps
    fundamental = 2.0 * np.mean(q[:steps, 0] * np.exp(-1j * phase))
    cycle_fundamental = system.to_fundamental @ (x[0, : system.points])
    change = (fundamental * np.conj(cycle_fundamental)).real / abs(cycle_fundamental)
    return float(0.5 * np.mean((p[:steps, 3] * change) ** 2))
