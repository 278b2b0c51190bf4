"""Appendix A: apparent critical speeds against swept simulations of the full model."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hunt_ros.compiled import HAVE_COMPILER
from hunt_ros.dynamics.center_manifold import normal_form_of
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.limit_cycle import limit_cycles
from hunt_ros.dynamics.model_misfit import fitted_form
from hunt_ros.dynamics.noise.amplitude_noise import quiet_diffusion
from hunt_ros.dynamics.noise.disturbance import (
    AmplitudeDiffusion,
    Disturbance,
    apparent_loop,
    disturbance_from_width,
    fold_delay,
    growth_rate_on_line,
    jump_speeds,
    threshold_on_line,
)
from hunt_ros.dynamics.noise.escape_interval import MODEL_ERROR, escape_time_interval
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM, NormalForm
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import RollerRig, Roughness, SimulationSettings
from hunt_ros.errors import ConfigError
from hunt_ros.samples import Uncertain

FORM = PAPER_NORMAL_FORM

needs_compiler = pytest.mark.skipif(
    not HAVE_COMPILER, reason='hours of simulated time: needs the compiled kernel'
)


@pytest.fixture(scope='module')
def form() -> NormalForm:
    return fitted_form(normal_form_of(paper_rig()), limit_cycles(paper_rig()), (6.4, 9.0))


def noise(broadband: float) -> AmplitudeDiffusion:
    return AmplitudeDiffusion(quiet_diffusion(paper_rig(), 7.2, broadband))


def swept(
    settings: SimulationSettings, rate: float, seed: int, jumped: Callable[[np.ndarray], bool]
) -> float:
    """Speed at which a sweep of the full model has jumped, m/s."""
    rig = RollerRig(paper_rig(), settings, seed)
    if rate < 0:
        rig.kick(6e-4)
        rig.advance(2500)
    block, start = 88, rig.time_s  # half a period of hunting
    while 5.0 < rig.speed < 12.0:
        times = rig.time_s - start + np.arange(block) / settings.sample_rate_hz
        samples = rig.advance(block, settings.initial_speed + rate * times)
        if jumped(np.abs(samples.true_lateral)):
            return float(samples.speed[-1])
    return math.nan


@needs_compiler
@pytest.mark.parametrize(('broadband', 'rate'), [(8e-6, 0.02), (3e-5, 0.02), (8e-6, 0.05)])
def test_the_jump_to_hunting_is_where_swept_rigs_jump(
    form: NormalForm, broadband: float, rate: float
) -> None:
    threshold = 0.5 * float(form.stable_amplitude(8.0))
    settings = SimulationSettings(initial_speed=6.9, broadband=broadband)
    speeds = np.array([swept(settings, rate, k, lambda y: y.max() > threshold) for k in range(96)])
    predicted = jump_speeds(form, Disturbance(noise(broadband), 0.0, rate), 'up')
    error = speeds.std() / math.sqrt(len(speeds))
    assert predicted.median == pytest.approx(np.median(speeds), abs=0.02 + 4 * error)
    assert predicted.std == pytest.approx(speeds.std(), rel=0.4)


@needs_compiler
@pytest.mark.parametrize('rate', [0.005, 0.02, 0.05])
def test_the_end_of_hunting_is_where_swept_rigs_fall(form: NormalForm, rate: float) -> None:
    fold = form.saddle_node()
    assert fold is not None
    settings = SimulationSettings(initial_speed=6.8, broadband=8e-6)
    threshold = 0.5 * fold[1]
    speeds = [swept(settings, -rate, k, lambda y: y.max() < threshold) for k in range(12)]
    predicted = jump_speeds(form, Disturbance(noise(8e-6), 0.0, rate), 'down').median
    # v_n of the fitted form is 0.013 m/s below that of the full model
    assert predicted == pytest.approx(np.mean(speeds), abs=0.03)


def test_noise_and_rate_oppose_each_other(form: NormalForm) -> None:
    speeds = {
        (wn, rate): jump_speeds(form, Disturbance(noise(wn), 0.0, rate), 'up').median
        for wn in (0.0, 8e-6, 3e-5)
        for rate in (0.01, 0.05)
    }
    for rate in (0.01, 0.05):
        assert speeds[3e-5, rate] < speeds[8e-6, rate] < speeds[0.0, rate]
    for wn in (0.0, 8e-6, 3e-5):
        assert speeds[wn, 0.01] < speeds[wn, 0.05]


@pytest.mark.parametrize('rate', [1e-4, 1e-3])
def test_the_delay_at_the_fold_is_that_of_the_swept_amplitude_equation(rate: float) -> None:
    speed, amplitude = FORM.saddle_node() or (math.nan, math.nan)

    def slope(t: float, a: np.ndarray) -> np.ndarray:
        return a * FORM.growth_rate(speed + 0.1 - rate * t, a)

    def gone(t: float, a: np.ndarray) -> float:
        return float(a[0] - 0.5 * amplitude)

    gone.terminal = True  # type: ignore[attr-defined]
    start = [float(FORM.stable_amplitude(speed + 0.1))]
    run = solve_ivp(slope, (0, 1e5), start, method='LSODA', rtol=1e-9, atol=1e-12, events=gone)
    delay = rate * run.t_events[0][0] - 0.1
    assert fold_delay(FORM, rate) == pytest.approx(delay, rel=0.12)


def test_the_delay_at_the_fold_grows_as_rate_to_two_thirds() -> None:
    assert fold_delay(FORM, 0.08) / fold_delay(FORM, 0.01) == pytest.approx(4.0)


def test_roughness_lowers_the_threshold_as_the_square_root_says() -> None:
    for speed in (7.2, 7.6, 7.9):
        unstable = float(FORM.unstable_amplitude(speed))
        small = 0.05 * unstable
        expected = math.sqrt(unstable**2 - 2 * small**2)
        exact = threshold_on_line(FORM, speed, small)
        assert exact - unstable == pytest.approx(expected - unstable, rel=0.25)
        assert float(growth_rate_on_line(FORM, speed, exact, small)) == pytest.approx(0, abs=1e-9)
        assert threshold_on_line(FORM, speed, 0.0) == pytest.approx(unstable)
        assert threshold_on_line(FORM, speed, 0.9 * unstable) == 0.0
    assert math.isnan(threshold_on_line(FORM, 8.2, 1e-5))


def critical_kick(roughness: Roughness, phase: float) -> float:
    """Smallest kick of y that escapes at 7.6 m/s, at a phase of the roller, by bisection, m."""
    settings = SimulationSettings(initial_speed=7.6, roughness=roughness)
    low, high = 0.5e-4, 3e-4
    rig = RollerRig(paper_rig(), settings)
    for _ in range(12):
        middle = 0.5 * (low + high)
        rig.reset()
        rig.advance(round(phase * 500 * np.pi * 0.3 / 7.6))
        rig.kick(middle)
        peak = 0.0
        while 1e-5 + 2 * 43e-6 < (peak := np.abs(rig.advance(500).true_lateral).max()) < 4e-4:
            pass
        low, high = (low, middle) if peak >= 4e-4 else (middle, high)
    return 0.5 * (low + high)


@needs_compiler
def test_the_critical_kick_of_the_full_model_falls_as_the_threshold_does(
    form: NormalForm,
) -> None:
    """At 7.6 m/s with B = 43 um; over the phases of the roller the kick varies, its mean falls."""
    smooth = critical_kick(Roughness(), 0.0)
    rough = Roughness((43e-6,), reference_speed=7.6)
    kicks = [critical_kick(rough, phase) for phase in np.arange(8) / 8]
    predicted = threshold_on_line(form, 7.6, 43e-6) / float(form.unstable_amplitude(7.6))
    assert np.mean(kicks) / smooth == pytest.approx(predicted, abs=0.04)


def test_the_width_gives_back_the_noise_it_was_made_with(form: NormalForm) -> None:
    middle = 0.5 * ((form.saddle_node() or (math.nan,))[0] + 8.0)
    law = noise(2e-5)
    truth = math.sqrt(2 * law.quiet / -float(form.growth_rate(middle)))
    seen = apparent_loop(form, Disturbance(law, 0.0, 0.02)).hysteresis_width
    found = disturbance_from_width(form, Uncertain(seen.value, 0.01), 0.02)
    assert found.value == pytest.approx(truth, rel=0.15)
    assert found.low < truth < found.high
    off = disturbance_from_width(form, Uncertain(seen.value - 0.3, 0.01), 0.02)
    assert off.value > found.value


def test_the_width_gives_back_the_roughness_it_was_made_with(form: NormalForm) -> None:
    law, truth = noise(1e-5), 60e-6
    seen = apparent_loop(form, Disturbance(law, truth, 0.005)).hysteresis_width
    found = disturbance_from_width(form, Uncertain(seen.value, 0.01), 0.005, 'roughness', law)
    assert found.value == pytest.approx(truth, rel=0.15)
    assert found.low < truth < found.high


def test_a_loop_wider_than_any_disturbance_leaves_it_is_given_as_zero(form: NormalForm) -> None:
    found = disturbance_from_width(form, Uncertain(4.0, 0.01), 0.02)
    assert (found.value, found.low) == (0.0, 0.0)


def test_probability_is_kept_and_ordered(form: NormalForm) -> None:
    for direction in ('up', 'down'):
        jump = jump_speeds(form, Disturbance(noise(2e-5), 1e-5, 0.02), direction)  # type: ignore[arg-type]
        assert (np.diff(jump.probability) >= 0).all()
        assert 0.0 <= jump.probability[0] < 1e-6 < 0.999 < jump.probability[-1] <= 1.0
    assert math.isnan(jump.quantile(1.1))


def test_the_interval_of_the_escape_time_holds_the_model_error_and_the_covariance() -> None:
    exact = IdentifiedNormalForm(FORM)
    alone = escape_time_interval(exact, 7.2, 1.5e-9)
    assert math.log(alone.high / alone.value) == pytest.approx(1.96 * MODEL_ERROR, rel=1e-3)
    unsure = IdentifiedNormalForm(FORM, np.diag([0.03, 0.002, 60.0, 0.01, 30.0, 1e6]) ** 2)
    wider = escape_time_interval(unsure, 7.2, 1.5e-9)
    assert wider.value == alone.value
    assert wider.high / wider.low > 1.3 * alone.high / alone.low
    assert escape_time_interval(exact, 6.0, 1e-9).value == math.inf


def test_what_has_no_loop_is_refused() -> None:
    supercritical = NormalForm(8.0, 0.12, -2000.0, -0.06, 0.0, -1e6)
    with pytest.raises(ConfigError, match='no fold'):
        jump_speeds(supercritical, Disturbance(noise(1e-5)), 'up')
    with pytest.raises(ConfigError, match='no fold'):
        disturbance_from_width(supercritical, Uncertain(1.0, 0.1), 0.02)
    with pytest.raises(ConfigError, match='no fold'):
        fold_delay(supercritical, 0.02)
    with pytest.raises(ConfigError, match='diffusion of the noise must be known'):
        disturbance_from_width(FORM, Uncertain(1.0, 0.1), 0.02, 'roughness')
    with pytest.raises(ConfigError, match='sweep rate must be positive'):
        Disturbance(noise(1e-5), 0.0, 0.0)
    with pytest.raises(ConfigError, match='line amplitude must not be negative'):
        Disturbance(noise(1e-5), -1.0)
