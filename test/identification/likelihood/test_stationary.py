"""The mean amplitude under random forcing, against the forced motion itself."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hunt_ros.dynamics.growth_law import GrowthLaw, GrowthScales, lawful
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM, NormalForm
from hunt_ros.dynamics.paper_form import from_normal_form
from hunt_ros.identification.likelihood.stationary import stationary_amplitude

SOFT = NormalForm(8.0, 0.12, -450.0, -0.06, 0.0, -3.4e6)
SCALES = GrowthScales(8.0, 6e-4, 0.0485, 1.0 / 25.91, 2.84)


def law_of(form):
    return GrowthLaw(lawful(from_normal_form(form, SCALES)), SCALES)


def noise_of(strength, by_speed=0.0, by_power=0.0):
    """Forcing of `strength`, m / sqrt(s), at v_ref."""
    return np.array([by_speed, by_power, 2.0 * math.log(strength / SCALES.amplitude), -9.0, -9.0])


def mean_of(law, noise, speed):
    return float(stationary_amplitude(law, noise, np.array([speed]), np.zeros(1))[0][0])


def simulated(law, noise, speed, start, seed=0, count=400, seconds=120.0, dt=0.02):
    """Mean amplitude of many forced motions, after the first half."""
    rng = np.random.default_rng(seed)
    u = float(law.detuning(speed))
    z = np.full(count, start, dtype=complex)
    total, steps = 0.0, int(seconds / dt)
    for k in range(steps):
        a = np.abs(z)
        w = (a / SCALES.amplitude) ** 2
        push = SCALES.amplitude * np.exp(0.5 * (noise[2] + noise[0] * u + noise[1] * w))
        kick = rng.standard_normal((2, count)) * push * math.sqrt(dt)
        half = a * np.exp(0.5 * dt * law.growth_rate(speed, a))
        z = z * np.exp(dt * law.growth_rate(speed, half)) + kick[0] + 1j * kick[1]
        if 2 * k >= steps:
            total += float(np.abs(z).mean())
    return total / (steps - steps // 2)


@pytest.mark.parametrize('speed', [7.8, 8.0, 8.15, 8.6])
def test_a_soft_onset_is_blurred_as_the_forced_motion_is(speed):
    law, noise = law_of(SOFT), noise_of(2e-5)
    expected = simulated(law, noise, speed, 1e-4)
    assert mean_of(law, noise, speed) == pytest.approx(expected, rel=0.02)


def test_forcing_that_changes_with_speed_and_amplitude_is_followed():
    law, noise = law_of(SOFT), noise_of(2e-5, by_speed=6.0, by_power=-0.8)
    expected = simulated(law, noise, 8.3, 2e-4)
    assert mean_of(law, noise, 8.3) == pytest.approx(expected, rel=0.02)


def test_the_limit_cycle_of_a_subcritical_rig_stays_in_its_basin():
    law, noise = law_of(PAPER_NORMAL_FORM), noise_of(1e-5)
    _, stable = law.steady_amplitudes(np.array([7.2]))
    assert mean_of(law, noise, 7.2) == pytest.approx(float(stable[0]), rel=2e-3)
    expected = simulated(law, noise, 7.2, float(stable[0]))
    assert mean_of(law, noise, 7.2) == pytest.approx(expected, rel=1e-3)


def test_the_quiet_state_has_the_mean_of_rayleigh():
    law, noise = law_of(PAPER_NORMAL_FORM), noise_of(2e-6)
    speed = 6.0
    damping = -float(law.linear(law.detuning(speed)))
    expected = 2e-6 / math.sqrt(2.0 * damping) * math.sqrt(0.5 * math.pi)
    assert mean_of(law, noise, speed) == pytest.approx(expected, rel=3e-3)
    _, std = stationary_amplitude(law, noise, np.array([speed]), np.zeros(1))
    assert float(std[0]) == pytest.approx(expected * math.sqrt(4.0 / math.pi - 1.0), rel=3e-3)


@pytest.mark.parametrize('form', [SOFT, PAPER_NORMAL_FORM])
def test_without_noise_to_speak_of_it_is_the_branch(form):
    law = law_of(form)
    speeds = np.linspace(8.1, 9.0, 10)
    _, stable = law.steady_amplitudes(speeds)
    mean, std = stationary_amplitude(law, noise_of(1e-8), speeds, np.zeros(10))
    assert (std < 1e-3 * mean).all()
    np.testing.assert_allclose(mean, stable, rtol=1e-6)


def test_a_law_that_bounds_nothing_has_no_mean():
    runaway = law_of(NormalForm(8.0, 0.12, 2000.0, 0.0, 0.0, 0.0))
    assert math.isnan(mean_of(runaway, noise_of(1e-5), 8.5))
