"""The detector as a whole: states and events of known motions, and what it refuses."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from made import PAPER, changed, record_of, without, words

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, State, detect, health
from hunt_ros.detection.regions import Region
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.profile import Profile, Sweep
from hunt_ros.errors import ConfigError, HuntError
from hunt_ros.samples import Record, Series


def test_without_a_normal_form_the_amplitude_alone_decides(recorded) -> None:
    record = recorded(7.2, 40.0, kicks=[(8.0, 330e-6)])
    detector = HuntingDetector(DetectorConfig())
    output = detect(detector, record)
    assert detector.status.region is Region.UNKNOWN
    assert output.estimates['level'].min() >= Level.WARN
    assert any('no normal form' in reason for reason in detector.status.reasons)
    assert 'limit_cycle' in words(output)
    assert detector.status.alarm
    calm = detect(HuntingDetector(DetectorConfig()), recorded(7.2, 40.0, kicks=[(8.0, 150e-6)]))
    assert not set(words(calm)) & {'escaping', 'limit_cycle'}


def test_critical_speeds_alone_give_the_regions(recorded) -> None:
    profile = Profile((Sweep(6.0, 8.4, 0.4),))
    record = recorded(profile, profile.duration_s)
    config = DetectorConfig(critical_speed_mps=8.0, nonlinear_critical_speed_mps=6.4)
    output = detect(HuntingDetector(config), record)
    regions = [
        event for event in output.events if 'hysteresis' in event.event or 'unst' in event.event
    ]
    assert [event.event for event in regions] == [
        'hysteresis_entered',
        'hysteresis_left',
        'unstable_entered',
        'unstable_left',
        'hysteresis_entered',
        'hysteresis_left',
    ]
    assert regions[0].number('speed_mps') == pytest.approx(6.4, abs=0.15)
    assert regions[1].number('speed_mps') == pytest.approx(8.0, abs=0.15)


def test_below_a_critical_speed_alone_a_bump_may_start_hunting(recorded) -> None:
    record = recorded(7.2, 20.0)
    unknown = HuntingDetector(DetectorConfig(critical_speed_mps=8.0))
    assert detect(unknown, record).estimates['level'].min() == Level.WARN
    assert unknown.status.region is Region.HYSTERESIS
    supercritical = HuntingDetector(
        DetectorConfig(critical_speed_mps=8.0, nonlinear_critical_speed_mps=8.0)
    )
    detect(supercritical, record)
    assert supercritical.status.region is Region.STABLE


@pytest.mark.parametrize('channels', [('lateral',), ('yaw',), ('lateral', 'speed')])
def test_fewer_channels_are_enough(channels, recorded, true_form) -> None:
    record = recorded(7.2, 30.0, kicks=[(8.0, 330e-6)])
    record = without(record, *set(record) - set(channels))
    config = DetectorConfig(
        channels=channels,
        constant_speed_mps=0.0 if 'speed' in channels else 7.2,
    )
    detector = HuntingDetector(config, true_form)
    detect(detector, record)
    assert detector.status.level is Level.ERROR
    assert detector.status.alarm


def test_an_unknown_channel_and_unequal_lengths_are_refused() -> None:
    detector = HuntingDetector(DetectorConfig(channels=('lateral', 'speed')))
    with pytest.raises(HuntError, match='yaw'):
        detector.update('yaw', [0], [0.0])
    with pytest.raises(HuntError, match='one value a stamp'):
        detector.update('lateral', [0, 1], [0.0])


@pytest.mark.parametrize(
    ('changes', 'word'),
    [
        ({'channels': ('lateral', 'pitch')}, 'pitch'),
        ({'channels': ('speed',)}, 'lateral or yaw'),
        ({'channels': ('axle_box', 'roller', 'speed')}, 'need lateral or yaw'),
        ({'lines': (1.0, -2.0)}, 'lines .* got -2.0'),
        ({'lines': tuple(range(1, 20))}, 'at most 8'),
        ({'wheel_diameter_m': 0.07}, 'roller_diameter_m'),
        ({'critical_speed_mps': 6.0, 'nonlinear_critical_speed_mps': 7.0}, 'v_c'),
        ({'output_rate_hz': 0.0}, 'output_rate_hz'),
    ],
)
def test_impossible_settings_are_named(changes, word) -> None:
    with pytest.raises(ConfigError, match=word):
        DetectorConfig(**changes)


def test_a_clipped_limit_cycle_is_saturated_and_still_an_alarm(recorded) -> None:
    record = recorded(7.2, 10.0, kicks=[(1.5, 500e-6)])
    limit = 0.6 * float(np.abs(record['lateral'].values).max())  # of the sensor, all the time
    clipped = changed(record, lateral=lambda y: np.clip(y, -limit, limit))
    detector = HuntingDetector(normal_form=PAPER)
    rows = detect(detector, clipped).estimates
    during = rows[rows['stamp_ns'] > 5_600_000_000]
    assert np.isin(during['state'], [State.ESCAPING, State.LIMIT_CYCLE]).all()
    assert ((during['lateral_wrong'] & health.SATURATED) != 0).all()
    assert detector.status.alarm


def test_a_sensor_that_clips_a_slow_motion_does_not_recover_each_period() -> None:
    time = np.arange(0.0, 40.0, 0.01)
    noise = 2e-6 * np.random.default_rng(0).standard_normal(time.size)
    lateral = np.minimum(1e-3 * np.sin(2.0 * np.pi * 0.5 * time) + noise, 7e-4)
    config = DetectorConfig(channels=('lateral',), hunting_frequency_hz=0.5)
    output = detect(HuntingDetector(config), record_of(time, lateral=lateral))
    assert 'sensor_fault' in words(output)
    assert 'sensor_recovered' not in words(output)


def test_a_rig_that_runs_in_reverse_hunts_as_it_does_ahead_and_the_status_says_so(
    recorded, true_form
) -> None:
    record = recorded(7.2, 20.0, kicks=[(9.0, 330e-6)])
    detector = HuntingDetector(normal_form=true_form)
    reverse = detect(detector, changed(record, speed=np.negative, roller=np.negative))
    ahead = detect(HuntingDetector(normal_form=true_form), record)
    assert 'speed: negative: the rig runs in reverse' in detector.status.reasons
    assert detector.status.number('speed_mps') == pytest.approx(7.2, abs=0.05)
    assert Level.STALE not in reverse.estimates['level']
    for name in ('speed', 'lateral_amplitude', 'lateral_roughness', 'margin'):
        assert np.allclose(
            reverse.estimates[name], ahead.estimates[name], rtol=1e-3, atol=1e-7, equal_nan=True
        ), name
    events = [[(event.event, event.stamp_ns) for event in one.events] for one in (reverse, ahead)]
    assert events[0] == events[1]


# --- what the decision is to reach -------------------------------------------------------------

LATERAL = DetectorConfig(channels=('lateral', 'speed'))


def steady(amplitude_m: float, frequency_hz: float, speed: float, seconds: float) -> Record:
    """Return a steady motion with the noise of a sensor."""
    t = (np.arange(round(seconds * 200.0)) + 1) / 200.0
    noise = 5e-6 * np.random.default_rng(0).standard_normal(t.size)
    values = amplitude_m * np.cos(2.0 * np.pi * frequency_hz * t) + noise
    return record_of(t, lateral=values, speed=speed)


def test_the_chance_of_escape_is_continuous_through_the_fold() -> None:
    form = PAPER_NORMAL_FORM
    spread = np.array([0.02, 0.002, 0.01, 0.05, 0.05, 0.01])
    scale = np.array([1.0, form.D1, form.D4, form.D7, form.D10, form.D15])
    known = IdentifiedNormalForm(form, np.diag((spread * scale) ** 2))
    fold = form.nonlinear_critical_speed
    assert fold is not None
    chance, width = [], []
    for speed in (fold + 0.001, fold - 0.001):
        detector = HuntingDetector(LATERAL, known)
        row = detect(detector, steady(450e-6, form.frequency_hz, speed, 3.0)).estimates[-1]
        chance.append(row['escape_probability'])
        width.append(row['margin_high'] - row['margin_low'])
    assert chance[0] == pytest.approx(chance[1], abs=0.05)
    assert width[1] >= width[0], 'where the spread is not known nothing is known better'


def test_a_steady_motion_at_another_frequency_than_the_form_gives_is_no_hunting() -> None:
    detector = HuntingDetector(LATERAL, PAPER)
    output = detect(detector, steady(0.12e-3, 4.6, 6.0, 60.0))
    assert not any(event.level is Level.ERROR for event in output.events)
    assert detector.status.state in (State.QUIET, State.DISTURBED)
    assert detector.status.level is Level.WARN, 'it is in doubt what it is'
    assert any(
        re.search(r'not the hunting.* 4\.[56]\d* .*Hz.* 2\.8\d* Hz', reason)
        for reason in detector.status.reasons
    )


@pytest.mark.parametrize('hertz', [2.1, 2.84, 3.8], ids='{} Hz'.format)
def test_a_steady_motion_that_may_be_the_hunting_of_worn_wheels_is_hunting(hertz: float) -> None:
    detector = HuntingDetector(LATERAL, PAPER)
    assert 'limit_cycle' in words(detect(detector, steady(0.4e-3, hertz, 6.0, 30.0)))


def test_a_steady_motion_smaller_than_any_limit_cycle_of_the_form_is_in_doubt() -> None:
    detector = HuntingDetector(LATERAL, PAPER)
    output = detect(detector, steady(0.12e-3, 2.84, 6.0, 30.0))
    assert not any(event.level is Level.ERROR for event in output.events)
    assert detector.status.level is Level.WARN


def test_a_motion_that_is_not_the_hunting_is_not_it_where_the_speed_is_silent_either() -> None:
    wrong = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        record = steady(rng.uniform(0.03e-3, 0.2e-3), rng.uniform(1.5, 4.6), rng.uniform(3, 6), 20)
        t = (record['speed'].stamps_ns - record.start_ns) * 1e-9
        silent = (t > rng.uniform(2.0, 10.0)) & (t < 15.0)
        speed = Series(record['speed'].stamps_ns[~silent], record['speed'].values[~silent])
        events = detect(HuntingDetector(LATERAL, PAPER), Record({**record, 'speed': speed})).events
        wrong += [(seed, event) for event in events if event.level is Level.ERROR][:1]
    assert not wrong


def test_a_rig_that_names_its_frequency_needs_none_of_the_form() -> None:
    detector = HuntingDetector(replace(LATERAL, hunting_frequency_hz=5.0), PAPER)
    assert 'limit_cycle' in words(detect(detector, steady(0.4e-3, 5.0, 6.0, 30.0)))


def test_hunting_that_goes_on_at_another_frequency_is_hunting() -> None:
    detector = HuntingDetector(LATERAL, PAPER)
    t = (np.arange(12000) + 1) / 200.0
    size = 0.4e-3 * np.exp(-0.6 * np.clip(t - 20.0, 0.0, None))
    turn = np.where(t < 21.3, np.cos(2.0 * np.pi * 2.84 * t), np.cos(2.0 * np.pi * 4.6 * t))
    values = np.where(t < 21.3, size, 0.3e-3) * turn
    values += 5e-6 * np.random.default_rng(0).standard_normal(t.size)
    detect(detector, record_of(t, lateral=values, speed=6.0))
    assert detector.status.state is State.LIMIT_CYCLE
