"""What the form says about a row: properties, and the exact theory beside the closed formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.detection import prediction
from hunt_ros.detection.basin import FormNumbers, edge_noise, form_numbers
from hunt_ros.detection.output import ESTIMATE_DTYPE
from hunt_ros.dynamics.disturbance import committor, diffusion_from_quiet, threshold_on_line
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM

FORM = PAPER_NORMAL_FORM
COVARIANCE = np.diag([0.05, 0.005, 3.0, 0.005, 60.0, 1e4]) ** 2
EXACT = form_numbers(IdentifiedNormalForm(FORM))
UNSURE = form_numbers(IdentifiedNormalForm(FORM, COVARIANCE))


def _row(
    numbers: FormNumbers,
    speed: float,
    amplitude: float,
    std: float,
    edge: tuple[float, float, float] = (1.0, 0.0, 0.0),
    noise_spread: float = 0.0,
    roughness: float = 0.0,
) -> np.void:
    rows = np.zeros(1, dtype=ESTIMATE_DTYPE)
    noise = np.zeros(1, dtype=prediction.EDGE)
    noise[0] = edge
    prediction.clear(rows[0])
    damping = prediction.branches(numbers, speed, roughness, rows[0])
    prediction.judge(
        numbers, noise[0], noise_spread, speed, amplitude, std, damping, 60.0, rows[0]
    )
    return rows[0]


speeds = st.floats(5.0, 9.0)
edges = st.tuples(st.floats(0.9, 1.0), st.floats(0.0, 0.3), st.floats(0.0, 1.0))


@settings(deadline=None)
@given(st.sampled_from([EXACT, UNSURE]), speeds, st.floats(0.0, 1e-4), edges, st.floats(0.0, 0.8))
def test_the_chance_of_escape_lies_between_0_and_1_and_grows_with_amplitude(
    numbers, speed, std, edge, noise_spread
) -> None:
    rows = [
        _row(numbers, speed, amplitude, std, edge, noise_spread)
        for amplitude in np.linspace(0.0, 1e-3, 25)
    ]
    for name in ('escape_probability', 'outlook'):
        values = np.array([float(row[name]) for row in rows])
        assert np.all((values >= 0.0) & (values <= 1.0))
        assert np.all(np.diff(values) >= -1e-12)
    assert all(float(row['outlook']) >= float(row['escape_probability']) - 1e-12 for row in rows)


@settings(deadline=None)
@given(
    st.sampled_from([EXACT, UNSURE]),
    st.floats(6.5, 7.9),
    st.floats(1e-6, 1e-3),
    st.floats(0.0, 1e-4),
)
def test_the_interval_of_the_margin_holds_the_margin(numbers, speed, amplitude, std) -> None:
    row = _row(numbers, speed, amplitude, std)
    assert row['margin_low'] <= row['margin'] <= row['margin_high']
    assert row['margin'] == pytest.approx(float(FORM.unstable_amplitude(speed)) / amplitude)


@settings(deadline=None)
@given(speeds)
def test_the_branches_are_those_of_the_form(speed) -> None:
    row = _row(EXACT, speed, 1e-4, 0.0)
    expected = [float(x) for x in FORM.steady_amplitudes(speed)]
    found = [float(row['unstable_amplitude']), float(row['stable_amplitude'])]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize('line', [10e-6, 30e-6, 60e-6])
def test_roughness_lowers_the_edge_as_the_line_does(line: float) -> None:
    row = _row(EXACT, 7.4, 1e-4, 0.0, roughness=line)
    assert float(row['unstable_amplitude']) == pytest.approx(
        threshold_on_line(FORM, 7.4, line), rel=0.02
    )


@pytest.mark.parametrize('ratio', [0.05, 0.1, 0.2])
@pytest.mark.parametrize('spread', [0.0, 0.3, 0.6])
def test_the_chance_is_the_committor_averaged_over_what_is_uncertain(ratio, spread) -> None:
    speed, unstable = 7.2, float(FORM.unstable_amplitude(7.2))
    diffusion = diffusion_from_quiet(FORM, speed, ratio * unstable)
    std = 0.03 * unstable
    edge = tuple(edge_noise(FORM, speed, diffusion))
    rng = np.random.default_rng(1)
    levels = diffusion * np.exp(spread * rng.standard_normal(60))
    for amplitude in np.linspace(0.7, 1.3, 7) * unstable:
        about = np.abs(amplitude + std * rng.standard_normal(400))
        exact = np.mean([committor(FORM, speed, about, level) for level in levels])
        row = _row(EXACT, speed, float(amplitude), std, edge, spread)
        assert float(row['escape_probability']) == pytest.approx(exact, abs=0.05)


@settings(deadline=None)
@given(st.floats(6.6, 8.6), st.floats(0.05, 0.85))
def test_the_time_to_the_cycle_is_that_of_the_dynamics(speed, share) -> None:
    unstable, stable = (float(x) for x in FORM.steady_amplitudes(speed))
    low = 1.03 * unstable if math.isfinite(unstable) else 1e-5
    amplitude = low + share * (0.9 * stable - low)
    rows = np.zeros(1, dtype=ESTIMATE_DTYPE)
    prediction.clear(rows[0])
    prediction.branches(EXACT, speed, 0.0, rows[0])
    found = prediction.time_to_cycle(EXACT, speed, amplitude, rows[0])
    assert found == pytest.approx(FORM.time_between(speed, amplitude, 0.9 * stable), rel=0.01)


def test_without_a_limit_cycle_there_is_no_time_to_it_and_on_it_none_is_left() -> None:
    rows = np.zeros(1, dtype=ESTIMATE_DTYPE)
    prediction.clear(rows[0])
    prediction.branches(EXACT, 5.0, 0.0, rows[0])
    assert math.isnan(prediction.time_to_cycle(EXACT, 5.0, 1e-4, rows[0]))
    prediction.branches(EXACT, 7.2, 0.0, rows[0])
    stable = float(rows[0]['stable_amplitude'])
    assert prediction.time_to_cycle(EXACT, 7.2, 0.95 * stable, rows[0]) == 0.0


@pytest.mark.parametrize('speed', [7.6, FORM.critical_speed, 8.2])
def test_the_chance_to_stay_up_is_that_of_simulated_paths(speed: float) -> None:
    diffusion, low, high = 3e-10, 60e-6, 300e-6
    rng = np.random.default_rng(3)
    step = 2e-3
    for start in (90e-6, 130e-6):
        z = np.full(2000, start, dtype=np.complex128)
        risen, left = 0, z.size
        while left > 20:
            shock = rng.standard_normal((z.size, 2)) @ np.array([1.0, 1j])
            rate = np.asarray(FORM.growth_rate(speed, np.abs(z)))
            z = z * (1.0 + rate * step) + math.sqrt(2.0 * diffusion * step) * shock
            size = np.abs(z)
            risen += int((size >= high).sum())
            z = z[(size < high) & (size > low)]
            left = z.size
        chance = prediction.stays_up(EXACT, speed, start, low, high, diffusion)
        assert chance == pytest.approx(risen / (2000 - left), abs=0.05)


@settings(deadline=None)
@given(speeds, st.floats(1e-13, 1e-8), st.floats(1e-6, 1e-4))
def test_the_chance_to_stay_up_grows_from_0_to_1(speed, diffusion, low) -> None:
    amplitudes = np.linspace(low, 5e-4, 30)
    chances = [prediction.stays_up(EXACT, speed, a, low, 5e-4, diffusion) for a in amplitudes]
    assert chances[0] == 0.0
    assert chances[-1] == 1.0
    assert np.all(np.diff(chances) >= -1e-9)


def test_a_limit_cycle_wanders_as_its_linear_law_says() -> None:
    speed, diffusion = 8.2, 2e-10
    stable = float(FORM.stable_amplitude(speed))
    rng = np.random.default_rng(4)
    step = 2e-3
    z = np.full(400, stable, dtype=np.complex128)
    for _ in range(4000):
        shock = rng.standard_normal((z.size, 2)) @ np.array([1.0, 1j])
        z *= 1.0 + np.asarray(FORM.growth_rate(speed, np.abs(z))) * step
        z += math.sqrt(2.0 * diffusion * step) * shock
    expected = prediction.wander(EXACT, speed, stable, diffusion)
    assert np.abs(z).std() == pytest.approx(expected, rel=0.15)
    edge = float(FORM.unstable_amplitude(7.4))
    assert prediction.wander(EXACT, 7.4, edge, diffusion) == math.inf
