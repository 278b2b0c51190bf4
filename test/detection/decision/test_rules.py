"""The thresholds of the decisions, for any rig."""

from __future__ import annotations

import math

import pytest

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.decision.rules import Rules, rows_of, rules_of


def _rules(hunting_hz: float, rows_hz: float) -> Rules:
    config = DetectorConfig(hunting_frequency_hz=hunting_hz, output_rate_hz=rows_hz)
    return rules_of(config, math.nan, math.nan)


def test_every_hold_lasts_as_many_periods_on_every_rig() -> None:
    slow, half, fast = _rules(2.5, 250.0), _rules(5.0, 250.0), _rules(10.0, 1000.0)
    assert slow.step == fast.step == pytest.approx(2 * half.step, abs=1)
    for seconds in (0.02, 0.1, 0.5, 1.0, 20.0):
        assert rows_of(fast, seconds) == rows_of(slow, seconds) > 0
        assert rows_of(slow, seconds) == pytest.approx(2 * rows_of(half, seconds), abs=1)
