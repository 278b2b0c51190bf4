"""An ordinary day of a rig: starts, restarts, poor and contradicting sensors; rates over seeds."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from made import changed, held

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, State, detect, health
from hunt_ros.detection.output import Output
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Corners, Profile
from hunt_ros.dynamics.simulation import simulate
from hunt_ros.dynamics.simulation.settings import SensorModel, SimulationSettings

#: Critical speeds for a motion that is below both of them.
BELOW = {'critical_speed_mps': 20.0, 'nonlinear_critical_speed_mps': 15.0}


def seconds_of(output: Output, level: Level) -> float:
    return 0.01 * float(np.count_nonzero(output.estimates['level'] == level))


def said(output: Output, *words: str, after_s: float = 0.0) -> list[float]:
    """Return when one of these events was said, s."""
    times = [e.stamp_ns * 1e-9 for e in output.events if e.event in words]
    return [time for time in times if time >= after_s]


def driven(recorded, form, times, speeds, seeds: int, **more) -> list[Output]:
    """Return what is said of a drive through these corners (s, m/s), with several seeds."""
    profile = Profile((Corners(times, speeds),))
    records = [recorded(profile, times[-1], seed=seed, **more) for seed in range(seeds)]
    return [detect(HuntingDetector(normal_form=form), record) for record in records]


@pytest.mark.parametrize('lines', [(20e-6,), (50e-6, 20e-6)])
@pytest.mark.parametrize('rate', [0.05, 0.1, 0.2, 0.5])
def test_a_run_up_below_v_n_is_no_alarm(recorded, true_form, lines, rate) -> None:
    # A line that passes the frequency of the hunting changes tenfold on the way.
    end = 5.0 + 5.5 / rate
    times, speeds = (0.0, 5.0, end, end + 40.0), (0.5, 0.5, 6.0, 6.0)
    for output in driven(recorded, true_form, times, speeds, 2, roughness=lines):
        assert seconds_of(output, Level.ERROR) == 0.0


@pytest.mark.parametrize('rate', [0.3, 0.6, 1.5])
def test_a_stop_out_of_quiet_running_is_no_alarm(recorded, true_form, rate) -> None:
    # The line of the roller passes the frequency of the hunting at 2.7 m/s on every way to rest.
    ends = 30.0 + 5.0 / rate
    times, speeds = (0.0, 30.0, ends, ends + 20.0), (5.0, 5.0, 0.0, 0.0)
    for output in driven(recorded, true_form, times, speeds, 3):
        assert seconds_of(output, Level.ERROR) == 0.0


@pytest.mark.parametrize('rate', [0.05, 0.3, 1.5])
def test_a_roller_that_sets_off_is_not_stuck(recorded, rate) -> None:
    end = 10.0 + 3.0 / rate
    (output,) = driven(recorded, None, (0.0, 10.0, end, end + 5.0), (0.0, 0.0, 3.0, 3.0), 1)
    assert not said(output, 'sensor_fault')


@pytest.mark.parametrize('hunting_hz', [0.4, 0.8])
def test_a_roller_of_a_slow_rig_that_sets_off_is_not_stuck(recorded, hunting_hz) -> None:
    record = recorded(Profile((Corners((0.0, 10.0, 20.0, 25.0), (0.0, 0.0, 3.0, 3.0)),)), 25.0)
    config = DetectorConfig(hunting_frequency_hz=hunting_hz)
    assert not said(detect(HuntingDetector(config), record), 'sensor_fault')


def test_what_hunted_is_over_when_the_roller_has_come_to_rest(recorded, true_form) -> None:
    times, speeds = (0.0, 20.0, 30.0, 60.0), (8.6, 8.6, 0.0, 0.0)
    for form in (true_form, None):
        (output,) = driven(recorded, form, times, speeds, 1, roughness=(), kicks=[(5.0, 800e-6)])
        rows = output.estimates
        assert (rows['state'][rows['stamp_ns'] < 20e9] == State.LIMIT_CYCLE).any()
        assert (rows['state'][rows['stamp_ns'] > 38e9] <= State.DISTURBED).all()


@pytest.mark.parametrize('begin', [0.0, 0.1])
@pytest.mark.parametrize('informed', [True, False])
def test_what_drives_the_motion_at_rest_is_not_what_drives_it_at_speed(
    recorded, true_form, begin, informed
) -> None:
    form = true_form if informed else None
    times, speeds = (0.0, 30.0, 65.0, 150.0), (begin, begin, 7.0, 7.0)
    for output in driven(recorded, form, times, speeds, 2, roughness=()):
        assert seconds_of(output, Level.ERROR) == 0.0
        assert not (output.estimates['state'] == State.DECAYING).any()


def test_after_hunting_it_gets_quiet_again_at_another_speed(recorded, true_form) -> None:
    times, speeds = (0.0, 20.0, 40.0, 60.0, 80.0, 130.0), (0.0, 0.0, 8.6, 8.6, 6.0, 6.0)
    for form in (true_form, None):
        (output,) = driven(recorded, form, times, speeds, 1, roughness=())
        rows = output.estimates
        late = rows['stamp_ns'] > 100e9
        assert (rows['state'][late] <= State.DISTURBED).mean() > 0.99


@pytest.mark.parametrize('speed', [7.0, 7.4, 7.6, 8.6])
def test_a_detector_that_begins_in_a_limit_cycle_that_beats_says_so(recorded, speed) -> None:
    # A line makes it beat by 5 %: over half a second that is noise, over eight it is not.
    record = recorded(speed, 110.0, kicks=[(0.05, 800e-6)], roughness=(50e-6,))
    output = detect(HuntingDetector(DetectorConfig(**BELOW)), record)
    assert said(output, 'limit_cycle')
    assert seconds_of(output, Level.OK) < 3.0, 'nor is it well while that is not decided'


def test_a_kick_seconds_after_the_start_is_not_taken_for_noise(recorded) -> None:
    late = []
    for seed, (speed, at) in enumerate(itertools.product((6.8, 7.2, 7.6), (4.3, 5.0, 7.0))):
        record = recorded(speed, at + 6.0, [(at, 2.4e-3)], seed, roughness=(20e-6,))
        told = said(detect(HuntingDetector(), record), 'escaping', 'limit_cycle')
        late.append(min(told, default=math.inf) - at)
    assert np.median(late) < 2.0
    assert max(late) < 5.0


@pytest.mark.parametrize('told', ['nothing', 'the truth', 'a v_c that is too high'])
def test_what_hunts_seconds_after_a_run_up_is_said_whatever_the_form_says(
    recorded, true_form, told
) -> None:
    late = replace(true_form, form=replace(true_form.form, critical_speed=12.0))
    form = {'nothing': None, 'the truth': true_form}.get(told, late)
    delays = []
    runs = itertools.product((7.2, 7.4, 7.8, 8.2), (1.0, 3.0, 5.0))
    for seed, (speed, waits) in enumerate(runs):
        profile = Profile((Corners((0.0, 2.0, speed - 3.0), (5.0, 5.0, speed)),))
        at = speed - 3.0 + waits
        record = recorded(profile, at + 12.0, [(at, 2e-3)], seed, roughness=(20e-6,))
        output = detect(HuntingDetector(normal_form=form), record)
        delays.append(min(said(output, 'escaping', 'limit_cycle'), default=math.inf) - at)
        rows = output.estimates
        assert rows['level'][rows['stamp_ns'] * 1e-9 > at + 1.0].min() > Level.OK
    assert np.median(delays) < 4.5
    assert np.count_nonzero(np.array(delays) < 8.0) >= 11


def test_what_escapes_after_a_kick_does_not_die_out_in_the_limit_cycle(
    recorded, true_form
) -> None:
    escaped = 0
    for seed in range(12):
        record = recorded(7.2, 40.0, kicks=[(20.0, 350e-6)], seed=seed)
        output = detect(HuntingDetector(normal_form=true_form), record)
        if cycle := said(output, 'limit_cycle'):
            escaped += 1
            assert not said(output, 'decaying', after_s=cycle[0])
    assert escaped > 6


def test_what_lingers_just_below_the_fold_is_no_limit_cycle(recorded, true_form) -> None:
    # It falls by less than the least damping of a rig, and the form says so.
    speed = 0.997 * true_form.form.nonlinear_critical_speed
    for seed in range(2):
        record = recorded(speed, 40.0, kicks=[(20.0, 0.7e-3)], seed=seed, roughness=(20e-6,))
        assert not said(detect(HuntingDetector(normal_form=true_form), record), 'limit_cycle')


@pytest.mark.parametrize('broadband', [8e-7, 2e-6, 4e-6])
@pytest.mark.parametrize('informed', [True, False])
def test_steps_of_the_sensor_are_no_limit_cycle(true_form, broadband, informed) -> None:
    settings = SimulationSettings(
        broadband=broadband, lateral_sensor=SensorModel(resolution=10e-6)
    )
    for seed in range(6):
        record = simulate(paper_rig(), settings, held(7.2), duration_s=60.0, seed=seed)
        config = DetectorConfig(channels=('lateral', 'roller', 'speed'))
        output = detect(HuntingDetector(config, true_form if informed else None), record)
        assert seconds_of(output, Level.ERROR) == 0.0


@pytest.mark.parametrize('speed', [5.0, 7.0])
@pytest.mark.parametrize('hz', [4.0, 8.0, 10.0, 16.0])
def test_a_limit_of_the_lab_is_on_what_the_sensor_reads(recorded, true_form, speed, hz) -> None:
    record = recorded(speed, 25.0, roughness=())
    series = record['lateral']
    t = series.stamps_ns * 1e-9
    motion = np.where(t > 20.0, 5e-3 * np.sin(2.0 * math.pi * hz * t), 0.0)
    config = DetectorConfig(warn_lateral_mm=1.0, alarm_lateral_mm=3.0)
    detector = HuntingDetector(config, true_form)
    output = detect(detector, changed(record, lateral=series.values + motion))
    error = output.estimates['stamp_ns'][output.estimates['level'] == Level.ERROR] * 1e-9
    assert 20.0 < error[0] < 20.5
    assert detector.status.level is Level.ERROR
    assert any('measured lateral displacement' in e.cause for e in output.events)


@pytest.mark.parametrize('dead_from', [0.0, 30.0])
@pytest.mark.parametrize('form', ['true_form', 'shaped', None])
def test_a_lateral_sensor_that_has_lost_its_signal_hides_no_hunting(
    recorded, request, form, dead_from
) -> None:
    record = recorded(7.2, 60.0, kicks=[(20.0, 350e-6)])
    series = record['lateral']
    noise = 5e-6 * np.random.default_rng(0).normal(size=series.values.size)
    values = np.where(series.stamps_ns >= dead_from * 1e9, noise, series.values)
    known = dead_from > 0.0 or form == 'shaped'
    form = None if form is None else request.getfixturevalue(form)
    rows = detect(HuntingDetector(normal_form=form), changed(record, lateral=values)).estimates
    late, last = rows['stamp_ns'] > 24e9, rows['stamp_ns'] > 55e9
    assert not (rows['level'][late] == Level.OK).any()
    # Where nothing tells how yaw and lateral go together, yaw is judged from the kick on.
    assert (rows['level'][late if known else last] == Level.ERROR).all()


@pytest.mark.parametrize('speed', [6.0, 7.2])
def test_a_rig_whose_sensors_lose_their_targets_is_not_quiet(recorded, true_form, speed) -> None:
    """What is left is their noise, and what hunts from 30 s on is seen by none of them."""
    record, rng = recorded(speed, 40.0, kicks=[(30.0, 1e-3)]), np.random.default_rng(0)
    lost = {
        name: np.where(
            record[name].stamps_ns >= 25e9,
            noise * rng.normal(size=record[name].values.size),
            record[name].values,
        )
        for name, noise in (('lateral', 5e-6), ('yaw', 2e-5))
    }
    detector = HuntingDetector(normal_form=true_form)
    rows = detect(detector, changed(record, **lost)).estimates
    gone = (rows['lateral_wrong'] & health.LOST) != 0
    assert not gone[rows['stamp_ns'] < 25e9].any()
    assert gone[rows['stamp_ns'] > 29e9].all()
    assert (rows['level'][gone] == Level.STALE).all()
    assert 'lateral: shows nothing any more, not even the roller' in detector.status.reasons
    rows = detect(HuntingDetector(normal_form=true_form), record).estimates
    assert not ((rows['lateral_wrong'] | rows['yaw_wrong']) & health.LOST).any()


#: What a lab does to its two sensors, on readings in m and rad.
MISTAKES = {
    'gain': lambda y, psi: (0.7 * y, psi),
    'half': lambda y, psi: (0.5 * y, psi),
    'millimetres': lambda y, psi: (1e3 * y, psi),
    'sign': lambda y, psi: (y, -psi),
    'degrees': lambda y, psi: (y, np.degrees(psi)),
    'yaw gain': lambda y, psi: (y, 0.7 * psi),
    'swapped': lambda y, psi: (psi, y),
}


@pytest.mark.parametrize('mistake', MISTAKES)
def test_sensors_that_contradict_the_mode_shape_are_not_believed(
    recorded, shaped, mistake
) -> None:
    record = recorded(7.2, 60.0, kicks=[(20.0, 200e-6), (40.0, 350e-6)])
    y, psi = MISTAKES[mistake](record['lateral'].values, record['yaw'].values)
    detector = HuntingDetector(normal_form=shaped)
    rows = detect(detector, changed(record, lateral=y, yaw=psi)).estimates
    late = rows['stamp_ns'] > 30e9
    assert not (rows['level'][late] == Level.OK).any()
    if mistake != 'degrees':  # by which the quiet motion is larger than any limit cycle
        assert (rows['level'][rows['stamp_ns'] > 48e9] == Level.ERROR).all(), 'it hunts'
    # Half and degrees go into the second mode, whose own ratio nobody knows.
    if mistake not in ('half', 'degrees'):
        assert any('contradict each other' in reason for reason in detector.status.reasons)
    rows = detect(HuntingDetector(normal_form=shaped), record).estimates
    assert rows['doubts'][rows['stamp_ns'] > 5e9].max() < 16384, 'those that are right are'
