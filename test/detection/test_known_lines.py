"""Lines that the roller forces are no hunting, however little is known of its angle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from made import changed, forced_mode, held, record_of, rig_settings, without

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.detector import HuntingDetector
from hunt_ros.detection.offline import config_for
from hunt_ros.detection.replay import detect
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import Kick, simulate
from hunt_ros.dynamics.simulation.settings import DriveModel, Roughness
from hunt_ros.samples import Record


def _quiet(
    speed=6.0, diameter=0.3, rate=200.0, wheel=(), kicks=(), seconds=60.0, rough=3e-4, **drive
):
    """Quiet running over strong roughness of the roller."""
    rig = replace(paper_rig(), roller_diameter_m=diameter)
    settings = replace(
        rig_settings(rate, initial_speed=speed, drive=DriveModel(**drive)),
        roughness=Roughness((rough,), wheel_amplitudes=wheel, reference_speed=speed),
    )
    return simulate(rig, settings, held(speed), seconds, kicks, seed=1)


def _run(record: Record, form=None, **settings):
    config, _ = config_for(record, DetectorConfig(**settings))
    detector = HuntingDetector(config, form)
    return detector, detect(detector, record)


@pytest.mark.parametrize(
    ('speed', 'diameter', 'rate', 'gain'),
    [(6.0, 0.3, 200.0, 1.0), (6.2, 0.3, 100.0, 1.005), (5.0, 0.4, 200.0, 0.995)],
)
def test_no_alarm_in_quiet_running_where_only_the_speed_is_known(
    speed, diameter, rate, gain, true_form
) -> None:
    record = _quiet(speed, diameter, rate, speed_gain=gain, speed_noise=0.01)
    told = {} if diameter == 0.3 else {'roller_diameter_m': diameter}
    for form in (None, true_form):
        detector, output = _run(without(record, 'roller'), form, **told)
        assert not detector.status.alarm
        assert not output.events
        # The angle would have told the line apart no better than by a factor of two.
        late = output.estimates['lateral_amplitude'][1000:]
        known = _run(record, form)[1].estimates['lateral_amplitude'][1000:]
        assert np.sqrt(np.mean(late**2)) < 2.0 * np.sqrt(np.mean(known**2))


def test_a_limit_cycle_is_told_where_only_the_speed_is_known() -> None:
    record = _quiet(7.2, kicks=[Kick(15.0, lateral_m=700e-6)], seconds=30.0, rough=1e-4)
    detector, output = _run(without(record, 'roller'))
    assert detector.status.alarm
    at = [event.stamp_ns * 1e-9 for event in output.events if event.event == 'limit_cycle']
    assert at
    assert 14.0 < at[0] < 28.0


@pytest.mark.parametrize('reading', ['wraps', 'backwards', 'wraps backwards'])
def test_an_encoder_that_wraps_or_runs_backwards_tells_the_same(reading) -> None:
    record = _quiet(seconds=30.0)
    roller = record['roller']
    angle = -roller.values if 'backwards' in reading else roller.values
    if 'wraps' in reading:
        angle = np.mod(angle, 2.0 * np.pi)
    other = changed(record, roller=angle)
    expected, got = (_run(r)[1].estimates for r in (record, other))
    late = slice(300, None)
    for name in ('lateral_amplitude', 'lateral_roughness'):
        np.testing.assert_allclose(got[name][late], expected[name][late], rtol=0.02, atol=2e-7)
    assert (got['roller_wrong'] == expected['roller_wrong']).all()
    assert (got['speed_wrong'] == expected['speed_wrong']).all()


@pytest.mark.parametrize('sense', [1.0, -1.0])
def test_six_pulses_a_turn_tell_the_line_as_a_fine_encoder_does(sense) -> None:
    record = _quiet(seconds=30.0, speed_gain=1.01)
    roller = record['roller']
    step = np.pi / 3.0
    angle = np.floor(sense * roller.values / step) * step
    other = changed(record, roller=angle)
    expected, got = (_run(r)[1].estimates['lateral_amplitude'][300:] for r in (record, other))
    assert np.sqrt(np.mean(got**2)) < 1.3 * np.sqrt(np.mean(expected**2))
    assert got.max() < 1.5 * expected.max()


def test_the_line_of_the_wheel_is_known_by_its_diameter() -> None:
    record = _quiet(rate=500.0, wheel=(2e-4,), seconds=30.0)
    rig = paper_rig()
    wheel = {'wheel_diameter_m': 2.0 * rig.wheel_radius_m}
    roller = {'roller_diameter_m': rig.roller_diameter_m}
    plain, known = (
        _run(record, **told)[1].estimates['lateral_amplitude_std'][1000:]
        for told in (roller, roller | wheel)
    )
    # What is not known is noise to the filter.
    assert np.nanmedian(known) < 0.7 * np.nanmedian(plain)


def test_an_assumed_diameter_never_makes_a_line_of_the_hunting() -> None:
    # 2.84 Hz would be the line of a roller of 0.3 m at this speed.
    time = np.arange(1, 8001) / 200.0
    rng = np.random.default_rng(0)
    hunts = np.where(time > 20.0, 5e-4, 1e-6) * np.cos(2.0 * np.pi * 2.84 * time)
    lateral = hunts + 5e-6 * rng.standard_normal(time.size)
    record = record_of(time, lateral=lateral, speed=2.84 * np.pi * 0.3)
    detector, output = _run(record)
    assert detector.status.alarm
    late = output.estimates['lateral_amplitude'][-500:]
    np.testing.assert_allclose(late, 5e-4, rtol=0.03)


def test_a_tachometer_that_scatters_frees_no_line_to_take_the_hunting() -> None:
    time = np.arange(1, 10001) / 500.0
    rng = np.random.default_rng(0)
    lateral = 5e-4 * np.cos(2.0 * np.pi * 2.84 * time) + 5e-6 * rng.standard_normal(time.size)
    turns = 2.4 * time  # a line beside the hunting
    lateral += 3e-5 * np.cos(2.0 * np.pi * turns)
    read = 7.0 * (1.0 + 0.01 * rng.standard_normal(time.size))
    record = record_of(time, lateral=lateral, roller=2.0 * np.pi * turns, speed=read)
    late = _run(record)[1].estimates[-1000:]
    np.testing.assert_allclose(late['lateral_amplitude'], 5e-4, rtol=0.05)


def _begins(ratio: float, cycle: float, line: float, seed: int, seconds: float) -> float:
    """Return when a limit cycle is said, s, of motion of so many mm from the first sample on."""
    rng = np.random.default_rng([3, seed])
    time = np.arange(1, round(200.0 * seconds)) / 200.0
    turns, (own, other, yaw) = 2.84 * ratio * time, np.exp(2j * np.pi * rng.random(3))
    wanders = 1.0 + 0.01 * forced_mode(rng, time.size, 0.005, 1.0, 1.0).real
    hunts = cycle * own * wanders + 0.01 * forced_mode(rng, time.size, 0.005, 1.0, 1.0)
    hunts *= np.exp(2j * np.pi * 2.84 * time)
    forced = line * other * np.exp(2j * np.pi * turns)
    lateral = (hunts + forced).real + 0.005 * rng.standard_normal(time.size)
    yaws = (6.0 * np.exp(1.2j) * hunts + 3.0 * yaw * forced).real
    yaws += 0.03 * rng.standard_normal(time.size)
    record = record_of(
        time, lateral=1e-3 * lateral, yaw=1e-3 * yaws, roller=2.0 * np.pi * turns, speed=7.0
    )
    output = _run(record, hunting_frequency_hz=2.84, lines=(1.0,))[1]
    said = (event.stamp_ns * 1e-9 for event in output.events if event.event == 'limit_cycle')
    return next(said, math.inf)


def test_a_cycle_from_the_start_is_said_beside_a_line_that_is_not_there() -> None:
    # The filter shares it out between hunting and line at first, and follows their beat.
    near = (0.9, 0.95, 1.05, 1.1)
    found = [_begins(near[seed % 4], 1.0, 0.0, seed // 4, 35.0) for seed in range(48)]
    assert np.mean(np.array(found) < 30.0) > 0.95


@pytest.mark.parametrize('line', [0.1, 0.3, 1.0])
def test_a_line_from_the_start_is_no_limit_cycle(line: float) -> None:
    for seed in range(20):
        assert math.isinf(_begins(0.9 + 0.05 * (seed % 5), 0.0, line, seed, 35.0)), seed
