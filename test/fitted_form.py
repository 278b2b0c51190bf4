"""The quintic form nearest to the limit cycles of a rig: a truth for tests and benchmarks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hunt_ros.dynamics.center_manifold import ComplexNormalForm
from hunt_ros.dynamics.limit_cycle import Branch
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.errors import ConfigError


def fitted_form(
    theory: ComplexNormalForm, branch: Branch, speeds: tuple[float, float]
) -> NormalForm:
    """
    Quintic form in the amplitude coordinate that fits the limit cycles of the full model best.

    The Taylor form of `center_manifold` is exact at the Hopf point and may be far off at the fold.
    D1 is that of linear theory, which sets the time scale; D4, D7, D10 and D15
    minimise the difference of speed at given amplitude, which unlike that of
    amplitude at given speed is smooth through the fold.

    Parameters
    ----------
    theory : ComplexNormalForm
        Gives v_c, D1 and the scales.
    branch : Branch
        Of the full model.
    speeds : (float, float)
        Speeds that count, m/s.

    Returns
    -------
    NormalForm

    Raises
    ------
    ConfigError
        With fewer than eight cycles in the range.
    """
    inside = (branch.speed >= speeds[0]) & (branch.speed <= speeds[1])
    if inside.sum() < 8:
        raise ConfigError(f'{inside.sum()} limit cycles between {speeds[0]} and {speeds[1]} m/s')
    start = theory.amplitude_coordinate
    eps = branch.speed[inside] / theory.critical_speed - 1.0
    r2 = (branch.amplitude[inside] / (2.0 * theory.length_scale)) ** 2
    # An arclength step counts once: continuation crowds its points at the start.
    steps = np.hypot(np.diff(eps), np.diff(np.sqrt(r2 / r2.max())))
    weight = np.sqrt(np.gradient(np.append(0.0, np.cumsum(steps))))
    columns = np.stack([r2, eps**2, eps * r2, r2**2], axis=1)
    slope = np.full_like(eps, start.D1)  # d(growth)/d(eps): turns the equation into a speed
    for _ in range(20):
        rows = columns * (weight / slope)[:, None]
        scale = np.linalg.norm(rows, axis=0)
        solution, *_ = np.linalg.lstsq(rows / scale, -start.D1 * eps * weight / slope, rcond=None)
        d4, d7, d10, d15 = (float(x) for x in solution / scale)
        slope = np.maximum(start.D1 + 2.0 * d7 * eps + d10 * r2, 0.1 * start.D1)
    return replace(start, D4=d4, D7=d7, D10=d10, D15=d15)
