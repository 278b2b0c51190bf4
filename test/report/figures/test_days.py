from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from hunt_ros.analysis.day_spread import DayAmplitude, Hit, branch_by_day
from hunt_ros.identification.days import Days, DaySummary
from hunt_ros.report.figures.days import days_apart, days_tables
from hunt_ros.report.result import Result


def days(count: int, speeds: int = 8, hits: bool = True) -> Days:
    names = [f'2024-05-{k + 1:02d}' for k in range(count)]
    states = [
        DayAmplitude(float(v), 6e-4 + 1e-5 * k, name)
        for k, name in enumerate(names)
        for v in np.linspace(6.6, 8.6, speeds)
    ]
    moved = [
        Hit(7.2, name, f'{name}.mcap', 1e-4, 6e-4 if k else 1e-5, 0.2 if k else -0.3, 0.02)
        for k, name in enumerate(names)
    ]
    summaries = [DaySummary(name, 3, speeds, 1e-5 * k) for k, name in enumerate(names)]
    return Days(tuple(summaries), branch_by_day(states), tuple(moved if hits else ()))


def shown(one: Days) -> Result:
    return Result({'days': one.to_json(), 'unknown': {'days.day_std_m': 'one day only'}})


@pytest.mark.parametrize('count', [2, 3, 12])
def test_every_panel_shows_something_and_says_its_unit(count):
    figure = days_apart(days(count))
    left, right = figure.axes
    assert '(mm)' in left.get_ylabel()
    assert '(1/s)' in right.get_ylabel()
    assert left.lines
    assert right.lines
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == [f'2024-05-{k + 1:02d}' for k in range(min(count, 10))]


def test_a_panel_without_data_says_so():
    figure = days_apart(days(2, hits=False))
    assert 'no free motion' in figure.axes[1].texts[0].get_text()


def test_the_tables_hold_the_numbers_of_the_document():
    one = days(3)
    page = days_tables(shown(one))
    for value in (one.day_std, one.summaries[2].shift):
        assert f'<data value="{value!r}"' in page
    assert '2024-05-03' in page
    assert 'Growth rate of free motion' in page


def test_a_single_day_gives_the_reason_instead():
    page = days_tables(shown(days(1)))
    assert 'not known: one day only' in page
    assert '<table' not in page


def test_names_of_many_days_do_not_lie_on_the_axes():
    figure = days_apart(days(10))
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    tops = [axes.get_window_extent().y1 for axes in figure.axes]
    assert all(top <= box.y0 for top in tops)
    left, right = sorted((axes.get_window_extent() for axes in figure.axes), key=lambda b: b.x0)
    assert all(a.x1 < b.x0 for a, b in pairwise([left, right]))
