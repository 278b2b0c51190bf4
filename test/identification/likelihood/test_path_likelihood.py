from __future__ import annotations

from dataclasses import replace

import made
import numpy as np
import pytest
from made import SCALES

from hunt_ros.dynamics.growth_law import FELT, GrowthLaw, lawful
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.identification.fit import law_prior
from hunt_ros.identification.likelihood.path import Path
from hunt_ros.identification.likelihood.path_likelihood import innovations
from hunt_ros.identification.likelihood.trajectory_fit import Problem, usual_spread

LAW = made.LAW.p
QUIET = np.array([0.0, 0.0, -30.0, -12.0, -20.0])


def steady_path(phasor: np.ndarray, step: float, u: float = 0.0, **more) -> Path:
    """Path at one speed, without a restart."""
    n = phasor.size
    return Path(np.arange(n) * step, np.full(n, u), phasor, np.arange(n) == 0, **more)


def path_of(speed: float, start: float, step: float = 0.5, count: int = 60) -> Path:
    """Exact path of Eq. (24) by fine steps."""
    amplitude, fine, values = start, 400, []
    for _ in range(count):
        values.append(amplitude)
        for _ in range(fine):
            rate = float(PAPER_NORMAL_FORM.growth_rate(speed, amplitude))
            half = amplitude * np.exp(0.5 * step / fine * rate)
            rate = float(PAPER_NORMAL_FORM.growth_rate(speed, half))
            amplitude *= np.exp(step / fine * rate)
    phasor = np.array(values) / SCALES.amplitude * np.exp(0.7j)
    return steady_path(phasor, step, speed / SCALES.speed - 1.0)


@pytest.mark.parametrize(('speed', 'start'), [(7.2, 2e-4), (7.2, 3e-4), (8.6, 8e-4), (6.2, 5e-4)])
def test_without_forcing_an_exact_path_leaves_no_innovation(speed, start):
    out = innovations(np.concatenate([LAW, QUIET]), path_of(speed, start))
    assert np.abs(out[:, :2]).max() < 0.05  # standard deviations of a noise of 1.7 um


@pytest.mark.parametrize('length', [1, 4, 20])
def test_no_law_is_integrated_over_a_gap(length):
    path = path_of(7.2, 3e-4)
    path.phasor[20 : 20 + length] = np.nan
    path.phasor[20 + length :] *= 1.2  # whatever happened meanwhile
    out = innovations(np.concatenate([LAW, QUIET]), path)
    # Nothing is known of the gap, and the amplitude behind it is free.
    assert (out[20 : 21 + length] == 0.0).all()
    assert (np.delete(out, [0, *range(20, 21 + length)], axis=0)[:, 2] != 0.0).all()
    assert np.abs(out[1:20, :2]).max() < 0.05


def test_a_restart_frees_the_amplitude():
    path = path_of(7.2, 3e-4)
    path.phasor[30:] *= 1.5
    broken = innovations(np.concatenate([LAW, QUIET]), path)
    assert np.abs(broken[30, 0]) > 10.0
    again = path.restart.copy()
    again[30] = True
    freed = innovations(np.concatenate([LAW, QUIET]), replace(path, restart=again))
    assert (freed[30] == 0.0).all()


def test_innovations_are_white_and_of_unit_variance_under_the_true_law():
    rng = np.random.default_rng(3)
    n, step, noise, forcing, damping = 20_000, 0.5, 2e-3, 5e-3, 0.4
    z = made.forced_mode(rng, n, step, damping, forcing / np.sqrt(2.0 * damping))
    seen = z + noise * (rng.standard_normal((n, 2)) @ np.array([1.0, 1.0j]))
    path = steady_path(seen, step)
    logs = [2 * np.log(forcing), 2 * np.log(noise), -40.0]
    theta = np.array([*lawful([-damping, 0, 0, 0, 0, 0]), 0, 0, *logs])
    out = innovations(theta, path)[10:, :2]
    assert out.std(axis=0) == pytest.approx([1.0, 1.0], abs=0.02)
    assert abs(np.mean(out[1:, 0] * out[:-1, 0])) < 0.02


def test_noise_shared_by_overlapping_windows_is_told_from_motion():
    rng = np.random.default_rng(4)
    n, step, noise, shared = 20_000, 0.5, 2e-3, 0.1
    white = rng.standard_normal((n + 1, 2)) @ np.array([1.0, 1.0j])
    size = noise / np.sqrt(1.0 + shared**2)
    seen = 0.1 + size * (white[1:] + shared * white[:-1])
    path = steady_path(seen, step, overlap=shared / (1.0 + shared**2))
    theta = np.array([*lawful(np.zeros(6)), 0, 0, -32.0, 2 * np.log(noise), -32.0])
    out = innovations(theta, path)[10:, :2]
    assert out.std(axis=0) == pytest.approx([1.0, 1.0], abs=0.02)
    assert abs(np.mean(out[1:, 0] * out[:-1, 0])) < 0.02
    apart = innovations(theta, replace(path, overlap=0.0))[10:, :2]
    assert np.mean(apart[1:, 0] * apart[:-1, 0]) > 0.07


