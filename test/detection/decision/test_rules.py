"""The thresholds of the decisions, for any rig."""

from __future__ import annotations

import math

import pytest

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.decision.rules import Rules, rules_of

#: Counts of rows, which are times; the horizon of the outlook is one on the clock.
HOLDS = [name for name in Rules._fields if name.endswith('_hold')] + [
    'margin_restore', 'floor_rows', 'mark', 'step'
]  # fmt: skip


def _rules(hunting_hz: float, rows_hz: float) -> Rules:
    config = DetectorConfig(hunting_frequency_hz=hunting_hz, output_rate_hz=rows_hz)
    return rules_of(config, math.nan, math.nan)


@pytest.mark.parametrize('name', HOLDS)
def test_every_hold_lasts_as_many_periods_on_every_rig(name: str) -> None:
    slow, fast = _rules(2.5, 250.0), _rules(10.0, 1000.0)
    assert getattr(fast, name) == getattr(slow, name) > 0
    half = _rules(5.0, 250.0)
    share = getattr(half, name) / getattr(slow, name)
    assert share == pytest.approx(0.5, abs=0.5 / getattr(slow, name) + 1e-9)
