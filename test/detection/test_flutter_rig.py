"""Recordings of a real rig with the same bifurcation, all with one configuration."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, State, detect
from hunt_ros.detection.offline import collect, watch
from hunt_ros.samples import Record, Series

FOLDER = Path(__file__).parents[3] / 'shared' / 'data' / 'flutter_rig'
FILES = sorted(FOLDER.glob('*.mat'))
CYCLES = [path for path in FILES if 'Hammer' not in path.name]
HITS = [path for path in FILES if 'Hammer' in path.name]

pytestmark = pytest.mark.skipif(not FILES, reason=f'no recordings in {FOLDER}')


def _record(path: Path) -> Record:
    """Heave as y (m), pitch as psi (rad); airspeed as speed, from the file's name."""
    pitch, heave = loadmat(path)['data'][:2]
    stamps = np.arange(heave.size, dtype=np.int64) * 4_000_000
    found = re.search(r'_V(\d+)', path.name)
    assert found is not None
    speed = np.full(heave.size // 10, int(found[1]) / 10.0)
    return Record(
        {
            'lateral': Series(stamps, 0.47 * heave),
            'yaw': Series(stamps, pitch),
            'speed': Series(stamps[: speed.size * 10 : 10], speed),
        },
        path.name,
    )


@pytest.fixture(scope='module')
def detector() -> HuntingDetector:
    # A wing has no roller: no line follows the speed of the air.
    return HuntingDetector(DetectorConfig(channels=('lateral', 'yaw', 'speed'), lines=()))


def _half_range(values: np.ndarray) -> float:
    return 0.5 * float(values.max() - values.min())


@pytest.mark.parametrize('path', CYCLES, ids=lambda path: path.stem[9:])
def test_a_limit_cycle_is_found_with_its_amplitude(path: Path, detector: HuntingDetector) -> None:
    record = _record(path)
    detector.reset()
    rows = detect(detector, record).estimates
    middle = (rows['stamp_ns'] >= 12_000_000_000) & (rows['stamp_ns'] < 24_000_000_000)
    values = record['lateral'].between(12_000_000_000, 24_000_000_000).values
    amplitude = float(np.median(rows['lateral_amplitude'][middle]))
    assert amplitude == pytest.approx(_half_range(values), rel=0.05)
    assert detector.status.state is State.LIMIT_CYCLE
    assert detector.status.level is Level.ERROR
    # Once found it is not lost again.
    found = np.flatnonzero(rows['state'] == State.LIMIT_CYCLE)[0]
    assert (rows['state'][found:] == State.LIMIT_CYCLE).all()
    assert rows['stamp_ns'][found] < 15_000_000_000


@pytest.mark.parametrize('path', HITS, ids=lambda path: path.stem[9:])
def test_hits_that_grow_alarm_and_hits_that_decay_do_not(
    path: Path, detector: HuntingDetector
) -> None:
    record = _record(path)
    detector.reset()
    words = [event.event for event in detect(detector, record).events]
    values = record['lateral'].values
    hunts = _half_range(values[-500:]) > 10e-3  # smallest limit cycle of the rig: 21 mm
    if hunts:
        assert detector.status.alarm
        assert detector.status.level is Level.ERROR
    else:
        # One of them lingers near the unstable cycle for seconds before it decays.
        assert words == []
        assert not detector.status.alarm


@pytest.mark.parametrize('path', HITS, ids=lambda path: path.stem[9:])
def test_a_hit_that_grows_alarms_before_long(path: Path, detector: HuntingDetector) -> None:
    record = _record(path)
    values = record['lateral'].values
    if _half_range(values[-500:]) < 10e-3:
        pytest.skip('it decays')
    detector.reset()
    alarm = next(event for event in detect(detector, record).events if event.level is Level.ERROR)
    largest = np.maximum.accumulate(np.abs(values - np.median(values)))
    grown = record['lateral'].stamps_ns[int(np.argmax(largest > 0.8 * largest[-1]))]
    assert alarm.stamp_ns - grown < 13_000_000_000  # some 35 periods


@pytest.mark.parametrize('path', HITS, ids=lambda path: path.stem[9:])
def test_the_largest_amplitude_is_that_of_the_motion(
    path: Path, detector: HuntingDetector
) -> None:
    record = _record(path)
    detector.reset()
    found = collect(watch(record, detector)).summary
    values = record['lateral'].values
    # A hit decays within the first period: the half range of that is less than its maximum.
    least = max(_half_range(values[k : k + 100]) for k in range(0, values.size, 50))
    assert 0.7 * least < found.max_amplitude_m < np.abs(values - np.median(values)).max()
