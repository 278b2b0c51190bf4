"""The tables show every number of the identification, and what is not known with its reason."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import pytest
from made import numbers
from report_made import identification_of

from hunt_ros.detection import Event
from hunt_ros.detection.regions import Level
from hunt_ros.identification.result import Identification
from hunt_ros.report import tables, words
from hunt_ros.report.numbers import interval, shown
from hunt_ros.samples import Record, Series, Uncertain

DATA = re.compile(r'<data value="([^"]+)">(.*?)</data>', re.DOTALL)


def everything(one: Identification) -> str:
    return ''.join(
        show(one)
        for show in (
            tables.critical_speeds, tables.coefficients, tables.fit_quality,
            tables.steady_states, tables.unknowns, words.lead,
            words.disturbance,
        )
    )  # fmt: skip


def test_every_number_shown_is_a_number_of_the_json_and_every_quantity_is_shown() -> None:
    one = identification_of()
    text = everything(one)
    values = {float(value) for value, _ in DATA.findall(text)}
    assert values <= set(numbers(one.to_json()))
    for name in ('v_c', 'v_n', 'hysteresis_width', 'D1', 'D4', 'D7', 'D10', 'D15', 'frequency_hz',
                 'disturbance'):  # fmt: skip
        assert one.quantity(name).value in values, name
        assert shown(one.quantity(name), 1e3 if name == 'disturbance' else 1.0) in text
    assert interval(one.quantity('D15')) in text
    assert {state.amplitude for state in one.steady_states} <= values
    four, fit, seen = one.four_point, one.fit, one.observed
    wanted = {four.D4, four.D15, four.condition_number, fit.segments, fit.residual_rms, seen.v_c,
              seen.v_n, seen.hysteresis_width, seen.step}  # fmt: skip
    assert wanted <= values


def test_the_paper_stands_beside_its_own_rig_as_published() -> None:
    text = tables.coefficients(identification_of())
    for published in ('0.12', '2030', '−0.06', '−360', '−4.2 × 10<sup>7</sup>'):
        assert f'<td>{published}</td>' in text
    one = identification_of()
    faster = [replace(state, speed=state.speed + 17.0) for state in one.steady_states]
    for other in (identification_of(length_scale=0.1), identification_of(steady_states=faster)):
        text = tables.coefficients(other) + tables.critical_speeds(other)
        assert 'paper' not in text
        assert '<td>2030</td>' not in text


@pytest.mark.parametrize(
    ('key', 'fields'),
    [
        ('v_c', {'v_c': None}),
        ('v_n', {'v_n': None}),
        ('criticality', {'criticality': None}),
        ('four_point', {'four_point': None}),
        ('coefficients.D15', {'coefficients': {'D1': Uncertain(0.1, 0.01)}}),
        ('disturbance_m', {'disturbance': None}),
    ],
)
def test_what_is_not_known_is_shown_with_its_reason_and_listed(
    key: str, fields: dict[str, Any]
) -> None:
    reason = '<cannot> be told from these data & that is why'
    text = everything(identification_of(**fields, unknown={key: reason}))
    escaped = '&lt;cannot&gt; be told from these data &amp; that is why'
    assert f'not known: {escaped}' in text
    assert f'<code>{key}</code>' in text
    assert text.count(escaped) >= 2
    for word in ('None', 'nan', '<cannot>'):
        assert word not in text


def test_a_missing_uncertainty_is_said() -> None:
    one = identification_of(v_c=Uncertain(8.0, math.nan, math.nan, math.nan))
    assert 'uncertainty not known' in tables.critical_speeds(one)


def test_nothing_unknown_is_said_as_such() -> None:
    assert 'every quantity' in tables.unknowns(replace(identification_of(), unknown={}))


def test_events_stand_in_the_order_of_time_with_what_is_not_known() -> None:
    record = Record({'speed': Series([1, 2], [6.0, 6.0])}, 'a & b')
    events = [
        Event(
            12_345_600_001, 'hysteresis_entered', Level.WARN, 0, '', '', '',
            {'speed_mps': 6.41, 'amplitude_m': 2.5e-5},
        ),
        Event(
            20_000_000_001, 'limit_cycle', Level.ERROR, 0, '', '', '',
            {'amplitude_m': 6.5e-4, 'growth_rate_per_s': 0.02},
        ),
    ]  # fmt: skip
    text = tables.events({'a & b': events}, [record])
    assert text.index('entered the hysteresis') < text.index('LIMIT CYCLE')
    assert '12.35' in text
    assert '0.0250' in text
    assert text.count('not known') == 2
    assert 'a &amp; b' in text
    assert 'level-ERROR' in text
    assert 'none' in tables.events({}, [record])


def test_where_a_scale_is_not_the_rigs_own_stands_beside_it() -> None:
    text = tables.fit_quality(identification_of())
    assert re.search(r'0\.0485\d*</data> \(rig of the paper\)', text)
    assert re.search(r'</data> \(given\)', text)
