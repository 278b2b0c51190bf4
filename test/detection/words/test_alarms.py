"""The history of the alarms: when, why, how large, and who acknowledged."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from fed import Moving
from made import SECOND

from hunt_ros.detection.output import Output
from hunt_ros.detection.regions import State
from hunt_ros.detection.words.alarms import KEPT, AlarmHistory
from hunt_ros.samples import Series

CYCLE_M = 630e-6


def episode(rig: Moving, start_s: float = 0.0) -> Output:
    """Move for 25 s: quiet, growth to the limit cycle at 7.2 m/s, its decay below v_n."""
    t = np.arange(5000) / 200.0
    grown = np.minimum(20e-6 * np.exp(np.maximum(t - 3.0, 0.0)), CYCLE_M)
    amplitude = np.where(t < 10.0, grown, np.maximum(CYCLE_M * np.exp(-0.8 * (t - 10.0)), 2e-6))
    begun = len(rig.outputs)
    rig.move(amplitude, np.where(t < 10.0, 7.2, 6.0), start_s=start_s)
    return Output.joined(rig.outputs[begun:])


def test_an_alarm_is_kept_with_its_cause_its_size_and_who_acknowledged() -> None:
    moving = Moving()
    rig, events = moving.detector, episode(moving).events
    (alarm,) = rig.history.alarms
    escape, over = (next(e for e in events if e.event == word) for word in ('escaping', 'quiet'))
    assert (alarm.began_ns, alarm.decided_ns) == (escape.since_ns, escape.stamp_ns)
    assert (alarm.cause, alarm.test) == (escape.cause, escape.test)
    assert alarm.reached == 'limit_cycle'
    assert alarm.over_ns == over.stamp_ns
    assert alarm.highest_amplitude_m == pytest.approx(CYCLE_M, rel=0.05)
    assert not alarm.acknowledged_by
    hours = (alarm.over_ns - alarm.decided_ns) / (3600.0 * SECOND)
    assert rig.history.hunting_hours == pytest.approx(hours, rel=0.01)

    (said,) = rig.acknowledge(26 * SECOND, 'Mia').events
    assert 'by Mia' in said.cause
    episode(moving, 30.0)
    (said,) = rig.acknowledge(56 * SECOND).events
    assert 'by unknown' in said.cause
    first, second = rig.history.alarms
    assert (first.acknowledged_by, first.acknowledged_ns) == ('Mia', 26 * SECOND)
    assert (second.acknowledged_by, second.acknowledged_ns) == ('unknown', 56 * SECOND)
    told = json.loads(rig.history.to_text())
    assert told['alarm_count'] == 2
    assert told['since_s'] < 1.0
    assert [each['acknowledged_by'] for each in told['alarms']] == ['Mia', 'unknown']
    assert told['alarms'][1]['began_s'] == second.began_ns / SECOND
    assert told['highest_amplitude_m'] == max(
        first.highest_amplitude_m, second.highest_amplitude_m
    )
    assert told['highest_yaw_amplitude_rad'] is None
    assert rig.status.values['alarm_count'] == told['alarm_count']


def test_blocks_and_a_replay_do_not_change_the_history() -> None:
    whole, rig = Moving(), Moving()
    parted = rig.detector
    episode(whole)
    for part in np.array_split(np.arange(5000), 173):
        for name, series in whole.record.items():
            rig.feed(name, Series(series.stamps_ns[part], series.values[part]))
    assert parted.history.to_text() == whole.detector.history.to_text()
    rig.outputs.append(parted.acknowledge(26 * SECOND, 'Mia'))
    before = list(parted.history.alarms)
    episode(rig, 100.0)
    assert list(parted.history.alarms)[:1] == before
    assert parted.history.count == 2
    again = rig.assert_replayed()
    assert again.history.to_text() == parted.history.to_text()
    again.reset()
    assert not again.history.alarms


def test_what_hunts_again_in_the_row_after_an_acknowledgement_is_another_alarm() -> None:
    output = episode(Moving())
    escape = next(event for event in output.events if event.event == 'escaping')
    rows = output.estimates[output.estimates['stamp_ns'] >= escape.stamp_ns][:1].repeat(3)
    rows['stamp_ns'] += 10_000_000 * np.arange(3)
    rows['state'][1] = State.DECAYING  # latched still
    again = replace(escape, stamp_ns=int(rows['stamp_ns'][2]))
    history = AlarmHistory(10_000_000)
    history.update(rows[:2], [escape])
    history.acknowledge(int(rows['stamp_ns'][1]), 'Mia')
    history.update(rows[2:], [again])
    assert history.count == 2
    assert history.codes == ['escaping']


def _cycles(rig: Moving, amplitude_m: float, seconds: float = 8.0) -> list[str]:
    """Go on with a limit cycle; return the codes of the status."""
    rig.move(np.full(round(200.0 * seconds), amplitude_m))
    return str(rig.detector.status.values['causes']).split()


@pytest.mark.parametrize('acknowledged', [True, False])
def test_a_limit_that_is_exceeded_in_a_limit_cycle_is_kept_with_its_code(
    acknowledged: bool,
) -> None:
    """In `measure` a limit cycle calls nobody: what is latched beside it must be told."""
    rig = Moving(alarm_lateral_mm=0.7)
    rig.move(np.minimum(20e-6 * np.exp(np.arange(2400) / 200.0), CYCLE_M))
    if acknowledged:
        rig.outputs.append(rig.detector.acknowledge(by='Mia'))
    assert _cycles(rig, CYCLE_M) == ['limit_cycle']
    assert _cycles(rig, 0.8e-3) == ['limit_cycle', 'alarm_lateral_mm']
    assert _cycles(rig, 0.5e-3) == ['limit_cycle', 'alarm_lateral_mm'], 'over, and latched'
    assert rig.detector.history.count == 1 + acknowledged
    last = rig.detector.history.alarms[-1]
    assert last.test.startswith('alarm_') is acknowledged
    rig.outputs.append(rig.detector.acknowledge(by='Mia'))
    assert _cycles(rig, 0.5e-3) == ['limit_cycle']
    assert not rig.detector.history.codes
    rig.assert_replayed()


def test_hunting_that_begins_above_a_limit_that_was_acknowledged_is_kept_with_its_code() -> None:
    rig = Moving(alarm_lateral_mm=0.001)
    rig.move(np.full(1000, 20e-6))
    rig.outputs.append(rig.detector.acknowledge(by='Mia'))
    rig.move(np.minimum(20e-6 * np.exp(np.arange(2400) / 200.0), CYCLE_M))
    assert rig.detector.status.alarm
    assert rig.detector.history.codes == ['limit_cycle']


def test_the_oldest_alarms_go_and_the_totals_stay() -> None:
    rig = Moving()
    output = episode(rig)
    history = AlarmHistory(rig.detector.config.period_ns)
    for _ in range(KEPT + 3):
        history.update(output.estimates, output.events)
    assert len(history.alarms) == KEPT
    assert history.count == KEPT + 3
    assert history.hunting_hours == pytest.approx((KEPT + 3) * rig.detector.history.hunting_hours)


def test_a_history_that_begins_at_stamp_zero_says_so() -> None:
    rows = episode(Moving()).estimates[:20]
    rows['stamp_ns'] -= rows['stamp_ns'][0]
    history = AlarmHistory(10_000_000)
    for row in np.array_split(rows, 20):
        history.update(row, ())
    assert history.to_json()['since_s'] == 0.0
