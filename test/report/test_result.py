"""Every null of a document is found, and gets the best reason there is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.report.result import Result

Document = Callable[..., dict[str, Any]]

json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=3),
    lambda below: (
        st.lists(below, max_size=3)
        | st.dictionaries(st.text('abc', min_size=1, max_size=3), below, max_size=3)
    ),
    max_leaves=12,
)


def count_nulls(entry: Any) -> int:
    if isinstance(entry, dict):
        return sum(map(count_nulls, entry.values()))
    if isinstance(entry, list):
        return sum(map(count_nulls, entry))
    return entry is None


@given(st.dictionaries(st.sampled_from(['x', 'fit', 'v_n']), json_values))
def test_every_null_is_found_once_and_has_a_reason(entries: dict[str, Any]) -> None:
    unknowns = Result(entries).unknowns()
    assert len(unknowns) == count_nulls(entries)
    assert len({unknown.path for unknown in unknowns}) == len(unknowns)
    assert all(unknown.reason for unknown in unknowns)


def test_the_reason_of_a_null_is_the_one_that_the_identification_gives(
    document: Document,
) -> None:
    entries = document()
    entries['v_n'] = entries['four_point'] = None
    entries['coefficients']['D7'] = None
    entries['unknown'] = {
        'coefficients.D7': 'not separable from D10 over this range of speeds',
        'four_point': 'no four hunting speeds',
        'v_n': 'no fold within the range of the data',
    }
    entries['warnings'] = ['roller: 3 % of the samples are missing', 'v_n not known: no fold']
    result = Result(entries)
    assert result.reason('coefficients.D7').startswith('not separable')
    assert result.reason('four_point').startswith('no four')
    # What stands below a null is not known for the same reason.
    assert result.reason('v_n.ci95') == 'no fold within the range of the data'
    assert result.notices[0].startswith('roller')


@pytest.mark.parametrize(
    ('speed', 'branch', 'words'),
    [
        (6.0, 'stable', 'below v_n'),
        (6.0, 'unstable', 'below v_n'),
        (8.4, 'unstable', 'at or above v_c'),
    ],
)
def test_a_branch_that_does_not_exist_says_where_it_does(
    document: Document, speed: float, branch: str, words: str
) -> None:
    entries = document()
    index = min(
        range(len(entries['branches'])),
        key=lambda k: abs(entries['branches'][k]['speed_mps'] - speed),
    )
    assert words in Result(entries).reason(f'branches.{index}.{branch}_amplitude_m')


def test_without_any_reason_the_report_says_so() -> None:
    assert 'no reason' in Result({'v_c': None, 'unknown': {}, 'warnings': []}).reason('v_c')


def test_paths_past_a_null_are_not_known_either() -> None:
    result = Result({'v_n': None, 'fit': {'segments': 3}})
    assert result.get('v_n.value') is None
    assert result.value('v_n') is None
    assert result.value('fit.segments') == 3.0
    assert result.value('nothing.like.it') is None
    assert result.steady_states() == []
