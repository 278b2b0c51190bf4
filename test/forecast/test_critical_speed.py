from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made import rig_settings

from hunt_ros.dynamics.linear_stability import critical_speed as theory
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Corners, Hold, Profile
from hunt_ros.dynamics.simulation import RollerRig
from hunt_ros.forecast import COLLECTING, NO_EXCITATION, CriticalSpeedForecast, critical_speed
from hunt_ros.forecast.response import Fit
from hunt_ros.samples import Uncertain

RATE = 200.0
TRUTH = 8.0
SPEEDS = np.arange(4.0, 7.3, 0.4)


def driven(profile: Profile, rig, settings, seed: int = 0):
    """Columns stamps, lateral, speed, angle of a drive."""
    rate = settings.sample_rate_hz
    count = round(profile.duration_s * rate)
    stream = RollerRig(rig, settings, seed)
    block = stream.advance(count, np.interp(np.arange(count) / rate, *profile.corners()))
    return block.stamps_ns, block.lateral, block.speed, block.roller_angle


def staircase(broadband: float = 2e-5, rig=None, speeds=SPEEDS):
    """Columns of a staircase with 30 s holds."""
    profile = Profile(tuple(Hold(float(v), 30.0) for v in speeds))
    settings = rig_settings(RATE, broadband, (40e-6, 10e-6), initial_speed=float(speeds[0]))
    return driven(profile, rig or paper_rig(), settings)


@pytest.fixture(scope='module')
def climb():
    return staircase()


def forecast_of(columns, rig=None, **more):
    """Return what is said at the end of a stretch."""
    forecast = CriticalSpeedForecast(rig, **more)
    forecast.update(*columns)
    return forecast.finish()


def rough_guess():
    """Return the rig with creep coefficients that are far off."""
    rig = paper_rig()
    return rig.with_linear(1.6 * rig.d11, 0.6 * rig.d22)


@pytest.mark.parametrize('law', ['wheelset', 'smooth'])
def test_v_c_is_forecast_before_it_is_reached(climb, law):
    found = forecast_of(climb, rough_guess() if law == 'wheelset' else None)
    assert found.law == law
    assert found.critical_speed is not None
    assert abs(found.critical_speed.value - TRUTH) < 4.0 * found.critical_speed.std
    assert found.critical_speed.value == pytest.approx(TRUTH, rel=0.12)
    # The interval says something: it does not reach from here to the stars.
    assert found.critical_speed.high - found.critical_speed.low < 0.4 * TRUTH


@pytest.mark.parametrize('law', ['wheelset', 'smooth'])
def test_another_rig_that_hunts_at_twice_the_speed(law):
    small = paper_rig()
    rig = replace(
        small,
        half_gauge_m=2.4 * small.half_gauge_m,
        wheel_radius_m=2.4 * small.wheel_radius_m,
        lateral_frequency_rad_per_s=0.7 * small.lateral_frequency_rad_per_s,
        yaw_frequency_rad_per_s=0.7 * small.yaw_frequency_rad_per_s,
    ).with_linear(2.2, 2.2)
    truth = theory(rig)
    assert truth > 12.0
    columns = staircase(rig=rig, speeds=np.linspace(0.5 * truth, 0.9 * truth, 9))
    guess = rig.with_linear(1.5, 3.0) if law == 'wheelset' else None
    found = forecast_of(columns, guess, live=False)
    assert found.law == law
    assert found.critical_speed is not None
    assert found.critical_speed.low < truth < found.critical_speed.high


def test_without_excitation_there_is_no_number():
    columns = staircase(0.0)
    for rig in (rough_guess(), None):
        found = forecast_of(columns, rig)
        assert found.critical_speed is None
        assert found.reason == NO_EXCITATION


def test_one_speed_tells_nothing_of_how_damping_goes_with_speed(climb):
    stamps, lateral, speed, angle = (column[: round(28 * RATE)] for column in climb)
    forecast = CriticalSpeedForecast()
    found = forecast.update(stamps, lateral, speed, angle)
    assert found.critical_speed is None
    assert found.reason == COLLECTING
    assert found.stamp_ns > 0


def test_a_stuck_sensor_gives_no_level():
    stamps = np.arange(20_000) * 5_000_000
    forecast = CriticalSpeedForecast()
    forecast.update(stamps, np.full(stamps.size, 1e-4), np.repeat([4.0, 5.0], 10_000))
    assert forecast.finish().critical_speed is None
    assert forecast.levels == ()


@pytest.mark.parametrize('law', ['wheelset', 'smooth'])
def test_a_sweep_through_v_c_of_a_supercritical_rig_is_not_forecast_too_high(law) -> None:
    rig = replace(paper_rig(), beta={'30': -250.0}, name='supercritical')
    # To where no test of hunting has spoken yet.
    profile = Profile((Corners((0.0, 10.0, 250.0), (6.0, 6.0, 8.4)),))
    options = rig_settings(100.0, 2e-5, initial_speed=6.0)
    guess = rough_guess() if law == 'wheelset' else None
    found = []
    for seed in range(6):
        columns = driven(profile, rig, options, seed)
        found.append(forecast_of(columns, guess, live=False).critical_speed)
    given = [one for one in found if one is not None]
    assert len(given) >= 4
    # Of 95 % intervals fewer than four of six hold with a probability of 1 in 450.
    assert sum(one.low <= TRUTH <= one.high for one in given) >= len(given) - 2
    # Unbiased: all six on one side have a probability of 3 %, and so far away of much less.
    away = [(one.value - TRUTH) / one.std for one in given]
    assert abs(np.mean(away)) < 3.0 / np.sqrt(len(given))


@pytest.mark.parametrize(('value', 'told'), [(6.0, False), (6.9, True)])
def test_rest_excludes_a_critical_speed_far_below_it(climb, monkeypatch, value, told):
    """A law may say so where the friction damps least at middle amplitudes."""
    said = Uncertain(value, 0.1)
    monkeypatch.setattr(Fit, 'critical_speed', lambda *fit: said)
    found = forecast_of(climb, live=False)
    assert (found.critical_speed == said) is told
    assert (found.reason == critical_speed.RESTED) is not told
