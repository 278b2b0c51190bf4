"""The mode shape of a rig from its equations of motion: a truth for tests and benchmarks."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from hunt_ros.dynamics.limit_cycle import Branch
from hunt_ros.dynamics.linear_stability import critical_speed, hunting_mode
from hunt_ros.dynamics.mode_shape import ModeShape, fitted_shape
from hunt_ros.dynamics.parameters import RigParameters


def shape_of(rig: RigParameters, branch: Branch | None = None) -> ModeShape:
    """Return it by Appendix B; with a branch of limit cycles the ratio by amplitude too."""
    speeds = critical_speed(rig) * np.linspace(0.7, 1.15, 10)
    modes = [hunting_mode(rig, float(v)) for v in speeds]
    speed, amplitude = list(speeds), [0.0] * speeds.size
    ratio = [mode.shape[2] / rig.length_scale for mode in modes]
    frequency = [mode.frequency_hz for mode in modes]
    if branch is not None:
        inside = (branch.speed >= speeds[0]) & (branch.speed <= speeds[-1])
        places = np.flatnonzero(inside)
        for k in places[:: max(1, places.size // (2 * speeds.size))]:
            speed.append(float(branch.speed[k]))
            amplitude.append(float(branch.amplitude[k]))
            ratio.append(cycle_ratio(branch, int(k)))
            frequency.append(float(branch.frequency_hz[k]))
    std = np.full(len(speed), 0.002)
    table = fitted_shape(speed, amplitude, ratio, std, frequency, alike=0.0)
    assert table is not None
    return table


def ratio_at(shape: ModeShape, speed: float, amplitude: float) -> complex:
    """Yaw over lateral phasor, rad/m, as the tracker interpolates it."""
    nodes = shape.speeds, shape.amplitudes
    return complex(RegularGridInterpolator(nodes, shape.ratio)((speed, amplitude)))


def cycle_ratio(branch: Branch, place: int) -> complex:
    """Yaw over lateral phasor of the fundamental of one limit cycle of a branch, rad/m."""
    system, x = branch.system, branch.unknowns[place]
    lateral = system.to_fundamental @ x[: system.points]
    yaw = system.to_fundamental @ x[system.points : 2 * system.points]
    return complex(yaw / lateral) / system.rig.length_scale
