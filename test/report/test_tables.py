"""The tables show every number of the document, and every null as not known."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest

from hunt_ros.report import listings, tables
from hunt_ros.report.figures.overview import RunEvent
from hunt_ros.report.numbers import rounded
from hunt_ros.report.result import Result

Document = Callable[..., dict[str, Any]]

DATA = re.compile(r'<data value="([^"]+)" data-key="([^"]+)">(.*?)</data>', re.DOTALL)


def everything(result: Result) -> str:
    return ''.join(
        show(result)
        for show in (
            tables.critical_speeds,
            tables.coefficients,
            tables.fit_quality,
            listings.steady_states,
            listings.branches,
            listings.unknowns,
        )
    )


def test_every_number_shown_is_the_number_of_the_document(document: Document) -> None:
    result = Result(document())
    shown = DATA.findall(everything(result))
    assert len(shown) > 60
    for value, key, _ in shown:
        assert float(value) == result.value(key), key


def test_every_quantity_of_the_document_is_shown(document: Document) -> None:
    result = Result(document())
    keys = {key.removesuffix('.value') for _, key, _ in DATA.findall(everything(result))}
    wanted = {'v_c', 'v_n', 'hysteresis_width', 'length_scale_m', 'time_scale_s'}
    wanted |= {f'coefficients.{name}' for name in ('D1', 'D4', 'D7', 'D10', 'D15')}
    wanted |= {f'four_point.{name}' for name in ('D4', 'D7', 'D10', 'D15', 'condition_number')}
    wanted |= {f'observed.{name}' for name in ('v_c', 'v_n', 'hysteresis_width', 'step_mps')}
    wanted |= {f'fit.{name}' for name in ('segments', 'residual_rms_m', 'condition_number')}
    wanted |= {f'steady_states.{k}.amplitude_m' for k in range(30)}
    assert wanted <= keys


def test_a_number_is_printed_rounded_to_its_uncertainty(document: Document) -> None:
    entries = document()
    text = tables.coefficients(Result(entries))
    for name, entry in entries['coefficients'].items():
        shown = rounded(entry['value'], entry['std'], tuple(entry['ci95']))
        assert shown.html() in text, name
        assert shown.interval_html() in text, name


def test_the_paper_stands_beside_it_as_published(document: Document) -> None:
    text = tables.coefficients(Result(document()))
    for published in ('0.12', '2030', '−0.06', '−360', '−4.2 × 10<sup>7</sup>'):
        assert f'<td>{published}</td>' in text


@pytest.mark.parametrize(
    'path',
    [
        'v_c', 'v_n', 'hysteresis_width', 'criticality', 'four_point',
        'coefficients.D1', 'coefficients.D15',
        'observed.v_c', 'observed.v_n', 'observed.step_mps',
        'fit.method', 'fit.lack_of_fit', 'fit.residual_rms_m',
        'steady_states.3.amplitude_m', 'steady_states.3.cycles',
    ],
)  # fmt: skip
def test_a_null_is_shown_as_not_known_with_its_reason(document: Document, path: str) -> None:
    entries = document() | {'warnings': []}
    entries['warnings'] = [f'{path}: <cannot> be told from these data & that is why']
    place: Any = entries
    *parents, last = path.split('.')
    for key in parents:
        place = place[int(key) if key.isdecimal() else key]
    place[last] = None
    result = Result(entries)
    text = everything(result)
    assert f'data-key="{path}">not known: ' in text
    assert f'<code>{path}</code>' in listings.unknowns(result)
    assert 'None' not in text
    assert 'nan' not in text
    assert '<cannot>' not in text  # a warning is text, not markup


def test_a_missing_uncertainty_is_said(document: Document) -> None:
    entries = document()
    entries['v_c']['std'] = entries['v_c']['ci95'] = None
    text = tables.critical_speeds(Result(entries))
    assert 'data-key="v_c.std">not known: ' in text
    assert 'data-key="v_c.ci95">not known: ' in text


def test_every_null_is_listed_once_under_its_reason(document: Document) -> None:
    result = Result(document())
    listed = re.findall(r'<code>([^<]+)</code>', listings.unknowns(result))
    wanted = [unknown.path for unknown in result.unknowns()]
    assert len(wanted) > 5  # branches end somewhere
    # The first of a long list stands in its summary too.
    assert set(listed) == set(wanted)


def test_nothing_unknown_is_said_as_such() -> None:
    assert 'every quantity' in listings.unknowns(Result({'v_c': {'value': 1.0}}))


def test_events_stand_in_the_order_of_time_with_what_is_not_known() -> None:
    events = [
        RunEvent(12.3456, 'hysteresis_entered', 'WARN', 6.41, 2.5e-5, None, 'a & b'),
        RunEvent(20.0, 'limit_cycle', 'ERROR', None, 6.5e-4, 0.02, 'a & b'),
    ]
    text = listings.events(events)
    assert text.index('hysteresis entered') < text.index('limit cycle')
    assert '12.35' in text
    assert '0.0250' in text
    assert text.count('not known') == 2
    assert 'a &amp; b' in text
    assert 'level-ERROR' in text
    assert 'none' in listings.events([])


def test_an_empty_document_says_not_known_everywhere_and_fails_nowhere() -> None:
    text = everything(Result({}))
    assert 'not known' in text
    assert DATA.findall(text) == []


def test_the_paper_does_not_stand_beside_another_rig(document: Document) -> None:
    larger = {**document(), 'length_scale_m': 0.1}
    faster = document()
    for state in faster['steady_states']:
        state['speed_mps'] += 17.0
    for entries in (larger, faster):
        text = tables.coefficients(Result(entries)) + tables.critical_speeds(Result(entries))
        assert 'paper' not in text
        assert '<td>2030</td>' not in text
    assert 'paper' in tables.critical_speeds(Result(document()))


def test_where_a_scale_is_not_the_rigs_own_stands_beside_it(document: Document) -> None:
    entries = document() | {'scales_from': {'length': 'rig of the paper', 'time': 'given'}}
    text = tables.fit_quality(Result(entries))
    assert re.search(r'data-key="length_scale_m">[^<]*</data>[^<]*\(rig of the paper\)', text)
    assert re.search(r'data-key="time_scale_s">[^<]*</data>[^<]*\(given\)', text)
