"""The outlook of the detector against the exact committor, escape times and simulated paths."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid, trapezoid
from scipy.stats import norm

from hunt_ros.detection.decision.outlook import OutlookTable
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM

FORM = PAPER_NORMAL_FORM
EXACT = IdentifiedNormalForm(FORM)
UNSURE = IdentifiedNormalForm(FORM, np.diag([0.05, 0.005, 3.0, 0.005, 60.0, 1e4]) ** 2)


def exact_escape(speed: float, diffusion: float) -> tuple[np.ndarray, np.ndarray, float]:
    """
    Return amplitudes, the committor there, and escapes per second from rest, by quadrature.

    C. W. Gardiner, Handbook of Stochastic Methods (2004), Eqs. (5.2.160), (5.2.189).
    """
    unstable, stable = (float(x) for x in FORM.steady_amplitudes(speed))
    quiet = min(math.sqrt(diffusion / -float(FORM.growth_rate(speed))), 0.5 * unstable)
    grid = np.geomspace(1e-3 * quiet, 0.5 * (unstable + stable), 40_001)
    drift = grid * np.asarray(FORM.growth_rate(speed, grid)) / diffusion
    barrier = -cumulative_trapezoid(drift, grid, initial=0.0)
    between = grid >= quiet
    density = np.exp(barrier[between] - barrier.max()) / grid[between]
    risen = cumulative_trapezoid(density, grid[between], initial=0.0)
    rate = 0.0
    if np.ptp(barrier) < 600.0:
        below = cumulative_trapezoid(np.exp(-barrier) * grid / diffusion, grid, initial=0.0)
        rate = 1.0 / float(trapezoid(np.exp(barrier) / grid * below, grid))
    return grid[between], risen / risen[-1], rate


def chance(outlook: np.ndarray, amplitude: float) -> float:
    """Chance of escape from an amplitude, m, that is known."""
    return float(np.mean(outlook['decides'] < amplitude))


@pytest.mark.parametrize('speed', [6.6, 7.2, 7.6])
@pytest.mark.parametrize('ratio', [0.02, 0.05, 0.1, 0.2])
def test_of_a_form_that_is_exact_it_is_the_committor(speed: float, ratio: float) -> None:
    unstable = float(FORM.unstable_amplitude(speed))
    diffusion = -0.5 * float(FORM.growth_rate(speed)) * (ratio * unstable) ** 2
    outlook = OutlookTable(EXACT).at(speed, diffusion, 0.0, ratio * unstable, 0.0)
    amplitude = np.linspace(0.3, 1.8, 60) * unstable
    exact = np.interp(amplitude, *exact_escape(speed, diffusion)[:2])
    found = [chance(outlook, a) for a in amplitude]
    # A cell of the table is wider than the edge is where there is little noise.
    share = np.mean(np.abs(np.subtract(found, exact)) < 0.06)
    assert share > 0.95, np.abs(np.subtract(found, exact)).max()
    rate = exact_escape(speed, diffusion)[2]
    if 1e-9 < rate < 0.5:
        # Less than a cell of the noise changes the time by so much.
        found_rate = -math.log1p(-float(outlook['next_minute'][0])) / 60.0
        apart = abs(math.log(found_rate / rate))
        other = exact_escape(speed, diffusion * math.exp(0.06))[2]
        assert apart < abs(math.log(other / rate)) + 0.1


def test_where_the_noise_is_not_known_the_next_minute_is_the_mean_over_what_it_may_be() -> None:
    table, spread, diffusion, quiet = OutlookTable(EXACT), 0.4, 8e-10, 90e-6
    levels = (np.arange(200) + 0.5) / 200
    factors = np.exp(spread * norm.ppf(levels))
    each = [
        table.at(7.2, factor * diffusion, 0.0, quiet, 0.0)['next_minute'] for factor in factors
    ]
    assert 0.05 < np.mean(each) < 0.95
    found = table.at(7.2, diffusion, spread, quiet, 0.0)['next_minute']
    assert float(found[0]) == pytest.approx(np.mean(each), abs=0.05)


@pytest.mark.parametrize('speed', [7.6, FORM.critical_speed, 8.2])
def test_near_the_critical_speed_it_is_the_chance_of_simulated_paths(speed: float) -> None:
    diffusion, quiet = 3e-10, 60e-6
    outlook = OutlookTable(EXACT).at(speed, diffusion, 0.0, quiet, 0.0)
    unstable, stable = (float(x) for x in FORM.steady_amplitudes(speed))
    high = 0.5 * (stable + (0.0 if math.isnan(unstable) else unstable))
    rng = np.random.default_rng(3)
    step = 2e-3
    for start in (90e-6, 130e-6):
        z = np.full(1000, start, dtype=np.complex128)
        risen, left = 0, z.size
        while left > 10:
            shock = rng.standard_normal((z.size, 2)) @ np.array([1.0, 1j])
            rate = np.asarray(FORM.growth_rate(speed, np.abs(z)))
            z = z * (1.0 + rate * step) + math.sqrt(2.0 * diffusion * step) * shock
            size = np.abs(z)
            risen += int((size >= high).sum())
            z = z[(size < high) & (size > quiet)]
            left = z.size
        assert chance(outlook, start) == pytest.approx(risen / (1000 - left), abs=0.08)


@settings(deadline=None, max_examples=50)
@given(st.floats(5.0, 9.0), st.floats(1e-13, 1e-9), st.floats(1e-6, 1e-4), st.floats(0.0, 5e-5))
def test_it_is_a_distribution_over_amplitudes(speed, diffusion, quiet, line) -> None:
    outlook = OutlookTable(UNSURE).at(speed, diffusion, 0.3, quiet, line)[0]
    decides = outlook['decides']
    assert not np.isnan(decides).any()
    assert np.all(np.diff(decides[np.isfinite(decides)]) >= 0.0)
    assert np.all(decides > 0.9 * quiet)
    assert 0.0 <= outlook['next_minute'] <= 1.0
    assert 0.0 <= outlook['quiet'] <= 1.0


def test_of_an_uncertain_form_it_has_no_step_at_the_fold_nor_at_the_critical_speed() -> None:
    table = OutlookTable(UNSURE)
    # v_c is known to within 0.05 m/s: from one speed to the next it changes by 0.8 of that.
    speeds = np.arange(6.0, 8.6, 0.04)
    for amplitude in (60e-6, 200e-6, 600e-6):
        chances = [chance(table.at(v, 1e-11, 0.3, 30e-6, 0.0), amplitude) for v in speeds]
        assert np.abs(np.diff(chances)).max() < 0.35, amplitude


def test_roughness_brings_the_edge_nearer() -> None:
    table = OutlookTable(EXACT)
    plain, rough = (np.median(table.at(7.4, 1e-13, 0.0, 1e-5, b)['decides']) for b in (0.0, 5e-5))
    assert rough**2 == pytest.approx(plain**2 - 2.0 * 5e-5**2, rel=0.1)


def test_where_there_is_no_limit_cycle_nothing_leads_to_it() -> None:
    outlook = OutlookTable(EXACT).at(5.0, 1e-11, 0.3, 1e-5, 0.0)
    assert chance(outlook, 1.0) == 0.0
    assert outlook['next_minute'][0] == 0.0
    assert outlook['quiet'][0] == 1.0


def test_beyond_the_critical_speed_it_needs_to_know_what_is_quiet() -> None:
    table, speed = OutlookTable(EXACT), 8.4
    stable = float(FORM.stable_amplitude(speed))
    known, unknown = (table.at(speed, 1e-12, 0.3, quiet, 0.0) for quiet in (1e-5, math.nan))
    assert chance(known, 3e-5) > 0.9
    assert chance(unknown, 0.4 * stable) == 0.0
    assert chance(unknown, 0.6 * stable) == 1.0
    assert known['quiet'][0] == 0.0


def test_where_growth_has_no_end_the_edge_decides_below_v_c_and_the_noise_above() -> None:
    table = OutlookTable(IdentifiedNormalForm(replace(FORM, D15=0.0, D10=0.0)))
    edge = float(replace(FORM, D15=0.0, D10=0.0).unstable_amplitude(7.2))
    below, above = (table.at(speed, 1e-15, 0.0, 1e-5, 0.0) for speed in (7.2, 8.4))
    assert chance(below, 0.9 * edge) == 0.0
    assert chance(below, 1.1 * edge) == 1.0
    assert chance(above, 0.9e-5) == 0.0
    assert chance(above, 3e-5) == 1.0


@pytest.mark.parametrize('quiet', [1e-9, 1e-7, 1e-5])
def test_what_is_quiet_may_be_far_below_the_limit_cycle(quiet: float) -> None:
    own = EXACT.vector
    endless = own * (1.0, 1.0, 1.0, 1.0, 0.0, 0.0)
    sample = np.array([own, endless] * 32)
    mixed = IdentifiedNormalForm(FORM, np.diag([1e-9] * 6), sample=sample)
    outlook = OutlookTable(mixed).at(8.4, 1e-14, 0.0, quiet, 0.0)
    assert 0.0 <= chance(outlook, 0.5 * quiet) <= 0.01, 'quiet is no escape'
    assert chance(outlook, 100.0 * quiet) > 0.9
    assert 0.0 < outlook['next_minute'][0] <= 1.0


def test_the_interval_is_that_of_the_form_and_the_noise() -> None:
    speed, unstable = 7.2, float(FORM.unstable_amplitude(7.2))
    drawn = [form.unstable_amplitude(speed) for form in UNSURE.draws(2000)]
    low, high = np.nanquantile(drawn, (0.025, 0.975))
    outlook = OutlookTable(UNSURE).at(speed, 1e-14, 0.0, 1e-5, 0.0)[0]
    assert np.median(outlook['earliest']) == pytest.approx(low, rel=0.1)
    assert np.median(outlook['latest']) == pytest.approx(high, rel=0.1)
    exact = OutlookTable(EXACT).at(speed, 1e-14, 0.0, 1e-5, 0.0)[0]
    for name in ('decides', 'earliest', 'latest'):
        assert np.median(exact[name]) == pytest.approx(unstable, rel=0.02)


def test_an_unstable_branch_beyond_the_limit_cycle_is_not_on_the_way_to_it() -> None:
    soft = replace(FORM, D4=-9.0, D10=0.0, D15=0.0)
    outer = replace(soft, D15=900.0)  # as an uncertain form is drawn now and then
    speed = 1.1 * FORM.critical_speed
    stable = float(soft.stable_amplitude(speed))
    assert np.sqrt(-soft.D4 / outer.D15) * 2.0 * FORM.length_scale > 2.0 * stable
    for form in (soft, outer):
        table = OutlookTable(IdentifiedNormalForm(form))
        assert chance(table.at(speed, 1e-12, 0.3, 0.01 * stable, 0.0), 0.2 * stable) > 0.99


def test_uncertainty_of_the_form_spreads_the_branch_and_the_critical_speed() -> None:
    covariance = np.zeros((6, 6))
    covariance[0, 0] = 0.1**2
    identified = IdentifiedNormalForm(FORM, covariance)
    outlook = OutlookTable(identified).at(7.2, 0.0, 0.0, 1e-5, 0.0)
    shifted = [float(replace(FORM, critical_speed=v).unstable_amplitude(7.2)) for v in (7.9, 8.1)]
    assert outlook['unstable_std'][0] == pytest.approx((shifted[1] - shifted[0]) / 2.0, rel=0.2)
    assert 0.3 < OutlookTable(identified).at(8.0, 0.0, 0.0, 1e-5, 0.0)['quiet'][0] < 0.7
