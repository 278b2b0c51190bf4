from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hunt_ros.analysis.lyapunov import largest_lyapunov_exponent
from hunt_ros.analysis.surrogates import is_nonlinear, phase_randomised
from hunt_ros.errors import IdentificationError

#: Sprott 2003, Chaos and Time-Series Analysis, Oxford University Press, appendix A.
LORENZ, HENON = 0.9056, 0.41922


def henon(count: int, seed: int) -> np.ndarray:
    x, y = np.random.default_rng(seed).uniform(-0.1, 0.1, 2)
    values = []
    for _ in range(count + 100):
        x, y = 1.0 - 1.4 * x * x + y, 0.3 * x
        values.append(x)
    return np.array(values[100:])


@pytest.fixture(scope='module')
def lorenz() -> np.ndarray:
    def flow(_: float, u: np.ndarray) -> list[float]:
        return [10 * (u[1] - u[0]), u[0] * (28 - u[2]) - u[1], u[0] * u[1] - 8 / 3 * u[2]]

    times = 20.0 + np.arange(12_000) * 0.02
    found = solve_ivp(flow, (0.0, times[-1]), [1.0, 1.0, 20.0], t_eval=times, rtol=1e-8)
    return found.y[0]


@pytest.mark.parametrize('seed', range(4))
def test_henon(seed):
    found = largest_lyapunov_exponent(henon(4000, seed), 1.0, embedding=2, delay=1)
    assert found.exponent.value == pytest.approx(HENON, rel=0.06)
    assert abs(found.exponent.value - HENON) < 4.0 * found.exponent.std
    assert found.chaotic


@pytest.mark.parametrize('noise', [0.0, 0.01])
def test_lorenz(lorenz, noise):
    signal = lorenz + np.random.default_rng(0).normal(0.0, noise * np.std(lorenz), lorenz.size)
    found = largest_lyapunov_exponent(signal, 50.0)
    assert found.exponent.value == pytest.approx(LORENZ, rel=0.1)
    assert abs(found.exponent.value - LORENZ) < 3.0 * found.exponent.std
    assert found.exponent.std < 0.1 * LORENZ
    assert found.chaotic


def test_the_unit_of_time_is_the_second():
    values = henon(3000, 0)
    slow = largest_lyapunov_exponent(values, 1.0, embedding=2, delay=1)
    fast = largest_lyapunov_exponent(values, 10.0, embedding=2, delay=1)
    assert fast.exponent.value == pytest.approx(10.0 * slow.exponent.value)


@pytest.mark.parametrize('noise', [0.0, 0.01, 0.1])
def test_hunting_over_roughness_is_not_chaotic(noise):
    time = np.arange(20_000) / 100.0
    signal = np.sin(2 * np.pi * 2.835 * time) + 0.2 * np.sin(2 * np.pi * 6.8123 * time)
    signal += np.random.default_rng(1).normal(0.0, noise, time.size)
    found = largest_lyapunov_exponent(signal, 100.0)
    assert abs(found.exponent.value) < 0.05
    assert not found.chaotic


def test_a_limit_cycle_with_a_wandering_phase_is_not_chaotic():
    # Noise parts neighbours by diffusion, which is not exponential.
    generator = np.random.default_rng(2)
    phase = np.cumsum(2 * np.pi * 2.8 / 50.0 + generator.normal(0.0, 0.02, 8000))
    found = largest_lyapunov_exponent(np.sin(phase), 50.0)
    assert not found.chaotic


def test_a_linear_response_to_noise_is_not_taken_for_more():
    generator = np.random.default_rng(3)
    root = 0.99 * np.exp(2j * math.pi * 0.056)
    state, values = 0.0 + 0.0j, []
    for drive in generator.normal(size=6000):
        state = root * state + drive
        values.append(state.real)
    found = largest_lyapunov_exponent(np.array(values), 50.0)
    assert not found.nonlinear
    assert not found.chaotic


def test_a_surrogate_keeps_the_spectrum_and_nothing_else():
    values = henon(2048, 5)
    surrogate = phase_randomised(values, np.random.default_rng(0))
    assert np.abs(np.fft.rfft(surrogate)) == pytest.approx(np.abs(np.fft.rfft(values)), abs=1e-6)
    assert abs(np.corrcoef(values, surrogate)[0, 1]) < 0.2
    assert is_nonlinear(values, 2, 1, 1)
    assert not is_nonlinear(surrogate, 2, 1, 1)


@pytest.mark.parametrize('values', [np.ones(1000), np.arange(50.0), np.full(1000, np.nan)])
def test_what_has_no_exponent_is_refused(values):
    with pytest.raises(IdentificationError):
        largest_lyapunov_exponent(values, 1.0)
