from __future__ import annotations

import numpy as np
import pytest
from made import forced_mode

from hunt_ros.dynamics.growth_law import SATURATION, TERMS, lawful
from hunt_ros.identification.likelihood.damping_bias import damping_correction
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


def test_a_saturation_that_is_held_takes_the_other_coefficients_along():
    rng = np.random.default_rng(2)
    z = forced(rng, 200.0)
    path = Path(STEP * np.arange(z.size), np.zeros(z.size), z, np.arange(z.size) == 0)
    derivative = rng.standard_normal((TERMS + 5, z.size, 2))
    # Correlated so that less damping goes with less saturation.
    derivative[SATURATION] += 0.9 * derivative[0]
    information = np.einsum('inc,jnc->ij', derivative, derivative)
    noise = [0, 0, 2 * np.log(FORCING), -18.0, -18.0]
    far, held = (np.array([*lawful([-DAMPING, *np.zeros(5)]), *noise]) for _ in range(2))
    far[SATURATION] = 10.0
    free, bound = (damping_correction(one, path, derivative, information) for one in (far, held))
    assert free[SATURATION] < 0.0
    assert bound[SATURATION] == pytest.approx(0.0, abs=1e-12)
    # The others are those that are likeliest beside it.
    inverse = np.linalg.inv(information[:TERMS, :TERMS])
    follow = inverse[SATURATION] / inverse[SATURATION, SATURATION]
    assert bound - free == pytest.approx(-free[SATURATION] * follow, rel=1e-6, abs=1e-12)
