"""What is seen without a model, beside the truth that it must hold."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from foreign_made import RECORDINGS, RIGS
from made import LAW, up_and_down
from records_made import rig_settings

from hunt_ros.dynamics.growth_law import TERMS
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import simulate
from hunt_ros.identification import identify
from hunt_ros.identification.bracket import Bracket, bracket_of, contradicts, refutations
from hunt_ros.identification.preparation import Recording, runs_in
from hunt_ros.identification.record.events import Event
from hunt_ros.identification.settings import IdentificationSettings

V_N = PAPER_NORMAL_FORM.nonlinear_critical_speed

SOFT = replace(PAPER_NORMAL_FORM, D4=-2000.0, D10=0.0)


def forced(speed: float) -> float:
    """Noise intensity of a forcing of 4 um, at any speed."""
    return 8e-12


def seen_in(*records):
    settings = IdentificationSettings()
    runs = [
        run for record in records for run in runs_in(Recording(record, 1, settings), 2.835, 0.0)[0]
    ]
    return bracket_of(runs)


def held(make, speed, kick, seed, form=PAPER_NORMAL_FORM):
    kicks = [(25.0, kick)] if kick else []
    return make(speed, 90.0, seed, form=form, forcing=4e-6, kicks=kicks)


def kicked_holds(make, seed, form=PAPER_NORMAL_FORM):
    """Kicks beyond the fold at six speeds, up from below it."""
    return [
        held(make, v, 7e-4, 100 * seed + k, form)
        for k, v in enumerate((5.8, 6.1, 6.3, 6.6, 6.9, 7.2))
    ]


@pytest.mark.parametrize('seed', range(3))
def test_kicks_at_held_speeds_bracket_the_fold(make, seed):
    seen = seen_in(*kicked_holds(make, seed))
    low, high = seen.v_n
    assert low <= V_N <= high
    assert high - low < 0.6
    assert 6.3 < seen.coexistence[0] <= seen.coexistence[1] == pytest.approx(7.2, abs=0.05)
    # Rest of 25 s beside each kick, which its damping shows or not.
    assert 6.5 < seen.v_c < 7.25
    for speed, above, below in seen.unstable:
        unstable = float(PAPER_NORMAL_FORM.unstable_amplitude(speed))
        assert not above > unstable
        assert not below < unstable


@pytest.mark.parametrize('seed', range(3))
def test_small_kicks_that_died_are_no_rest_that_swells(make, seed):
    """Each larger than the one before, none beyond half of the limit cycle; the last one stays."""
    kicks = [(30.0, 1.2e-4), (60.0, 1.6e-4), (90.0, 2e-4), (120.0, 2.4e-4), (160.0, 7e-4)]
    seen = seen_in(make(7.0, 240.0, seed, forcing=4e-6, kicks=kicks))
    assert seen.coexistence == pytest.approx((7.0, 7.0), abs=0.05)
    assert seen.v_c == pytest.approx(7.0, abs=0.05)
    ((_, above, below),) = seen.unstable
    assert 1e-4 < above < float(PAPER_NORMAL_FORM.unstable_amplitude(7.0)) < below


def test_motion_that_noise_alone_drives_is_no_limit_cycle(make):
    """Below v_c all the time: amplitudes by Rayleigh's distribution, some of them small."""
    seen = [
        seen_in(make(lambda t: 4.5 + 2.7 * t / 240.0, 240.0, seed, forcing=4e-6))
        for seed in range(10)
    ]
    assert sum({event.kind for event in one.events} > {'rest'} for one in seen) <= 1
    assert all(one.v_c is None or one.v_c < 7.2 for one in seen)


@pytest.mark.parametrize('seed', range(3))
def test_a_sweep_brackets_the_fold_and_shows_coexistence(records, make, seed):
    up_and_down = np.interp
    sweep = make(
        lambda t: up_and_down(t, [0, 240, 480], [6.0, 8.8, 6.0]), 500.0, seed, forcing=4e-6
    )
    seen = seen_in(sweep)
    low, high = seen.v_n
    assert low <= V_N <= high
    assert high - low < 0.5
    assert seen.v_c <= 8.0
    assert seen.began == pytest.approx(8.1, abs=0.25)
    assert seen.coexistence is not None


