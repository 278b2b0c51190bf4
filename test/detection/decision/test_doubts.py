"""Doubts do not chatter, and what is not known is not said to be well again."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made import dead, without, words

from hunt_ros.detection import DetectorConfig, HuntingDetector, doubts
from hunt_ros.detection.decision import decisions
from hunt_ros.detection.decision.rules import rows_of, rules_of
from hunt_ros.detection.offline import collect
from hunt_ros.detection.output import blank_rows
from hunt_ros.detection.regions import Region, State
from hunt_ros.detection.replay import detect, watch
from hunt_ros.dynamics.profile import Corners, Profile
from hunt_ros.samples import USUAL_CHANNELS

RULES = rules_of(DetectorConfig(), 6.4, 8.0)
HUNTING = (State.ESCAPING, State.LIMIT_CYCLE, State.DECAYING)


class Margins:
    """The doubt about the margin, row by row."""

    def __init__(self) -> None:
        self.memory = decisions.fresh_memory()[0]

    def low(self, region: Region, state: State, known: bool, margin: float) -> bool:
        row = blank_rows(np.zeros(1, dtype=np.int64))[0]
        row['region'], row['state'], row['margin'] = region, state, margin
        decisions._doubt(RULES, self.memory, known, False, False, False, row)
        return bool(row['doubts'] & doubts.MARGIN)


#: Stretches of rows: (rows, region, state, amplitude known, margin).
STRETCHES = st.lists(
    st.tuples(
        st.integers(1, 400),
        st.sampled_from(list(Region)),
        st.sampled_from(list(State)),
        st.booleans(),
        st.sampled_from([0.3, 1.9, 2.5, 3.1, 20.0, math.inf]),
    ),
    max_size=25,
)


@settings(max_examples=60, deadline=None)
@given(STRETCHES)
def test_margin_is_restored_only_where_it_is_seen_and_after_its_hold(stretches) -> None:
    margins = Margins()
    low, since, room = False, 10**9, 0
    for rows, region, state, known, margin in stretches:
        seen = known and region is Region.HYSTERESIS
        for _ in range(rows):
            now = margins.low(region, state, known, margin if seen else math.nan)
            room = room + 1 if not seen or margin > RULES.margin_in else 0
            since += 1
            if low and not now:
                assert known, 'not while the amplitude is unknown'
                assert room > rows_of(RULES, decisions.MARGIN_S)
                if seen:
                    assert min(room, since) >= rows_of(RULES, decisions.MARGIN_RESTORE_S)
                else:
                    assert region is Region.STABLE
                    assert state not in HUNTING
            if now is not low:
                low, since = now, 0


def test_a_margin_that_noise_crosses_again_and_again_is_told_once() -> None:
    rng = np.random.default_rng(5)
    margins = Margins()
    z, low, changes = 0j, False, 0
    for _ in range(60_000):  # narrow-band noise, correlation time 3 s, median margin 4
        z = z * (1.0 - 0.01 / 3.0) + math.sqrt(0.01 / 3.0) * complex(*rng.normal(size=2))
        margin = 4.7 / abs(z)
        now = margins.low(Region.HYSTERESIS, State.QUIET, True, margin)
        changes, low = changes + (now is not low), now
    assert changes <= 9, 'in ten minutes'


def test_the_margin_stays_low_as_long_as_the_wheelset_hunts(recorded, true_form) -> None:
    profile = Profile((Corners((0.0, 12.0, 27.0, 45.0), (7.2, 7.2, 5.7, 5.7)),))
    record = recorded(profile, 45.0, kicks=[(5.0, 0.6e-3)])
    said = words(detect(HuntingDetector(DetectorConfig(), true_form), record))
    assert 'limit_cycle' in said
    assert said.count('margin_low') == said.count('margin_restored') == 1
    assert said.index('margin_restored') > said.index('quiet')


@pytest.mark.parametrize(
    ('channels', 'dies'),
    [
        (USUAL_CHANNELS, 'lateral'),
        (USUAL_CHANNELS, 'yaw'),
        (('lateral', 'roller', 'speed'), ''),
        (('lateral', 'roller', 'speed'), 'lateral'),
    ],
)
def test_the_largest_amplitude_is_one_that_was_known(channels, dies, recorded, true_form) -> None:
    record = recorded(7.2, 40.0, kicks=[(5.0, 0.35e-3)], seed=3)
    cycle = record['lateral'].between(20_000_000_000, 30_000_000_000).values
    if dies:  # in the limit cycle
        record = dead(record, dies, 30.0, 0.0)
    record = without(record, *set(record) - set(channels))
    detector = HuntingDetector(DetectorConfig(channels=channels), true_form)
    found = collect(watch(record, detector), detector)
    assert found.max_amplitude_m == pytest.approx(math.sqrt(2.0) * cycle.std(), rel=0.1)
