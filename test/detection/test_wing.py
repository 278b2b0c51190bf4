"""A real wing that rests, is kicked by hand, and cycles at the same speeds."""

from __future__ import annotations

import numpy as np
import pytest
from made import FLUTTER, record_of
from scipy.signal import butter, hilbert, sosfiltfilt

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, detect

FILES = sorted((FLUTTER.parent / 'wing').glob('*.npz'))
RATE_HZ, HUNTING_HZ = 201.03, 4.0
#: By eye: every kick dies out up to this speed, m/s, and from the second on one stays; a cycle
#: there has more than this amplitude, m.
DIES_MPS, STAYS_MPS, CYCLE_M = 16.4, 18.0, 12e-3

pytestmark = pytest.mark.skipif(not FILES, reason='the wing is not on this machine')


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_it_hunts_where_a_kick_stays_and_not_where_kicks_die_out(path) -> None:
    given = np.load(path)
    t, lateral, speed = (given[name].astype(float) for name in ('t', 'lateral', 'speed'))
    record = record_of(t, path.name, lateral=lateral, yaw=given['yaw'], speed=speed)
    config = DetectorConfig(
        channels=('lateral', 'yaw', 'speed'), lines=(), hunting_frequency_hz=HUNTING_HZ
    )
    rows = detect(HuntingDetector(config), record).estimates
    row = np.searchsorted(rows['stamp_ns'], np.round(t * 1e9)) - 1
    hunts = rows['level'][np.maximum(row, 0)] == Level.ERROR
    band = butter(3, (2.5, 6.0), 'bandpass', fs=RATE_HZ, output='sos')
    runs = np.flatnonzero(np.diff(t) > 1.0) + 1
    for run in np.split(np.arange(t.size), runs):
        if speed[run].mean() < DIES_MPS:  # 10 to 15 kicks in each
            assert np.count_nonzero(hunts[run]) < 2.0 * RATE_HZ
        elif speed[run].mean() > STAYS_MPS:
            cycles = np.abs(hilbert(sosfiltfilt(band, lateral[run]))) > CYCLE_M
            assert np.mean(hunts[run][cycles]) > 0.9
            assert np.count_nonzero(np.diff(hunts[run].astype(int)) < 0) <= 1