@pytest.mark.parametrize(('form', 'end'), [(PAPER_NORMAL_FORM, V_N), (SOFT, 8.0)])
@pytest.mark.parametrize('slower', [5.0, 10.0])
@pytest.mark.parametrize('ramp', [0.02, 0.05, 0.1])
def test_a_limit_cycle_that_dies_slowly_is_not_said_to_end_below_its_end(
    make, form, end, slower, ramp
):
    way, rise = 3.2 / ramp, 40.0 * slower
    times = np.cumsum([0.0, 20.0, way, rise, way, 60.0])
    for seed in range(2):
        record = make(
            lambda t: np.interp(t, times, [5.6, 5.6, 8.8, 8.8, 5.6, 5.6]), times[-1], seed,
            form=replace(form, time_scale=slower * form.time_scale),
            forcing=4e-6 / math.sqrt(slower),
        )  # fmt: skip
        seen = seen_in(record)
        assert seen.v_n[0] < end < seen.v_n[1]
        assert seen.coexistence is None or seen.coexistence[0] > end


def test_a_speed_that_a_limit_cycle_passed_and_came_back_from_is_none_at_which_it_stayed(make):
    times, speeds = [0, 20, 22, 24, 74, 76, 110], [8.2, 8.2, 6.2, 7.4, 7.4, 6.0, 6.0]
    record = make(lambda t: np.interp(t, times, speeds), 110.0, 1, start=6e-4, forcing=2e-6)
    seen = seen_in(record)
    stayed = [event for event in seen.events if event.kind == 'stayed']
    assert stayed
    assert all(event.speed_low > V_N for event in stayed)
    assert seen.v_n[1] > V_N


@pytest.mark.parametrize('seed', range(4))
def test_a_supercritical_rig_rests_and_cycles_at_no_speed(make, seed):
    steps = np.repeat([7.6, 7.8, 8.0, 8.2, 8.4, 8.6, 8.4, 8.2, 8.0, 7.8, 7.6], 40)
    record = make(
        lambda t: np.interp(t, np.arange(steps.size), steps), 439.0, seed, form=SOFT, forcing=4e-6
    )
    seen = seen_in(record)
    assert seen.coexistence is None
    assert seen.v_c is None or seen.v_c <= 8.0


def test_a_kick_is_no_jump(make):
    """Rest at 7.2 m/s, then a kick, and hunting for good: nothing grew, no v_c is observed."""
    speed = lambda t: np.interp(t, [0, 60, 61, 200], [6.9, 6.9, 7.2, 7.2])  # noqa: E731
    record = make(speed, 200.0, 3, forcing=4e-6, kicks=[(100.0, 5e-4)])
    result = identify([record])
    assert result.observed.v_c is None
    assert result.bracket.began is None
    assert len(result.bracket.kicks) == 1
    assert (result.criticality, result.supercritical_probability) == ('subcritical', 0.0)
    assert result.hysteresis_below is None


def test_a_law_that_contradicts_what_was_seen_is_named(make):
    seen = seen_in(*kicked_holds(make, 1))
    assert refutations(LAW, forced, seen) == []
    low = replace(LAW, p=LAW.p + np.array([1.0, *np.zeros(TERMS - 1)]))
    assert any(
        'small motion grows' in line and '7.2 m/s' in line
        for line in refutations(low, forced, seen)
    )
    high = replace(LAW, p=LAW.p - np.array([3.0, *np.zeros(TERMS - 1)]))
    assert any('there is no limit cycle' in line for line in refutations(high, forced, seen))
    assert not any(contradicts(LAW, forced, event) for event in seen.events)


def test_rest_that_its_own_law_and_forcing_made_is_no_contradiction(make):
    """Small motion grows by 0.43 1/s, and is kicked after 9 s: two in five look like rest."""
    made = [make(9.2, 25.0, seed, forcing=4e-6, kicks=[(9.0, 7e-4)]) for seed in range(80)]
    rests = [e for record in made for e in seen_in(record).events if e.kind == 'rest']
    assert len(rests) > 20
    assert not any(contradicts(LAW, forced, event) for event in rests)
    # Seen for four times as long it is one, but not where forcing is too faint to be seen.
    longer = [replace(e, end_ns=e.end_ns + 3 * (e.end_ns - e.start_ns)) for e in rests]
    assert all(contradicts(LAW, forced, event) for event in longer)
    assert not any(contradicts(LAW, lambda speed: math.nan, event) for event in longer)


