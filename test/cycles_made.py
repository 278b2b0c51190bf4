"""Limit cycles of the full model at exactly one speed: a truth for tests and benchmarks."""

from __future__ import annotations

import numpy as np

from hunt_ros.dynamics.limit_cycle import Branch, _branch_of, _correct


def at_speed(branch: Branch, speed: float) -> Branch:
    """
    Return the limit cycles at exactly one speed, m/s, the smallest amplitude first.

    Guessed between neighbours on the branch, corrected by Newton's iteration. Next to a fold,
    within a step of the branch, none may be found.
    """
    system, x, v = branch.system, branch.unknowns, branch.speed - speed
    along_speed = np.zeros(x.shape[1])
    along_speed[-1] = 1.0
    found = []
    for k in np.flatnonzero(np.diff(v >= 0.0)):
        guess = x[k] + v[k] / (v[k] - v[k + 1]) * (x[k + 1] - x[k])
        guess[-1] = 4.0 * (speed / system.hopf - 1.0)
        if (corrected := _correct(system, guess, along_speed)) is not None:
            found.append(corrected[0])
    cycles = sorted(found, key=lambda one: abs(system.to_fundamental @ one[: system.points]))
    return _branch_of(system, np.array(cycles).reshape(-1, x.shape[1]))


def exponent(cycles: Branch) -> np.ndarray:
    """Rate at which the slowest disturbance of the amplitude grows, 1/s, shape (n,)."""
    return np.log(np.abs(cycles.multipliers[:, 1:]).max(axis=1)) * cycles.frequency_hz
