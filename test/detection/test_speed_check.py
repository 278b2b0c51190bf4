"""A speed that contradicts the roller angle is named; what only looks like it is not."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made import PAPER, changed
from scipy.signal import lfilter

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level
from hunt_ros.detection.replay import detect
from hunt_ros.detection.slow import SpeedCheck
from hunt_ros.dynamics.profile import Corners, Profile

RATE = 100.0
#: Corners (s, m/s) of runs that a lab drives.
DRIVES = [
    ((0.0, 7.2), (60.0, 7.2)),
    ((0.0, 4.0), (40.0, 8.8), (60.0, 8.8), (70.0, 4.0)),
    ((0.0, 0.0), (5.0, 0.0), (25.0, 7.0), (60.0, 7.0)),
    ((0.0, 0.0), (5.0, 0.0), (90.0, 1.5), (120.0, 8.0), (130.0, 8.0)),  # a slow start
    ((0.0, 8.0), (20.0, 8.0), (24.0, 0.0), (40.0, 0.0), (50.0, 8.0), (60.0, 8.0)),  # stopped
    ((0.0, 5.0), (20.0, 5.0), (20.5, 6.0), (40.0, 6.0), (40.5, 7.0), (60.0, 7.0)),  # steps
]


def _drive(
    corners: tuple[tuple[float, float], ...], diameter: float = 0.3
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stamps, roller angle and speed of a drive."""
    times, speeds = np.transpose(corners)
    t = np.arange(round(times[-1] * RATE) + 1) / RATE
    v = np.interp(t, times, speeds)
    turned = np.concatenate(([0.0], np.cumsum((v[1:] + v[:-1]) / RATE / diameter)))
    return np.round(t * 1e9).astype(np.int64), turned, v


def _late(v: np.ndarray, lag_s: float) -> np.ndarray:
    """Return the speed behind a first-order filter."""
    gain = 1.0 / (lag_s * RATE)
    return np.asarray(lfilter([gain], [1.0, gain - 1.0], v, zi=[(1.0 - gain) * v[0]])[0])


