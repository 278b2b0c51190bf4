"""The second opinion agrees with the filter at any rate of the rows, and with noise as it is."""

from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.detection import DetectorConfig, HuntingDetector, State, detect
from hunt_ros.detection.decision import doubts
from hunt_ros.errors import ConfigError
from hunt_ros.samples import Record, Series


def disagreement(frequency_hz: float, rows_hz: float, rate_hz: float, noise: float) -> float:
    """Return the share of the rows after ten seconds of a steady motion that disagree."""
    t = (np.arange(round(30.0 * rate_hz)) + 1) / rate_hz
    rng = np.random.default_rng(2)
    values = 1e-3 * np.cos(2.0 * np.pi * frequency_hz * t) + noise * rng.standard_normal(t.size)
    config = DetectorConfig(
        channels=('lateral',),
        output_rate_hz=rows_hz,
        hunting_frequency_hz=frequency_hz,
    )
    detector = HuntingDetector(config)
    record = Record({'lateral': Series(np.round(t * 1e9).astype(np.int64), values)})
    rows = detect(detector, record).estimates
    late = rows['stamp_ns'] > 10e9
    assert detector.status.state is State.LIMIT_CYCLE
    return float(((rows['doubts'][late] & doubts.DISAGREE) != 0).mean())


@pytest.mark.parametrize(
    ('frequency_hz', 'rows_hz', 'rate_hz'),
    [
        (2.84, 100.0, 1000.0),
        (30.0, 100.0, 1000.0),
        (2.84, 20.0, 20.0),
        # The mean over a row takes a quarter off the amplitude.
        (4.0, 10.0, 200.0),
        (7.6, 20.0, 200.0),
    ],
)
def test_a_steady_motion_is_agreed_on(frequency_hz: float, rows_hz: float, rate_hz: float) -> None:
    assert disagreement(frequency_hz, rows_hz, rate_hz, 2e-5) == 0.0


@pytest.mark.parametrize('rate', [1.0, 2.0, 3.0, 7.0])
def test_rows_too_slow_for_the_hunting_are_refused(rate: float) -> None:
    with pytest.raises(ConfigError, match='output_rate_hz'):
        DetectorConfig(output_rate_hz=rate)
    slow = DetectorConfig(output_rate_hz=rate, hunting_frequency_hz=0.38 * rate)
    HuntingDetector(slow)
