from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import trapezoid
from scipy.signal import lfilter

from hunt_ros.dynamics.linear_stability import critical_speed, hunting_mode, quiet_covariance
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.forecast.damping_laws import SmoothLaw, WheelsetLaw, held_growth
from hunt_ros.forecast.levels import SpeedLevel
from hunt_ros.forecast.response import Fit, Spectra, best_fit


def flat_levels(speeds, duration=60.0, bins=None):
    """Levels whose periodogram is still to be filled in."""
    bins = np.arange(math.ceil(0.8 * duration), 8.0 * duration) if bins is None else bins
    omega = 2.0 * np.pi * bins / duration
    ones = np.ones(omega.size)
    return [SpeedLevel(speed, duration, omega, ones, ones, ones, 5e-14) for speed in speeds]


def test_the_expected_periodogram_is_the_fourier_transform_of_the_windowed_covariance():
    levels = flat_levels([7.0], 20.0)
    spectra = Spectra(levels, 1.0, 6.0)
    rate = np.array([[-0.2 + 17.0j, -0.2 - 17.0j, -3.0 + 0j]])
    residue = np.array([[2.0 - 0.3j, 2.0 + 0.3j, 1.0 + 0j]])
    found = spectra.of_modes(rate, residue)
    lag = np.linspace(0.0, 20.0, 400_001)
    covariance = np.real(np.exp(np.outer(lag, rate[0])) @ residue[0]) * (1.0 - lag / 20.0)
    for k in (0, 33, 57, 99):
        expected = 2.0 * trapezoid(covariance * np.cos(spectra.omega[k] * lag), lag)
        assert found[k] == pytest.approx(expected, rel=1e-4, abs=1e-5)


@pytest.mark.parametrize('channel', ['lateral', 'yaw'])
def test_the_power_of_the_wheelset_law_is_the_variance_of_the_response(channel):
    # Against the Lyapunov equation, which knows nothing of spectra.
    rig, speed, strength = paper_rig(), 6.0, 2e-5
    law = WheelsetLaw(rig, channel=channel)
    theta = law.prior_mean.copy()
    theta[4], theta[-1] = math.log(strength), -80.0
    theta[5] = 0.0
    spectra = Spectra(flat_levels([speed], 600.0, np.arange(1, 12_000)), 0.0, 99.0)
    power = Fit(law, spectra, theta).expected
    covariance = quiet_covariance(rig, speed, strength)
    variance = covariance[2, 2] if channel == 'yaw' else covariance[0, 0] * rig.length_scale**2
    assert 2.0 * np.sum(power) / 600.0 == pytest.approx(variance, rel=0.01)


@settings(max_examples=40, deadline=None)
@given(d11=st.floats(0.5, 6.0), d22=st.floats(0.5, 6.0), tread=st.floats(0.02, 0.15))
def test_the_growth_rate_changes_sign_at_the_critical_speed(d11, d22, tread):
    law = WheelsetLaw(replace(paper_rig(), tread_angle=tread).with_linear(d11, d22))
    critical = law.critical_speed(law.prior_mean)
    if not math.isfinite(critical):
        assert law.eigenvalue(law.prior_mean, 500.0).real < 0.0
        return
    scale = abs(law.eigenvalue(law.prior_mean, critical))
    assert abs(law.eigenvalue(law.prior_mean, critical).real) < 1e-6 * scale
    assert law.eigenvalue(law.prior_mean, 0.97 * critical).real < 0.0
    assert law.eigenvalue(law.prior_mean, 1.03 * critical).real > 0.0


@pytest.mark.parametrize('law', [WheelsetLaw(paper_rig()), SmoothLaw()])
def test_the_fit_returns_the_parameters_that_made_the_spectrum(law):
    levels = flat_levels(np.arange(4.0, 7.3, 0.4))
    spectra = Spectra(levels, 1.7, 3.9)
    theta = law.prior_mean.copy()
    if isinstance(law, WheelsetLaw):
        theta[0] += 0.2
        theta[1] -= 0.1
        theta[4], theta[-1] = math.log(2e-5), math.log(5e-14)
    else:
        law.starts(spectra)
        theta[:4] = math.log(8.0), math.log(3.0), 0.0, math.log(17.8)
        theta[6], theta[-1] = math.log(1e-10), math.log(5e-14)
    spectra.power = Fit(law, spectra, theta).expected
    fit = best_fit(law, spectra)
    assert law.critical_speed(fit.theta) == pytest.approx(law.critical_speed(theta), rel=2e-3)
    assert fit.misfit < 1e-3