@settings(max_examples=60, deadline=None)
@given(
    drive=st.sampled_from(DRIVES),
    diameter=st.floats(0.02, 2.0),
    resolution=st.sampled_from([0.0, 0.01, 0.1, 0.2]),
    lag_s=st.sampled_from([0.02, 0.2, 0.5]),
    noise=st.floats(0.0, 0.1),
    jitter_s=st.sampled_from([0.0, 1e-3, 3e-3]),
    lines=st.sampled_from([0, 64, 4096]),
    backwards=st.booleans(),
    told=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_sound_sensors_never_contradict_each_other(
    drive, diameter, resolution, lag_s, noise, jitter_s, lines, backwards, told, seed
) -> None:
    rng = np.random.default_rng(seed)
    stamps, angle, true = _drive(drive, diameter)
    speed = _late(true, lag_s) + noise * rng.normal(size=true.size)
    if resolution:
        speed = resolution * np.round(speed / resolution)
    angle = angle + np.gradient(angle) * RATE * jitter_s * rng.normal(size=angle.size)
    if lines:
        count = 2.0 * math.pi / lines
        angle = count * np.floor(angle / count)
    if backwards:
        angle = -angle
    check = SpeedCheck(DetectorConfig(roller_diameter_m=diameter if told else 0.0))
    found = check.update(stamps, angle, np.maximum(speed, 0.0))
    assert not found.any(), f'at {stamps[np.argmax(found)] * 1e-9:.2f} s'


@settings(max_examples=60, deadline=None)
@given(
    diameter=st.floats(0.02, 2.0),
    stuck_s=st.floats(0.0, 30.0),
    resolution=st.sampled_from([0.0, 0.2]),
    told=st.booleans(),
    noise=st.sampled_from([0.0, 0.02]),
    slope=st.sampled_from([0.01, 0.02, 0.2, -0.05]),
)
def test_a_stuck_speed_is_named_and_recovers(
    diameter, stuck_s, resolution, told, noise, slope
) -> None:
    duration = 2.5 / abs(slope)
    corners = ((0.0, 5.0), (30.0, 5.0), (30.0 + duration, 5.0 + slope * duration))
    corners += ((60.0 + duration, corners[-1][1]), (90.0 + duration, 5.0), (120 + duration, 5.0))
    corners += ((130.0 + duration, 8.0), (140.0 + duration, 8.0))  # at last both move again
    stamps, angle, true = _drive(corners, diameter)
    t = stamps * 1e-9
    freed = 50.0 + duration  # while the roller turns at another speed than the one it sticks at
    stuck = (t >= stuck_s) & (t < freed)
    speed = np.where(stuck, 5.0, true) + noise * np.random.default_rng(1).normal(size=t.size)
    if resolution:
        speed = resolution * np.round(speed / resolution)
    check = SpeedCheck(DetectorConfig(roller_diameter_m=diameter if told else 0.0))
    found = check.update(stamps, angle, speed)
    apart = np.abs(true - speed) > 2.0 * (0.3 + 0.05 * 7.5)
    wrong = stuck & apart
    first = int(np.flatnonzero(wrong)[0])
    assert found[wrong & (t > t[first] + 4.0)].all()
    assert not found[t < 30.0].any()
    assert not found[-int(2 * RATE) :].any(), 'both move together again: it has recovered'


def test_a_speed_that_reads_zero_while_the_roller_turns_is_named_without_any_ratio() -> None:
    stamps, angle, true = _drive(((0.0, 7.0), (20.0, 7.0)))
    found = SpeedCheck(DetectorConfig()).update(stamps, angle, np.zeros_like(true))
    assert found[400:].all()


def test_another_roller_may_be_mounted_at_standstill() -> None:
    run = ((0.0, 0.0), (3.0, 0.0), (20.0, 7.0), (30.0, 7.0), (40.0, 0.0), (45.0, 0.0))
    check = SpeedCheck(DetectorConfig())
    stamps, angle, speed = _drive(run, 0.3)
    assert not check.update(stamps, angle, speed).any()
    _, other, speed = _drive(run, 0.5)
    later = stamps + stamps[-1] + 10_000_000
    assert not check.update(later, other, speed).any()


@settings(max_examples=20, deadline=None)
@given(cuts=st.lists(st.integers(0, 7000), max_size=8))
def test_blocks_and_whole_give_the_same(cuts: list[int]) -> None:
    stamps, angle, speed = _drive(DRIVES[1])
    speed = np.where(stamps > 20_000_000_000, 6.0, speed)
    whole = SpeedCheck(DetectorConfig()).update(stamps, angle, speed)
    assert whole.any()
    check = SpeedCheck(DetectorConfig())
    edges = [0, *sorted(cuts), stamps.size]
    parts = [
        check.update(stamps[a:b], angle[a:b], speed[a:b]) for a, b in itertools.pairwise(edges)
    ]
    assert np.concatenate(parts).tobytes() == whole.tobytes()


@pytest.mark.parametrize('lines', [(1.0, 2.0), ()])
def test_the_detector_is_stale_and_says_why(lines: tuple[float, ...], recorded) -> None:
    profile = Profile((Corners((0.0, 10.0, 20.0, 30.0, 40.0), (4.0, 4.0, 6.0, 6.0, 4.0)),))
    record = recorded(profile, 48.0)
    speed = record['speed']
    t = speed.stamps_ns * 1e-9
    spoilt = np.where((t > 8.0) & (t < 34.0), 4.0, speed.values)
    config = DetectorConfig(lines=lines)
    sound = detect(HuntingDetector(config, PAPER), record)
    assert not [event for event in sound.events if event.event == 'sensor_fault']
    detector = HuntingDetector(config, PAPER)
    output = detect(detector, changed(record, speed=spoilt))
    rows = output.estimates
    t = rows['stamp_ns'] * 1e-9
    assert (rows['level'][(t > 18.0) & (t < 34.0)] == Level.STALE).all()
    assert rows['level'][-1] != Level.STALE
    causes = [(event.event, event.cause.split(';')[0]) for event in output.events]
    faults = [cause for word, cause in causes if word == 'sensor_fault']
    assert faults == ['speed: contradicts the roller angle by more than 0.3 m/s for 2 s']
    (over,) = (cause for word, cause in causes if word == 'sensor_recovered')
    assert over.startswith('speed: no fault is left after ')
