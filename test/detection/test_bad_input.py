"""What bad input leaves of the detection: one sensor, a clipped one, reverse, other clocks."""

from __future__ import annotations

import numpy as np
import pytest
from made import PAPER, changed

from hunt_ros.detection import HuntingDetector, Level, State, detect, health


def test_a_clipped_limit_cycle_is_saturated_and_still_an_alarm(recorded) -> None:
    record = recorded(7.2, 10.0, kicks=[(1.5, 500e-6)])
    limit = 0.6 * float(np.abs(record['lateral'].values).max())  # of the sensor, all the time
    clipped = changed(record, lateral=lambda y: np.clip(y, -limit, limit))
    detector = HuntingDetector(normal_form=PAPER)
    rows = detect(detector, clipped).estimates
    during = rows[rows['stamp_ns'] > 5_600_000_000]
    assert np.isin(during['state'], [State.ESCAPING, State.LIMIT_CYCLE]).all()
    assert ((during['lateral_wrong'] & health.SATURATED) != 0).all()
    assert detector.status.alarm


def test_a_rig_that_runs_in_reverse_hunts_as_it_does_ahead_and_the_status_says_so(
    recorded, true_form
) -> None:
    record = recorded(7.2, 20.0, kicks=[(9.0, 330e-6)])
    detector = HuntingDetector(normal_form=true_form)
    reverse = detect(detector, changed(record, speed=np.negative, roller=np.negative))
    ahead = detect(HuntingDetector(normal_form=true_form), record)
    assert 'speed: negative: the rig runs in reverse' in detector.status.reasons
    assert detector.status.number('speed_mps') == pytest.approx(7.2, abs=0.05)
    assert Level.STALE not in reverse.estimates['level']
    for name in ('speed', 'lateral_amplitude', 'lateral_roughness', 'margin'):
        assert np.allclose(
            reverse.estimates[name], ahead.estimates[name], rtol=1e-3, atol=1e-7, equal_nan=True
        ), name
    events = [[(event.event, event.stamp_ns) for event in one.events] for one in (reverse, ahead)]
    assert events[0] == events[1]
