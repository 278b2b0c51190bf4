from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.analysis.steady_state import (
    SteadyState,
    hunting_threshold,
    mean_of_maxima,
    observed_critical_speeds,
    standard_error,
)


def state(speed, amplitude, direction, start=0, source='run'):
    return SteadyState(
        speed, amplitude, 1e-6, direction, 70, source=source, start_ns=start, end_ns=start + 9
    )


def staircase():
    up = [(6.0, 1e-5), (7.0, 1e-5), (7.8, 2e-5), (8.0, 6.7e-4), (8.8, 7e-4)]
    down = [(8.0, 6.7e-4), (7.0, 6.1e-4), (6.4, 4.9e-4), (6.2, 1e-5)]
    states = [state(v, a, 'up', 10 * k) for k, (v, a) in enumerate(up)]
    return states + [state(v, a, 'down', 100 + 10 * k) for k, (v, a) in enumerate(down)]


def test_maxima_of_a_sine_are_its_amplitude_and_those_with_roughness_are_more():
    time = np.arange(0, 30, 0.002)
    sine = 4e-4 * np.cos(2 * np.pi * 2.8 * time) + 1e-3
    mean, std, count = mean_of_maxima(sine, 500.0, 2.8)
    assert mean == pytest.approx(4e-4, rel=3e-3)
    assert std < 1e-6
    assert count == pytest.approx(84, abs=2)
    rough = sine + 5e-5 * np.cos(2 * np.pi * 7.6 * time)
    assert mean_of_maxima(rough, 500.0, 2.8)[0] > 4.1e-4


def test_maxima_of_less_than_two_cycles_are_not_known():
    assert np.isnan(mean_of_maxima(np.zeros(100), 500.0, 2.8)[0])


def test_the_error_of_a_correlated_mean_is_that_of_its_fewer_independent_values():
    rng = np.random.default_rng(0)
    keep = 0.9
    means, claimed = [], []
    for _ in range(200):
        x = np.empty(400)
        x[0] = rng.standard_normal() / np.sqrt(1 - keep**2)
        for k in range(1, 400):
            x[k] = keep * x[k - 1] + rng.standard_normal()
        means.append(x.mean())
        claimed.append(standard_error(x))
    assert np.mean(claimed) == pytest.approx(np.std(means), rel=0.2)


def test_jumps_give_the_critical_speeds_and_the_step():
    seen = observed_critical_speeds(staircase())
    assert seen.v_c == pytest.approx(7.9)
    assert seen.v_n == pytest.approx(6.3)
    assert seen.hysteresis_width == pytest.approx(1.6)
    assert seen.step == pytest.approx(0.2)


def test_a_jump_after_a_kick_is_not_an_observation():
    states = staircase()
    seen = observed_critical_speeds(states, [('run', states[2].end_ns)])
    assert seen.v_c is None
    assert seen.v_n == pytest.approx(6.3)


def test_without_hunting_nothing_is_observed():
    quiet = [state(v, 1e-5, 'up') for v in np.arange(6, 7, 0.1)]
    seen = observed_critical_speeds(quiet)
    assert (seen.v_c, seen.v_n, seen.step, seen.hysteresis_width) == (None,) * 4
    assert seen.v_c_between == seen.v_n_between == (None, None)


def test_noise_that_swells_with_the_speed_is_no_jump():
    def seen(seed):
        means = np.random.default_rng(seed).rayleigh(1.0, (26, 2)).mean(axis=1)
        sizes = np.linspace(2e-5, 4e-5, 26) * means
        speeds = np.linspace(12.0, 20.0, 26)
        states = [state(v, a, 'up') for v, a in zip(speeds, sizes, strict=True)]
        return observed_critical_speeds(states).v_c

    assert sum(seen(seed) is not None for seed in range(200)) <= 16


def test_two_runs_are_not_joined_by_a_jump():
    states = [state(7.0, 1e-5, 'up', source='a'), state(8.0, 7e-4, 'up', source='b')]
    assert observed_critical_speeds(states).v_c is None


def test_few_hunting_amplitudes_among_many_quiet_ones_are_told_apart():
    rng = np.random.default_rng(1)
    amplitudes = np.concatenate([1e-5 * rng.rayleigh(1.0, 300), [6e-4, 6.2e-4, 6.1e-4]])
    threshold = hunting_threshold(amplitudes)
    assert threshold is not None
    assert 5e-5 < threshold < 6e-4
    assert hunting_threshold(np.linspace(5e-4, 7e-4, 40)) is None
