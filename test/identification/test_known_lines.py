"""The normal form without the roller's angle: its lines follow from the speed."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from made import record_of, rig_settings, stamps_of, up_and_down, without
from scipy.stats import chi2

from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import DriveModel, simulate
from hunt_ros.errors import ConfigError
from hunt_ros.identification import IdentificationSettings, identify
from hunt_ros.identification.record.channels import channels_of
from hunt_ros.identification.record.turning import follow_lines, with_angle
from hunt_ros.samples import Record, Series

#: Of the roller: one a seed, m. Nobody tells it, its line does.
DIAMETERS = 0.3, 0.15, 0.2
#: The speed reads half a per cent too high, and the critical speed with it.
TRUTH = 1.005 * 8.0


def _staircase(seed: int) -> Record:
    drive = DriveModel(speed_gain=1.005, speed_noise=0.01)
    settings = rig_settings(200.0, 1.5e-5, (5e-5,), drive=drive)
    rig = replace(paper_rig(), roller_diameter_m=DIAMETERS[seed])
    return simulate(rig, settings, up_and_down(np.arange(5.6, 9.01, 0.3), 10.0), seed=seed)


@pytest.mark.slow
def test_staircases_without_the_rollers_angle_tell_as_much_as_with_it() -> None:
    off = []
    for seed, diameter in enumerate(DIAMETERS):
        record = _staircase(seed)
        bare = identify(without(record, 'roller'))
        by_line = re.search(r'a roller of (\S+) m by its line', '; '.join(bare.warnings))
        assert float(by_line[1]) == pytest.approx(diameter, rel=0.02)
        known, found = identify(record).v_c, bare.v_c
        # The samples are the same: only the angle of the lines is another.
        assert found.std < 1.3 * known.std, seed
        assert abs(found.value - known.value) < known.std, seed
        # Some of what a short hold leaves is no spread: not known better than by 0.05 m/s.
        off.append((found.value - TRUTH) / max(0.05, found.std))
    # One correct run in a thousand is beyond this.
    assert np.square(off).sum() < chi2.ppf(0.999, len(off))


@pytest.mark.parametrize('scale', [1.0, 1.006, 0.992])
def test_the_angle_follows_the_lines(scale: float) -> None:
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 120.0, 0.005)
    angle = 40.0 * time + 0.2 * time**2
    signal = 1e-4 * np.cos(angle) + 1e-3 * np.cos(17.8 * time) + 1e-5 * rng.normal(size=time.size)
    got = follow_lines(time, signal, scale * angle, np.array([1.0, 2.0]))
    off = got - angle
    assert np.ptp(off) < 0.5  # of 43 rad for 0.6 %
    alone = follow_lines(time, 1e-5 * rng.normal(size=time.size), scale * angle, np.array([1.0]))
    np.testing.assert_allclose(alone, scale * angle, rtol=0.03)


@pytest.mark.parametrize('sense', [1.0, -1.0])
@pytest.mark.parametrize('running', [6.0, -6.0])
@pytest.mark.parametrize('pulses', [0, 6])
def test_the_angle_of_a_record_is_continuous_and_forward(
    sense: float, running: float, pulses: int
) -> None:
    step = 0.17
    angle = np.mod(sense * step * np.arange(1000), 2.0 * np.pi)
    if pulses:
        angle = np.floor(angle * pulses / (2.0 * np.pi)) * 2.0 * np.pi / pulses
    record = record_of(0.01 * np.arange(1000), lateral=0.0, speed=running, roller=angle)
    got = channels_of(with_angle(record, IdentificationSettings())).roller
    # A coarse encoder tells its angle to within a sample.
    off = got - got[0] - step * np.arange(1000)
    assert np.ptp(off[20:-20]) < (1.5 * step if pulses else 1e-9)


@pytest.mark.parametrize('rate_hz', [5.0, 10.0])
@pytest.mark.parametrize('diameter_m', [0.0, 0.3])
def test_an_encoder_that_wraps_between_two_readings_is_unwrapped_by_the_speed(
    rate_hz: float, diameter_m: float
) -> None:
    time = np.arange(0.0, 120.0, 0.01)
    speed = 6.0 + 0.02 * time
    angle = np.cumsum(speed) * 0.01 / 0.15
    every = round(100.0 / rate_hz)
    read = Series(stamps_of(time[::every]), -np.mod(angle[::every], 2.0 * np.pi))
    record = Record({**record_of(time, lateral=0.0, speed=1.003 * speed), 'roller': read})
    got = with_angle(record, IdentificationSettings(roller_diameter_m=diameter_m))['roller']
    off = np.abs(got.values - got.values[0]) - (angle[::every] - angle[0])
    assert np.ptp(off) < 1e-6


def test_an_impossible_line_is_refused() -> None:
    with pytest.raises(ConfigError, match='lines'):
        IdentificationSettings(lines=(1.0, -1.0))
    with pytest.raises(ConfigError, match='roller_diameter_m'):
        IdentificationSettings(wheel_diameter_m=0.07)
