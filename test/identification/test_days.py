from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.identification import identify
from hunt_ros.identification.days import UNDATED, day_of
from hunt_ros.samples import Record, Series

DAY_NS = 86_400_000_000_000


def stamped(start_ns, notes=None):
    return Record({'speed': Series(np.array([start_ns]), np.array([7.0]))}, 'r', notes or {})


def test_a_day_is_what_the_recording_calls_it_or_its_date():
    assert day_of(stamped(1_700_000_000_000_000_000)) == '2023-11-14'
    assert day_of(stamped(1_700_000_000_000_000_000, {'day': ' monday '})) == 'monday'
    assert day_of(stamped(5_000_000_000)) == UNDATED


def test_kicked_runs_of_two_days_stand_side_by_side(make):
    def run(speed, kick, seed, day):
        record = make(
            lambda t: np.full_like(t, speed), 60.0, seed, forcing=2e-6, kicks=[(5.0, kick)]
        )
        moved = {
            name: Series(one.stamps_ns + day * DAY_NS, one.values) for name, one in record.items()
        }
        return Record(moved, record.source)

    # At 7.2 m/s the unstable amplitude is 0.26 mm: the small kicks decay, the large grow.
    runs = [
        run(7.2, 1.2e-4, 1, 0),
        run(7.2, 3.3e-4, 2, 0),
        run(7.6, 2.4e-4, 3, 0),
        run(7.2, 1.2e-4, 4, 1),
        run(7.6, 2.4e-4, 5, 1),
        run(8.4, 5e-5, 6, 1),
    ]
    days = identify(runs).to_json()['days']
    assert [day['day'] for day in days['summary']] == ['2023-11-14', '2023-11-15']
    assert [day['recordings'] for day in days['summary']] == [3, 3]
    assert days['highest_decay_mps'] == pytest.approx(7.2)
    assert days['summary'][1]['lowest_growth_mps'] == pytest.approx(7.6)
    # The amplitude equation is the same on both days.
    assert days['stable_branch']
    assert days['day_std_m'] < 0.01 * days['stable_branch'][0]['amplitude_m']
    assert sum(hit['grew'] for hit in days['hits']) == 4