def test_rest_alone_bounds_nothing_but_v_c(make):
    seen = seen_in(held(make, 7.0, 0.0, 5))
    assert replace(seen, events=(), v_c=None, why={}) == Bracket()
    assert seen.v_c == pytest.approx(7.0, rel=0.01)
    assert 'rest for' in seen.lines()[0]


@pytest.mark.parametrize('speed', [8.0, 8.1])
def test_rest_without_damping_seldom_passes_for_rest_with_it(make, speed):
    seen = [seen_in(make(speed, 30.0, seed, forcing=4e-6)).v_c for seed in range(40)]
    assert sum(v_c is not None for v_c in seen) <= 3


def test_small_motion_above_v_c_is_no_rest_of_a_quiet_rig(make):
    """A limit cycle at every speed is of one kind, too, and bounds nothing."""
    seen = [
        seen_in(make(lambda t: 8.2 + t / 100.0, 90.0, seed, start=7e-4, forcing=4e-6))
        for seed in range(5)
    ]
    assert all(one.v_c is None for one in seen)


@pytest.mark.parametrize('line', [0.0, 6e-4])
def test_what_a_line_as_large_as_the_limit_cycle_may_hide_is_no_rest(make, line):
    quiet = make(7.6, 60.0, 4, forcing=4e-6, roughness=line)
    seen = seen_in(held(make, 7.2, 7e-4, 3), quiet)
    rested = max(event.speed for event in seen.events if event.kind == 'rest')
    assert (rested > 7.5) is (line == 0.0)


@pytest.mark.parametrize('line', [0.0, 3e-5])
def test_a_staircase_that_is_quiet_at_every_speed_bounds_v_c(line):
    """At 3 m/s the line of the roller is 200 um large, 1 Hz from the hunting."""
    profile = up_and_down(np.arange(3.0, 6.1, 0.5), 25.0)
    for seed in range(2):
        result = identify([simulate(paper_rig(), rig_settings(line), profile, seed=seed)])
        seen = result.bracket
        assert 5.4 < seen.v_c < 6.05
        assert 'v_c above' in seen.lines()[0]
        assert {event.kind for event in seen.events} == {'rest'}
        assert result.criticality is None
        assert 'no small motion' not in str(result.unknown)


def test_hunting_that_began_below_rest_is_told_beside_it():
    at = [('grew', 18.7, 18.76, 2e-4), ('rest', 19.0, 19.0, 1e-5)]
    events = [Event(kind, 'a', 0, 10**10, low, high, size) for kind, low, high, size in at]
    (line,) = Bracket(tuple(events), began=18.76).lines()
    assert '18.76 m/s, out of rest that was seen up to 19 m/s' in line
    (line,) = Bracket(tuple(events[:1]), began=18.76).lines()
    assert line.endswith('18.76 m/s')


def test_it_stands_first_and_is_json(make):
    seen = seen_in(*kicked_holds(make, 2))
    json.dumps(seen.to_json(), allow_nan=False)
    assert 'subcritical' in seen.lines()[0]
    assert seen.lines()[1].startswith('seen: v_n between')


@pytest.mark.parametrize(
    ('recording', 'foretold'), [('up alone in 80 s', True), ('ramps of two minutes', False)]
)
def test_a_fold_below_every_limit_cycle_that_was_seen_is_called_a_forecast(recording, foretold):
    rig = RIGS['conicity that saturates']
    found = identify(RECORDINGS[recording](rig, 0), IdentificationSettings(**rig.told))
    assert found.v_n is not None
    said = [line for line in found.warnings if line.startswith('v_n = ')]
    assert bool(said) is foretold
    assert not foretold or 'and not to end' in said[0]


@pytest.mark.parametrize('seed', [0, 3])
def test_a_law_that_knows_no_critical_speed_does_not_overrule_rest_beside_a_limit_cycle(seed):
    rig = RIGS['conicity that saturates']
    found = identify(RECORDINGS['kicked holds'](rig, seed), IdentificationSettings(**rig.told))
    assert found.criticality == 'subcritical'
    low, high = found.bracket.v_n
    assert low < rig.v_n < high
