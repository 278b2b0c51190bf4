"""Committor and escape time against direct quadrature, the amplitude equation, and the model."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid

from hunt_ros.compiled import HAVE_COMPILER, compiled
from hunt_ros.dynamics.center_manifold import normal_form_of
from hunt_ros.dynamics.limit_cycle import Branch, limit_cycles
from hunt_ros.dynamics.noise.amplitude_noise import (
    amplitude_diffusion,
    local_form,
    quiet_diffusion,
)
from hunt_ros.dynamics.noise.escape import (
    AmplitudeDiffusion,
    committor,
    diffusion_from_quiet,
    mean_escape_time,
)
from hunt_ros.dynamics.noise.forced_response import quiet_covariance
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM, NormalForm
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import RollerRig, SimulationSettings
from hunt_ros.errors import ConfigError

FORM = PAPER_NORMAL_FORM

needs_compiler = pytest.mark.skipif(
    not HAVE_COMPILER, reason='hours of simulated time: needs the compiled kernel'
)


@pytest.fixture(scope='module')
def branch() -> Branch:
    return limit_cycles(paper_rig())


@pytest.mark.parametrize(('speed', 'slope'), [(7.2, 0.0), (7.2, -7e6), (7.6, -5e6)])
def test_committor_and_time_are_the_double_integrals(speed: float, slope: float) -> None:
    """On a dense even grid, without logarithms, where nothing is extreme."""
    law = AmplitudeDiffusion(1.2e-9, slope)
    unstable, stable = (float(x) for x in FORM.steady_amplitudes(speed))
    x = np.linspace(1e-9, 0.5 * (unstable + stable), 400_001)
    drift = x * FORM.growth_rate(speed, x) / law(x)
    potential = -cumulative_trapezoid(drift, x, initial=0.0)
    scale = np.exp(potential) / x
    weight = cumulative_trapezoid(x * np.exp(-potential) / law(x), x, initial=0.0)
    floor = math.sqrt(law.quiet / -float(FORM.growth_rate(speed)))
    reached = cumulative_trapezoid(np.where(x > floor, scale, 0.0), x, initial=0.0)
    passed = cumulative_trapezoid(scale * weight, x, initial=0.0)
    for amplitude in (0.1 * unstable, 0.5 * unstable, unstable, 1.2 * unstable):
        expected = np.interp(amplitude, x, reached / reached[-1])
        found = float(committor(FORM, speed, amplitude, law))
        assert found == pytest.approx(expected, rel=2e-3, abs=1e-4)
        expected = passed[-1] - np.interp(amplitude, x, passed)
        found = float(mean_escape_time(FORM, speed, law, amplitude))
        assert found == pytest.approx(expected, rel=3e-3)


@compiled
def _escapes(
    normals: np.ndarray, start: float, floor: float, roof: float, step: float, c: np.ndarray
) -> tuple[int, int]:
    """Count phasors (x, y) that reach the roof, and the floor, first; c: s0, s1, s2, D."""
    up = down = 0
    x, y = start, 0.0
    for k in range(normals.shape[0]):
        a2 = x * x + y * y
        rate = c[0] + c[1] * a2 + c[2] * a2 * a2
        x += rate * x * step + math.sqrt(2 * c[3] * step) * normals[k, 0]
        y += rate * y * step + math.sqrt(2 * c[3] * step) * normals[k, 1]
        a2 = x * x + y * y
        if a2 >= roof * roof:
            up += 1
            x, y = start, 0.0
        elif a2 <= floor * floor:
            down += 1
            x, y = start, 0.0
    return up, down


@pytest.mark.parametrize('factor', [0.8, 1.0, 1.2])
def test_the_committor_counts_simulated_phasors(factor: float) -> None:
    speed, diffusion = 7.2, 1.5e-9
    unstable, stable = (float(x) for x in FORM.steady_amplitudes(speed))
    floor, roof = math.sqrt(diffusion / -float(FORM.growth_rate(speed))), 0.5 * (unstable + stable)
    s = FORM.growth_rate(speed, [0.0, 1e-4, 2e-4])
    s2 = ((s[2] - s[0]) / 4e-8 - (s[1] - s[0]) / 1e-8) / 3e-8
    c = np.array([s[0], (s[1] - s[0]) / 1e-8 - s2 * 1e-8, s2, diffusion])
    normals = np.random.default_rng(1).standard_normal((1_500_000, 2))
    up, down = _escapes(normals, factor * unstable, floor, roof, 2e-3, c)
    share = up / (up + down)
    sigma = math.sqrt(share * (1 - share) / (up + down))
    expected = float(committor(FORM, speed, factor * unstable, diffusion))
    assert up + down > 200
    assert abs(share - expected) < 4 * sigma + 0.01


@given(
    speed=st.floats(6.45, 7.95),
    exponent=st.floats(-14, -8),
    slope=st.floats(-2e7, 2e7),
)
@settings(max_examples=60, deadline=None)
def test_the_committor_rises_from_0_to_1_and_escape_quickens(
    speed: float, exponent: float, slope: float
) -> None:
    law = AmplitudeDiffusion(10**exponent, slope)
    stable = float(FORM.stable_amplitude(speed))
    amplitudes = np.linspace(0.0, stable, 200)
    chance = committor(FORM, speed, amplitudes, law)
    assert chance[0] == 0.0
    assert chance[-1] == 1.0
    assert (np.diff(chance) >= 0.0).all()
    time = mean_escape_time(FORM, speed, law, amplitudes)
    with np.errstate(invalid='ignore'):
        assert not (np.diff(time) > 1e-9 * time[:-1]).any()
    assert time[-1] == 0.0


def test_without_noise_the_committor_is_the_step_at_the_unstable_amplitude() -> None:
    unstable = float(FORM.unstable_amplitude(7.2))
    amplitudes = [0.999 * unstable, unstable, 1.001 * unstable, math.nan]
    np.testing.assert_array_equal(committor(FORM, 7.2, amplitudes, 0.0), [0, 0.5, 1, math.nan])
    narrow = committor(FORM, 7.2, amplitudes, 1e-20)
    np.testing.assert_allclose(narrow[[0, 2]], [0, 1], atol=1e-9)
    times = mean_escape_time(FORM, 7.2, 0.0, amplitudes[:3])
    roof = 0.5 * (unstable + float(FORM.stable_amplitude(7.2)))
    assert times[:2].tolist() == [math.inf, math.inf]
    assert times[2] == pytest.approx(FORM.time_between(7.2, 1.001 * unstable, roof))


def test_outside_the_hysteresis_region_the_end_is_certain() -> None:
    amplitudes = np.array([1e-5, 5e-4, math.nan])
    np.testing.assert_array_equal(committor(FORM, 6.0, amplitudes, 1e-9), [0, 0, math.nan])
    np.testing.assert_array_equal(committor(FORM, 8.3, amplitudes, 1e-9), [1, 1, math.nan])
    assert mean_escape_time(FORM, 6.0, 1e-9, 1e-5) == math.inf
    supercritical = NormalForm(8.0, 0.12, -2000.0, -0.06, 0.0, -1e6)
    assert committor(supercritical, 7.0, 1e-4, 1e-9) == 0.0
    assert committor(supercritical, 9.0, 1e-4, 1e-9) == 1.0
    assert mean_escape_time(supercritical, 7.0, 1e-9) == math.inf


@pytest.mark.parametrize('diffusion', [1e-10, 1e-11, 1e-13])
def test_with_little_noise_the_time_from_far_above_the_edge_is_the_deterministic_one(
    diffusion: float,
) -> None:
    """From where the potential is below that of rest: falling back first is too rare to count."""
    speed = 7.9
    unstable, stable = (float(x) for x in FORM.steady_amplitudes(speed))
    start = 2.2 * unstable
    expected = FORM.time_between(speed, start, 0.5 * (unstable + stable))
    found = float(mean_escape_time(FORM, speed, diffusion, start))
    assert found == pytest.approx(expected, rel=3e-2 if diffusion > 1e-11 else 5e-3)


def test_above_the_critical_speed_the_time_is_that_of_growth_from_the_noise() -> None:
    """Linear growth from rest: E t = (ln(2 s A^2 / 2 D) + gamma) / 2 s, to the nonlinear end."""
    form = NormalForm(8.0, 0.12, 1e-6, 0.0, 0.0, -1e4)
    speed, diffusion = 9.0, 1e-14
    rate = float(form.growth_rate(speed))
    end = 0.5 * float(form.stable_amplitude(speed))
    euler = 0.5772156649
    linear = (math.log(rate * end**2 / (2 * diffusion)) + euler) / (2 * rate)
    bent = form.time_between(speed, 1e-6, end) - math.log(end / 1e-6) / rate
    assert float(mean_escape_time(form, speed, diffusion)) == pytest.approx(
        linear + bent, rel=1e-2
    )


def test_the_quiet_diffusion_keeps_the_amplitude_of_the_full_model() -> None:
    """Near v_c only the hunting mode is excited, and A_rms^2 = 2 D / |s| is exact."""
    rig, wn = paper_rig(), 1e-5
    form = normal_form_of(rig).amplitude_coordinate
    for speed, tolerance in ((7.95, 0.01), (7.2, 0.06)):
        std = math.sqrt(quiet_covariance(rig, speed, wn)[0, 0]) * rig.length_scale
        diffusion = quiet_diffusion(rig, speed, wn)
        rate = -float(form.growth_rate(speed))
        assert math.sqrt(2 * diffusion / rate) == pytest.approx(math.sqrt(2) * std, rel=tolerance)
        assert diffusion_from_quiet(form, speed, math.sqrt(2) * std) == pytest.approx(
            diffusion, rel=2.2 * tolerance
        )


def test_on_a_small_unstable_cycle_the_diffusion_is_that_at_rest(branch: Branch) -> None:
    law = amplitude_diffusion(paper_rig(), 7.99, 1e-5, branch)
    amplitude = float(branch.at_speed(7.99).amplitude[0])
    assert float(law(amplitude)) / law.quiet == pytest.approx(1.0, abs=0.02)


def test_the_local_form_has_rest_cycle_and_exponent_of_the_full_model(branch: Branch) -> None:
    form = local_form(normal_form_of(paper_rig()), branch, 7.2)
    cycle = branch.at_speed(7.2)
    unstable = float(cycle.amplitude[0])
    assert float(form.unstable_amplitude(7.2)) == pytest.approx(unstable, rel=1e-9)
    assert float(form.floquet_exponent(7.2, unstable)) == pytest.approx(cycle.exponent[0])
    assert float(form.growth_rate(7.2)) == pytest.approx(-0.01318713 * 25.91, rel=1e-5)
    with pytest.raises(ConfigError, match=r'no unstable limit cycle at 6\.0 m/s'):
        local_form(normal_form_of(paper_rig()), branch, 6.0)


def escape_times(speed: float, broadband: float, roof: float, count: int) -> np.ndarray:
    """Times until the full model is first beyond the roof, s."""
    times = []
    for seed in range(count):
        rig = RollerRig(
            paper_rig(), SimulationSettings(initial_speed=speed, broadband=broadband), seed
        )
        while np.abs(rig.advance(250).true_lateral).max() < roof:
            pass
        times.append(rig.time_s - 0.25)
    return np.array(times)


@needs_compiler
@pytest.mark.parametrize(
    ('speed', 'broadband', 'count'),
    [
        (7.2, 7e-5, 400),
        (7.2, 9e-5, 400),
        (6.8, 1.2e-4, 400),
        (7.6, 3.3e-5, 150),
        (7.2, 5.6e-5, 60),
    ],
)
def test_escapes_of_the_full_model_take_the_time_of_the_fokker_planck_equation(
    branch: Branch, speed: float, broadband: float, count: int
) -> None:
    """A_rms / A_u from 0.32 to 0.52: within a factor 1.7, and 10 % in the logarithm."""
    rig = paper_rig()
    form = local_form(normal_form_of(rig), branch, speed)
    law = amplitude_diffusion(rig, speed, broadband, branch)
    roof = 0.5 * sum(float(x) for x in branch.at_speed(speed).amplitude)
    ratio = math.sqrt(2 * law.quiet / -float(form.growth_rate(speed))) / float(
        form.unstable_amplitude(speed)
    )
    assert 0.28 < ratio < 0.53
    times = escape_times(speed, broadband, roof, count)
    predicted, mean = float(mean_escape_time(form, speed, law)), times.mean()
    assert 1 / 1.7 < predicted / mean < 1.7
    statistical = times.std() / mean / math.sqrt(count) / math.log(mean)
    assert abs(math.log(predicted) / math.log(mean) - 1) < 0.10 + 2 * statistical


@pytest.mark.parametrize(('quiet', 'slope'), [(-1.0, 0.0), (math.nan, 0.0), (1.0, math.inf)])
def test_an_impossible_diffusion_is_refused(quiet: float, slope: float) -> None:
    with pytest.raises(ConfigError, match='diffusion'):
        AmplitudeDiffusion(quiet, slope)


def test_no_quiet_state_is_refused() -> None:
    with pytest.raises(ConfigError, match=r'no quiet state at 8\.5 m/s'):
        diffusion_from_quiet(FORM, 8.5, 1e-5)
