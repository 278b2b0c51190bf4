"""Criteria and forecast beside the detector hear what the detector hears."""

from __future__ import annotations

import numpy as np
import pytest
from fed import Fed
from made import dead, held, rig_settings

from hunt_ros.criteria import Verdict
from hunt_ros.detection import CompanionConfig, Companions, DetectorConfig, HuntingDetector, detect
from hunt_ros.detection.offline import collect, config_for
from hunt_ros.detection.replay import watch
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Hold, Profile
from hunt_ros.dynamics.simulation import SimulationSettings, simulate
from hunt_ros.errors import ConfigError
from hunt_ros.forecast import Forecast
from hunt_ros.samples import Record

HUNTING = CompanionConfig(criteria=('cfr_213_333',), criteria_scale=0.02, forecast='off')


@pytest.fixture(scope='module')
def staircase() -> Record:
    settings_ = rig_settings(100.0, 2e-5, (30e-6,))
    profile = Profile(tuple(Hold(float(v), 40.0) for v in np.arange(4.0, 7.1, 0.6).tolist()))
    return simulate(paper_rig(), settings_, profile, seed=2)


@pytest.fixture(scope='module')
def hunting() -> Record:
    settings_ = SimulationSettings(sample_rate_hz=200.0, broadband=8e-6)
    return simulate(paper_rig(), settings_, held(9.0), 40.0, seed=1)


def forecast_of(motion: np.ndarray, config: DetectorConfig) -> Forecast:
    companions = Companions(CompanionConfig(), config, live=False)
    companions.update(motion)
    found = companions.finish()
    assert found is not None
    return found


def test_the_forecast_is_made_from_what_the_detector_merged(staircase) -> None:
    for channels in (('lateral', 'yaw', 'roller', 'speed'), ('yaw', 'roller', 'speed')):
        config = DetectorConfig(channels=channels)
        forecast = forecast_of(detect(HuntingDetector(config), staircase).motion, config)
        assert forecast.critical_speed is not None, forecast.reason
        assert forecast.critical_speed.low < 8.0 < forecast.critical_speed.high
        assert forecast.critical_speed.value == pytest.approx(8.0, rel=0.12)


def test_a_criterion_speaks_when_its_limit_is_passed_and_after_reset_again(hunting) -> None:
    config, _ = config_for(hunting, DetectorConfig())
    companions = Companions(HUNTING, config)
    output = detect(HuntingDetector(config), hunting)
    first = companions.update(output.motion)
    assert [verdict.exceeded for verdict in first] == [True]
    companions.reset()
    assert companions.update(output.motion) == first
    assert companions.finish() is None


def test_live_with_ticks_and_its_replay_say_what_the_whole_record_says(hunting) -> None:
    config, _ = config_for(hunting, DetectorConfig())
    detector = HuntingDetector(config)
    whole = collect(watch(hunting, detector), detector, Companions(HUNTING))
    live, rig = Companions(HUNTING), Fed(HuntingDetector(config))
    verdicts: list[Verdict] = []
    list(rig.play(hunting, range(0, hunting.end_ns + 1, 50_000_000)))
    for output in rig.outputs:
        verdicts += live.update(output.motion)
    assert verdicts == whole.verdicts != []
    again = detect(HuntingDetector(config), hunting, rig.output.journal)
    assert list(Companions(HUNTING).update(again.motion)) == verdicts


def test_hunting_says_nothing_of_the_quiet_response(recorded, true_form) -> None:
    record = recorded(7.2, 20.0, kicks=[(3.0, 400e-6)])
    output = detect(HuntingDetector(normal_form=true_form), record)
    quiet = output.motion['quiet']
    stamps = output.motion['stamps_ns']
    assert quiet[stamps < 3_000_000_000].all()
    assert not quiet[stamps > 8_000_000_000].any()
    assert forecast_of(output.motion, DetectorConfig()).levels == 0


def test_a_stuck_sensor_and_a_missing_speed_are_not_heard(recorded) -> None:
    record = recorded(6.0, 6.0)
    output = detect(HuntingDetector(), dead(record, 'lateral', 3.0, 1e-5))
    assert int(output.motion['stamps_ns'][-1]) < 3_300_000_000
    channels = tuple(name for name in record if name != 'speed')
    output = detect(HuntingDetector(DetectorConfig(channels=channels)), record)
    assert np.isnan(output.motion['speed']).all()
    companions = Companions(
        CompanionConfig(criteria=('uic_518',)), DetectorConfig(channels=channels)
    )
    assert companions.update(output.motion) == ()


def test_what_cannot_be_run_is_refused() -> None:
    with pytest.raises(ConfigError, match='cfr_213_333'):
        CompanionConfig(criteria=('cfr',))
    with pytest.raises(ConfigError, match='lateral'):
        Companions(HUNTING, DetectorConfig(channels=('yaw', 'speed')))


@pytest.fixture(scope='module')
def merged(staircase) -> np.ndarray:
    return detect(HuntingDetector(), staircase).motion


@pytest.mark.parametrize('encoder', [True, False])
def test_the_forecast_leaves_out_the_lines_that_the_detector_is_told_of(merged, encoder) -> None:
    lines = merged.copy()
    lines['values'] += 5e-5 * np.cos(0.61 * merged['roller_angle'])
    if not encoder:
        lines['roller_angle'] = np.nan
    channels = ('lateral', 'yaw', 'roller', 'speed') if encoder else ('lateral', 'yaw', 'speed')
    told = DetectorConfig(lines=(1.0, 0.61), roller_diameter_m=0.3, channels=channels)
    found, plain = forecast_of(lines, told), forecast_of(merged, DetectorConfig())
    assert found.critical_speed is not None, found.reason
    assert plain.critical_speed is not None
    assert found.critical_speed.low < 8.0 < found.critical_speed.high
    assert found.critical_speed.std < 2.0 * plain.critical_speed.std


@pytest.mark.parametrize('faster', [12.0, 0.25])
def test_the_levels_of_the_forecast_are_periods_long(merged, faster) -> None:
    quick, stamps = merged.copy(), merged['stamps_ns']
    quick['stamps_ns'] = stamps[0] + np.round((stamps - stamps[0]) / faster).astype(np.int64)
    config = DetectorConfig(
        hunting_frequency_hz=2.84 * faster,
        output_rate_hz=200.0,
    )
    found, plain = forecast_of(quick, config), forecast_of(merged, DetectorConfig())
    assert found.levels == plain.levels
    assert found.critical_speed is not None, found.reason
    assert plain.critical_speed is not None
    for end in ('low', 'value', 'high'):
        truth = getattr(plain.critical_speed, end)
        assert getattr(found.critical_speed, end) == pytest.approx(truth, rel=0.02)
