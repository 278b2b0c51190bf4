from __future__ import annotations

import numpy as np
import pytest
from made import forced_mode

from hunt_ros.dynamics.growth_law import lawful
from hunt_ros.identification.likelihood.path import Path
from hunt_ros.identification.likelihood.trajectory_fit import LawPrior, fit_path

STEP, HOLD_S, DAMPING, FORCING = 0.5, 25.0, 0.35, 3e-3
#: A growth rate that may change with u, and nothing else of the law.
PRIOR = LawPrior(lawful(np.zeros(6)), np.array([20.0, 20.0, *np.zeros(8)]))


def forced(rng: np.random.Generator, seconds: float) -> np.ndarray:
    """Forced motion of a damped mode."""
    std = FORCING / np.sqrt(2.0 * DAMPING)
    return forced_mode(rng, round(seconds / STEP), STEP, DAMPING, std)


def found(seed: int, seconds: float) -> tuple[float, float]:
    """Damping of one hold as it comes and corrected; another, long one shows the noise."""
    rng = np.random.default_rng(seed)
    z = [forced(rng, seconds), forced(rng, 500.0)]
    u = np.concatenate([np.full(part.size, 0.3 * k) for k, part in enumerate(z)])
    time = np.concatenate([np.arange(part.size) * STEP for part in z])
    path = Path(time, u, np.concatenate(z), time == 0.0)
    start = np.array([*lawful([-0.3, *np.zeros(5)]), 0, 0, 2 * np.log(FORCING), -18.0, -18.0])
    fit = fit_path(path, start, PRIOR)
    return -float(fit.theta[0]), -float(fit.law[0])


def test_the_damping_of_a_short_hold_is_freed_from_its_bias():
    raw, corrected = np.mean([found(seed, HOLD_S) for seed in range(40)], axis=0)
    # One hold of T seconds shows 1 / T too much; the mean of 40 is known to half of it.
    assert raw - DAMPING > 0.5 / HOLD_S
    assert abs(corrected - DAMPING) < 0.5 / HOLD_S


def test_much_data_leaves_nothing_to_correct():
    raw, corrected = found(1, 4000.0)
    assert raw - corrected == pytest.approx(1.0 / 4000.0, rel=0.3)
