"""Samples judged at their source."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hunt_ros.drivers.watch import SourceWatch

_STEP = 2_000_000


def _report(stamps=None, readings=None, saturated=None, blocks: int = 7, stuck_s: float = 0.5):
    """Judge one second at 500 Hz, in blocks."""
    stamps = _STEP * np.arange(1, 501) if stamps is None else np.asarray(stamps)
    readings = np.sin(np.arange(stamps.size)) if readings is None else np.asarray(readings)
    saturated = np.zeros(stamps.size, bool) if saturated is None else saturated
    watch = SourceWatch(500.0, stuck_s)
    for part in np.array_split(np.arange(stamps.size), blocks):
        watch.take(stamps[part], readings[part], saturated[part])
    return watch.report()


def test_good_samples_have_a_rate_and_no_problem() -> None:
    count, values, problems = _report()
    assert (count, values['rate_hz'], values['jitter_ms'], problems) == (500, 500.0, 0.0, [])


def test_the_verdict_does_not_depend_on_how_the_samples_came() -> None:
    stamps = np.delete(_STEP * np.arange(1, 501), [40, 41, 300])
    assert _report(stamps, blocks=1) == _report(stamps, blocks=150)


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (
            {'stamps': np.delete(_STEP * np.arange(1, 501), [40, 41, 300])},
            '2 gaps, the longest 0.006',
        ),
        ({'stamps': 2_200_000 * np.arange(1, 501)}, '455 samples/s, expected 500'),
        ({'readings': np.r_[np.arange(490.0), np.full(10, math.nan)]}, '10 samples are no number'),
        ({'saturated': np.arange(500) < 3}, '3 samples saturated'),
        ({'readings': np.r_[np.arange(200.0), np.full(300, 7.0)]}, 'stuck at 7 for 0.6 s'),
        (
            {'stamps': _STEP * np.arange(1, 501) + 900_000 * (np.arange(500) % 4 < 2)},
            'stamps jitter by 0.6',
        ),
    ],
)
def test_each_fault_is_named_with_its_number(change, words) -> None:
    *_, problems = _report(**change)
    assert any(words in problem for problem in problems), problems


def test_a_reading_may_stay_the_same_where_that_is_allowed() -> None:
    assert not _report(readings=np.zeros(500), stuck_s=0.0)[2]


def test_what_was_reported_is_not_reported_again_and_silence_has_no_rate() -> None:
    watch = SourceWatch(500.0, 0.0)
    stamps = _STEP * np.arange(1, 501)
    watch.take(stamps, np.full(500, math.nan), np.zeros(500, bool))
    assert watch.report()[2] == ['500 samples are no number']
    watch.take(stamps + 500 * _STEP, np.arange(500.0), np.zeros(500, bool))
    _, values, problems = watch.report()
    assert (values['rate_hz'], problems) == (500.0, [])
    count, values, problems = watch.report()
    assert (count, problems) == (0, [])
    assert math.isnan(values['rate_hz'])
