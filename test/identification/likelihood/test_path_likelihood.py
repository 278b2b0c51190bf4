from __future__ import annotations

from dataclasses import replace

import made
import numpy as np
import pytest
from made import SCALES

from hunt_ros.dynamics.growth_law import FELT, GrowthLaw, lawful
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.identification.likelihood.path import Path
from hunt_ros.identification.likelihood.path_likelihood import innovations, sensitivities

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


def test_the_derivatives_are_those_of_the_innovations():
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
    out, by = sensitivities(theta, path, np.ones(theta.size, dtype=bool))
    np.testing.assert_allclose(out, innovations(theta, path), rtol=1e-12)
    for j in range(theta.size):
        step = np.zeros(theta.size)
        step[j] = 1e-5 * max(abs(theta[j]), 0.1)
        slope = (innovations(theta + step, path) - innovations(theta - step, path)) / 2.0
        # Where a step of the integration more is taken the difference is off by its error.
        np.testing.assert_allclose(by[j], slope / step[j], rtol=1e-4, atol=1e-5)
    some, few = sensitivities(theta, path, np.arange(theta.size) == 5)
    np.testing.assert_array_equal(some, out)
    np.testing.assert_array_equal(few[5], by[5])
    assert not few[np.arange(theta.size) != 5].any()
