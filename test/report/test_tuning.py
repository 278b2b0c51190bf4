"""Settings beside what the whole recordings show: what counts as false, late and missed."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from hunt_ros.bag import read_record
from hunt_ros.detection import DetectorConfig
from hunt_ros.identification import identify
from hunt_ros.identification.record.events import Event
from hunt_ros.report.tuning import Outcome, Truth, outcome_of, picture, tune, usual_grid
from hunt_ros.samples import NANOSECONDS, Record, Series

_BAGS = Path(__file__).parents[2] / 'bags'


def seen(*told: tuple[str, float, float, float]) -> list[Event]:
    """Return events: kind, from, to (s), amplitude of the kick (m)."""
    return [
        Event(kind, 'run', round(a * NANOSECONDS), round(b * NANOSECONDS), 7.0, 7.0, 1e-3, kick)
        for kind, a, b, kick in told
    ]


def truth(*told: tuple[str, float, float, float]) -> Truth:
    stamps = np.array([0, 100 * NANOSECONDS], dtype=np.int64)
    return Truth.of(Record({'lateral': Series(stamps, np.zeros(2))}, 'run'), seen(*told))


SEEN = [('rest', 0.0, 20.0, math.nan), ('died', 22.0, 30.0, 1e-3), ('grew', 40.0, 50.0, math.nan),
        ('stayed', 48.0, 70.0, math.nan), ('died', 70.0, 75.0, math.nan),
        ('rest', 80.0, 99.0, math.nan)]  # fmt: skip


def test_hunting_is_what_grew_stayed_and_died_with_the_speed_and_a_kick_is_harmless() -> None:
    found = truth(*SEEN)
    assert found.hunting == [(40.0, 75.0)]
    assert found.harmless == [(0.0, 20.0), (22.0, 30.0), (80.0, 99.0)]
    assert found.harmless_s == 47.0
    # What dies and was never seen to hunt tells nothing.
    assert not truth(('died', 5.0, 9.0, math.nan)).hunting


@pytest.mark.parametrize(
    ('spells', 'false', 'delays', 'missed', 'undecided'),
    [
        pytest.param([], 0, [], 1, 0, id='missed'),
        pytest.param([(43.0, 74.0)], 0, [3.0], 0, 0, id='late'),
        pytest.param([(43.0, 44.0), (60.0, 74.0)], 0, [3.0], 0, 0, id='the first counts'),
        pytest.param([(35.0, 74.0)], 0, [0.0], 0, 1, id='on before'),
        pytest.param([(5.0, 6.0), (25.0, 26.0), (90.0, 91.0)], 3, [], 1, 0, id='false'),
    ],
)
def test_an_alarm_is_judged_by_where_it_began(spells, false, delays, missed, undecided) -> None:
    found = outcome_of('margin', 1.0, [truth(*SEEN)], [spells])
    told = found.false_alarms, found.delays_s, found.missed, found.undecided
    assert told == (false, delays, missed, undecided)
    assert found.harmless_s == 47.0


def test_rates_that_chance_explains_do_not_differ() -> None:
    def of(count: int) -> Outcome:
        return Outcome('', math.nan, count, 3600.0, [], 0, 0)

    assert not of(0).differs(of(3))
    assert of(0).differs(of(10))
    assert of(3).to_json()['delay']['median_s'] is None
    assert of(3).per_hour.low == pytest.approx(0.6187, rel=1e-3)


def test_a_limit_within_a_kick_that_dies_is_a_false_alarm_and_sooner() -> None:
    records = [read_record(_BAGS / name) for name in ('kick_escapes', 'kick_decays')]
    found = identify(records)
    grid = {'alarm_lateral_mm': (0.05,), 'false_alarms_per_week': (1.0,)}
    truths, (present, limited) = tune(found, DetectorConfig(), None, grid)
    assert [len(one.hunting) for one in truths] == [1, 0]
    assert (present.false_alarms, present.missed) == (0, 0)
    assert limited.false_alarms >= 2
    assert limited.delay_s[0] <= present.delay_s[0]
    assert picture([present, limited]).axes
    assert 'alarm_lateral_mm' in usual_grid(found, form=True)
    assert usual_grid(found, form=False).keys() < usual_grid(found, form=True).keys()