@pytest.mark.parametrize('more', [(), (0.3, 0.4, 0.2)], ids=['paper', 'further terms'])
@pytest.mark.parametrize('felt', [1.0, 0.6])
def test_a_line_beside_hunting_acts_in_the_likelihood_as_in_the_law(more, felt):
    p = LAW.copy()
    p[6 : 6 + len(more)] = more
    p[FELT] = felt
    law = GrowthLaw(p, SCALES)
    line, step, speed = 4e-9, 0.02, 7.2
    start, n = 3e-4, 40
    amplitude = np.empty(n)
    amplitude[0] = start
    for k in range(1, n):
        rate = float(law.growth_rate(speed, amplitude[k - 1], line))
        half = amplitude[k - 1] * np.exp(0.5 * step * rate)
        amplitude[k] = amplitude[k - 1] * np.exp(step * float(law.growth_rate(speed, half, line)))
    beside = np.full(n, line / SCALES.amplitude**2)
    phasor = amplitude / SCALES.amplitude + 0j
    path = steady_path(phasor, step, speed / SCALES.speed - 1.0, line=beside)
    out = innovations(np.concatenate([p, QUIET]), path)
    assert np.abs(out[:, 0]).max() < 0.02
    without = innovations(np.concatenate([p, QUIET]), replace(path, line=None))
    assert np.abs(without[:, 0]).max() > 0.05


def test_of_what_walks_side_by_side_small_differences_are_right():
    rng = np.random.default_rng(0)
    n = 120
    restart = np.zeros(n, dtype=bool)
    restart[[0, 70]] = True
    size = 0.3 + 0.5 * rng.random(n)
    phasor = size * np.exp(1j * np.cumsum(0.1 * rng.standard_normal(n)))
    phasor[40:50] = np.nan
    path = Path(
        np.arange(n) * 0.5,
        0.1 * np.sin(np.arange(n) / 15.0),
        phasor,
        restart,
        blur=0.03,
        reach=0.2,
        overlap=0.09,
        turn=9.4,
        line=0.01 * (1.0 + np.cos(np.arange(n) / 9.0)),
    )
    law = LAW.copy()
    law[6:] = 0.3, 0.4, 0.2, 0.8
    theta = np.concatenate([law, [0.3, -0.2, -4.0, -7.0, -5.0]])
    small, large = (k * np.maximum(np.abs(theta), 0.1) for k in (1e-8, 1e-5))
    rows = [
        innovations(theta + np.vstack([0.0 * x, np.diag(x)]), path) for x in (small, large, -large)
    ]
    np.testing.assert_array_equal(rows[0][0], innovations(theta, path))
    by = (rows[0][1:] - rows[0][0]) / small[:, None, None]
    slope = (rows[1][1:] - rows[2][1:]) / (2.0 * large[:, None, None])
    np.testing.assert_allclose(by, slope, rtol=1e-4, atol=1e-5)


def two_recordings() -> Problem:
    """The likelihood of two recordings, the second one with a gain of its own."""
    paths = [path_of(7.2, start, count=40).phasor for start in (3e-4, 2.2e-4)]
    rng = np.random.default_rng(1)
    noise = 3e-3 * rng.standard_normal((80, 2)) @ np.array([1.0, 1.0j])
    time, recording = 0.5 * np.tile(np.arange(40), 2), np.repeat([0, 1], 40)
    seen = np.concatenate([paths[0], 1.02 * paths[1]]) + noise
    path = Path(time, np.full(80, -0.1), seen, time == 0.0, recording=recording)
    return Problem(path, *law_prior(SCALES, False), [], usual_spread(path))


def test_the_expansion_is_that_of_the_likelihood():
    problem = two_recordings()
    theta = np.concatenate([LAW, [0.3, -0.2, -8.0, -11.0, -9.0]])
    own = np.array([[0.01, 0.002, -0.003, 0.2, 0.1], [-0.01, 0.0, 0.004, -0.1, -0.3]])
    at = problem.expand(theta, own)
    slope = np.zeros(theta.size)
    for j in np.flatnonzero(problem.widths):
        step = 1e-5 * problem.widths[j] * np.eye(theta.size)[j]
        away = problem.objective(theta - step, own) - problem.objective(theta + step, own)
        slope[j] = away / (2.0 * step[j])
    np.testing.assert_allclose(at.gradient, slope, rtol=1e-3, atol=1e-2)
    for place in np.ndindex(own.shape):
        step = np.zeros(own.shape)
        step[place] = 1e-6
        away = problem.objective(theta, own - step) - problem.objective(theta, own + step)
        assert at.own_slope[place] == pytest.approx(away / 2e-6, rel=1e-3, abs=1e-2)
