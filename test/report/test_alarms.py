"""The alarms of a recording, counted as the standards of alarm systems count them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hunt_ros.detection import Event
from hunt_ros.detection.regions import Level
from hunt_ros.report.alarms import AlarmLoad, alarm_table, load_of
from hunt_ros.samples import NANOSECONDS, Record, Series

_START = 1_700_000_000 * NANOSECONDS


def counted(*told: tuple[float, str, str], length_s: float = 3600.0) -> AlarmLoad:
    """Return the load of events (s, event, level), with 'TEST CAUSE' behind the event's word."""
    stamps = _START + np.array([0, round(length_s * NANOSECONDS)], dtype=np.int64)
    record = Record({'speed': Series(stamps, np.zeros(2))}, 'run <1>')
    events = []
    for at_s, words, level in told:
        event, test, cause = (*words.split(' ', 2), '-', '-')[:3]
        stamp_ns = _START + round(at_s * NANOSECONDS)
        events.append(Event(stamp_ns, event, Level[level], stamp_ns, test, cause))
    return load_of(events, record, True)


HUNTS = [(10.0, 'escaping', 'ERROR'), (12.0, 'limit_cycle', 'ERROR'), (20.0, 'decaying', 'ERROR'),
         (22.0, 'limit_cycle', 'ERROR'), (30.0, 'quiet', 'OK')]  # fmt: skip


@pytest.mark.parametrize(
    ('told', 'alarms'),
    [
        pytest.param([], {}, id='none'),
        pytest.param(HUNTS, {'hunting': [(10.0, 30.0)]}, id='what is still on is no other alarm'),
        pytest.param(
            [(1.0, 'escaping', 'ERROR'), (1.1, 'interlock_tripped', 'ERROR')],
            {'hunting': [(1.0, math.inf)], 'trip': [(1.1, math.inf)]},
            id='a trip calls, too',
        ),
        pytest.param(
            [(1.0, 'limit_exceeded warn_yaw_mrad', 'ERROR'), (2.0, 'margin_low', 'WARN')],
            {},
            id='a warning beside an alarm calls nobody',
        ),
        pytest.param(
            [(1.0, 'limit_exceeded alarm_yaw_mrad', 'ERROR'),
             (2.0, 'limit_cleared alarm_yaw_mrad', 'OK')],
            {'alarm_yaw_mrad': [(1.0, 2.0)]},
            id='a limit by its name',
        ),
        pytest.param(
            [(1.0, 'input_stale timeout yaw: silent for 0.2 s', 'STALE'),
             (2.0, 'sensor_fault sensor lateral: stuck', 'STALE'),
             (3.0, 'input_recovered timeout yaw is back', 'OK')],
            {'yaw_silent': [(1.0, 3.0)], 'lateral_fault': [(2.0, math.inf)]},
            id='each channel by itself',
        ),
        pytest.param(
            [(1.0, 'input_stale timeout yaw: silent, but it is optional', 'OK')], {},
            id='a channel that may be missing',
        ),
        pytest.param(
            [(3599.0, 'input_stale timeout speed: silent for 0.2 s', 'STALE')], {},
            id='the nodes end one after the other',
        ),
        pytest.param([(5.0, 'quiet', 'OK')], {}, id='what was on before is not of it'),
    ],
)  # fmt: skip
def test_an_alarm_begins_once_and_ends(told, alarms) -> None:
    assert counted(*told).alarms == alarms


@pytest.mark.parametrize(('third_s', 'chatters'), [(60.0, True), (60.1, False)])
def test_three_times_within_a_minute_chatters(third_s: float, chatters: bool) -> None:
    times = (0.0, 20.0, third_s)
    told = [each for at in times
            for each in ((at, 'escaping', 'ERROR'), (at + 1.0, 'quiet', 'OK'))]  # fmt: skip
    load = counted(*told)
    assert load.count == 3
    assert load.chattering == (['hunting'] if chatters else [])


@pytest.mark.parametrize(
    ('count', 'low', 'high'), [(0, 0.0, 3.689), (1, 0.02532, 5.572), (10, 4.795, 18.39)]
)
def test_the_rate_has_the_exact_interval_of_a_count(count: int, low: float, high: float) -> None:
    """Garwood's (1936) table, for one hour."""
    told = []
    for began_s in 100.0 * np.arange(count):
        told += [(began_s, 'escaping', 'ERROR'), (began_s + 9.0, 'quiet', 'OK')]
    rate = counted(*told).per_hour
    assert rate.value == pytest.approx(count)
    assert (rate.low, rate.high) == pytest.approx((low, high), rel=1e-3)


def test_the_table_names_what_chatters_what_stands_and_what_is_on_at_the_end() -> None:
    day = counted((10.0, 'sensor_fault sensor yaw: stuck', 'STALE'), length_s=86_500.0)
    assert day.to_json()['on_at_end'] == ['yaw_fault']
    assert day.longest_s == pytest.approx(86_490.0)
    text = alarm_table([day, counted()])
    assert '<b>standing</b>' in text
    assert text.count('<b>standing</b>') == 1
    assert 'run &lt;1&gt;' in text


def test_a_recording_without_length_has_no_rate() -> None:
    assert counted(length_s=0.0).to_json()['per_hour'] is None