def test_the_information_is_that_of_an_exponential_distribution():
    # Of the level of white noise alone: each bin gives one unit.
    law = WheelsetLaw(paper_rig())
    spectra = Spectra(flat_levels([6.0]), 1.0, 6.0)
    theta = law.prior_mean.copy()
    theta[4] = -60.0
    _, matrix, _ = Fit(law, spectra, theta).slopes()
    assert matrix[-1, -1] == pytest.approx(spectra.omega.size + law.prior_std[-1] ** -2, rel=1e-3)


def test_the_law_agrees_with_linear_theory():
    rig = paper_rig()
    law = WheelsetLaw(rig)
    assert law.critical_speed(law.prior_mean) == pytest.approx(critical_speed(rig), rel=1e-9)
    mode = hunting_mode(rig, 6.0)
    assert law.eigenvalue(law.prior_mean, 6.0).real == pytest.approx(mode.growth_rate, rel=1e-9)


def test_neighbouring_bins_of_a_short_window_are_correlated_as_computed():
    # Periodograms of simulated windows against the formula.
    generator = np.random.default_rng(0)
    rate, step, count = complex(-0.4, 17.0), 1 / 50.0, 300
    root = np.exp(rate * step)
    drive = generator.normal(size=(4000, count + 400)) + 1j * generator.normal(
        size=(4000, count + 400)
    )
    motion = np.real(lfilter([1.0], [1.0, -root], drive, axis=1))[:, 400:]
    power = np.abs(np.fft.rfft(motion, axis=1)) ** 2
    spectra = Spectra(flat_levels([7.0], count * step, np.arange(12, 22)), 0.0, 99.0)
    pair = np.array([[rate, rate.conjugate()]])
    residue = np.ones((1, 2), dtype=complex)
    expected = spectra.of_modes(pair, residue)
    found = spectra.correlation_of_bins(0, pair, residue, expected)
    measured = np.corrcoef(power[:, 12:22].T)
    assert found == pytest.approx(measured, abs=0.08)
    assert found[4, 5] > 0.1


def test_bins_that_show_the_ends_of_the_window_are_left_out():
    # The far flank of a sharp peak, without noise to hide the leakage.
    levels = flat_levels([7.8])
    law = WheelsetLaw(paper_rig())
    spectra = Spectra(levels, *law.band(levels))
    theta = law.prior_mean.copy()
    theta[4], theta[-1] = math.log(2e-5), math.log(1e-18)
    kept = Fit(law, spectra, theta).own_bins()
    frequency = spectra.omega / (2.0 * np.pi)
    assert kept[np.abs(frequency - 2.83) < 0.03].all()
    assert not kept[frequency > 5.0].any()
    # Under noise the same bins show the noise, which is their own.
    theta[-1] = math.log(1e-11)
    assert Fit(law, spectra, theta).own_bins()[frequency > 5.0].all()


def test_a_bin_whose_spectrum_alone_is_below_zero_shows_leakage():
    """The others are judged as ever: near v_c all were kept for one of them."""

    class Narrow:
        prior_mean, prior_std = np.zeros(1), np.ones(1)

        def modes(self, speed, theta):
            rate, residue = -0.001 + 17.0j, 1.0 + 3e-4j
            return np.array([[rate, rate.conjugate()]]), np.array([[residue, residue.conjugate()]])

    spectra = Spectra(flat_levels([7.0]), 0.0, 99.0)
    fit = Fit(Narrow(), spectra, np.array([math.log(1e-9)]))
    own = spectra.of_modes(*fit.law.modes(spectra.speed, fit.theta), leakage=False)
    assert math.isfinite(fit.cost)
    assert own.min() < -1e-6
    assert not fit.own_bins()[own < 0.0].any()


def test_motion_that_is_damped_more_where_it_is_larger_stays_also_beyond_v_c():
    growth = np.array([-2.0, -0.1, 0.0, 0.3])
    held = held_growth(growth, np.full(4, 0.01))
    assert held == pytest.approx(growth - 0.01 / -held)
    assert np.all(np.diff(held) > 0.0)
    assert held[0] == pytest.approx(growth[0], rel=0.003)
    # Damped less where it is larger: it stays only where the linear damping is large enough.
    assert held_growth(growth[:1], np.full(1, -0.01))[0] > growth[0]
    assert held_growth(growth[:2], np.full(2, -0.01)) is None
