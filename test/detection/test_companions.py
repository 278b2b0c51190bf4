"""Criteria and forecast beside the detector hear what they would hear alone."""

from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.detection.companions import Companions
from hunt_ros.detection.criteria import CriteriaPanel
from hunt_ros.detection.forecast import CriticalSpeedForecast
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import SensorModel, SimulationSettings, SpeedProfile, simulate


def _fed(companions: Companions, record, block_ns: int) -> list:
    verdicts = []
    for start in range(record.start_ns, record.end_ns + 1, block_ns):
        for name, series in record.between(start, start + block_ns).items():
            verdicts += companions.update(name, series.stamps_ns, series.values)
    return verdicts


@pytest.fixture(scope='module')
def staircase():
    settings = SimulationSettings(
        sample_rate_hz=100.0, broadband=2e-5, lateral_sensor=SensorModel(noise=5e-6)
    )
    profile = SpeedProfile.staircase(*np.arange(4.0, 7.1, 0.6).tolist(), hold_s=40.0)
    return simulate(paper_rig(), settings, profile, seed=2)


def test_the_forecast_is_made_from_channels_that_come_apart(staircase) -> None:
    companions = Companions(None, CriticalSpeedForecast(rig=paper_rig()))
    _fed(companions, staircase, 50_000_000)
    forecast = companions.forecast
    assert forecast is not None
    assert forecast.critical_speed is not None, forecast.reason
    assert forecast.critical_speed.value == pytest.approx(8.0, rel=0.1)


def test_a_criterion_speaks_when_its_limit_is_passed_and_after_reset_again() -> None:
    settings = SimulationSettings(sample_rate_hz=200.0, broadband=8e-6)
    record = simulate(paper_rig(), settings, SpeedProfile.constant(9.0), 40.0, seed=1)
    limits = {'cfr_213_333': {'scale': 0.02}}
    companions = Companions(CriteriaPanel(['cfr_213_333'], 200.0, limits), None)
    first = _fed(companions, record, 100_000_000)
    assert [v.exceeded for v in first] == [True]
    companions.reset()
    again = _fed(companions, record, 1_000_000_000)
    assert [(v.stamp_ns, v.criterion) for v in again] == [(v.stamp_ns, v.criterion) for v in first]


def test_without_speed_nothing_is_said() -> None:
    companions = Companions(CriteriaPanel(['six_peaks'], 200.0), None)
    stamps = np.arange(1000) * 5_000_000
    assert companions.update('lateral', stamps, np.sin(stamps * 1e-8)) == ()
