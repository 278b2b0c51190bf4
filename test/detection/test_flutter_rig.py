"""Recordings of a real rig with the same bifurcation, all with one configuration."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from made import FLUTTER, record_of
from scipy.io import loadmat

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, State
from hunt_ros.detection.offline import Findings, collect
from hunt_ros.detection.output import Output
from hunt_ros.detection.replay import watch
from hunt_ros.detection.words.status import DetectorStatus
from hunt_ros.samples import Record

FILES = sorted(FLUTTER.glob('*.mat'))
CYCLES = [path for path in FILES if 'Hammer' not in path.name]
HITS = [path for path in FILES if 'Hammer' in path.name]

pytestmark = pytest.mark.skipif(not FILES, reason=f'no recordings in {FLUTTER}')


def _record(path: Path) -> Record:
    """Heave as y (m), pitch as psi (rad); airspeed as speed, from the file's name."""
    pitch, heave = loadmat(path)['data'][:2]
    speed = float(path.name.split('_V')[1][:3]) / 10.0
    t = np.arange(heave.size) / 250.0
    return record_of(t, path.name, lateral=0.47 * heave, yaw=pitch, speed=speed)


@cache
def _detected(path: Path) -> tuple[Record, Output, Findings, DetectorStatus]:
    """Return the record of a file and what the detector said of it."""
    record, outputs = _record(path), []

    def listen() -> Iterator[Output]:
        for output in watch(record, detector):
            outputs.append(output)
            yield output

    # A wing has no roller: no line follows the speed of the air.
    detector = HuntingDetector(DetectorConfig(channels=('lateral', 'yaw', 'speed'), lines=()))
    found = collect(listen(), detector)
    return record, Output.joined(outputs), found, detector.status


def _half_range(values: np.ndarray) -> float:
    return 0.5 * float(values.max() - values.min())


@pytest.mark.parametrize('path', CYCLES, ids=lambda path: path.stem[9:])
def test_a_limit_cycle_is_found_with_its_amplitude(path: Path) -> None:
    record, output, _, status = _detected(path)
    rows = output.estimates
    middle = (rows['stamp_ns'] >= 12_000_000_000) & (rows['stamp_ns'] < 24_000_000_000)
    values = record['lateral'].between(12_000_000_000, 24_000_000_000).values
    amplitude = float(np.median(rows['lateral_amplitude'][middle]))
    assert amplitude == pytest.approx(_half_range(values), rel=0.05)
    assert status.state is State.LIMIT_CYCLE
    assert status.level is Level.ERROR
    # Once found it is not lost again.
    found = np.flatnonzero(rows['state'] == State.LIMIT_CYCLE)[0]
    assert (rows['state'][found:] == State.LIMIT_CYCLE).all()
    assert rows['stamp_ns'][found] < 15_000_000_000


@pytest.mark.parametrize('path', HITS, ids=lambda path: path.stem[9:])
def test_hits_that_grow_alarm_before_they_have_grown_and_hits_that_decay_do_not(path) -> None:
    record, output, _, status = _detected(path)
    values = record['lateral'].values
    if _half_range(values[-500:]) < 10e-3:  # smallest limit cycle of the rig: 21 mm
        # One of them lingers near the unstable cycle for seconds before it decays.
        assert output.events == ()
        assert not status.alarm
        return
    assert status.alarm
    assert status.level is Level.ERROR
    alarm = next(event for event in output.events if event.level is Level.ERROR)
    size = np.abs(values - np.median(values))
    grown = np.flatnonzero(size > 0.9 * _half_range(values[-500:]))[0]
    assert alarm.stamp_ns < record['lateral'].stamps_ns[grown]


@pytest.mark.parametrize('path', HITS, ids=lambda path: path.stem[9:])
def test_the_largest_amplitude_is_that_of_the_motion(path: Path) -> None:
    record, _, found, _ = _detected(path)
    values = record['lateral'].values
    # A hit decays within the first period: the half range of that is less than its maximum.
    least = max(_half_range(values[k : k + 100]) for k in range(0, values.size, 50))
    assert 0.7 * least < found.max_amplitude_m < np.abs(values - np.median(values)).max()
