"""The next profile: what it promises, what it risks, and that it keeps to its bounds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from hunt_ros.dynamics.profile import Hold, Profile
from hunt_ros.errors import ConfigError, IdentificationError
from hunt_ros.identification import plan as planning
from hunt_ros.identification.bracket import Bracket
from hunt_ros.identification.foresight import ESCAPED, TIME, Foresight, Move
from hunt_ros.identification.plan import PlanSettings, Prediction, plan


@pytest.fixture(scope='module')
def found(known):
    return plan(known, PlanSettings(budget_s=200.0))


def test_all_deviations_are_to_fall_within_budget_and_risk(known, found):
    assert [one.name for one in found.quantities[:2]] == ['v_c', 'v_n']
    assert all(one.std_after < 0.8 * one.std for one in found.quantities)
    assert found.quantities[0].std == pytest.approx(known.v_c.std, rel=0.3)
    assert found.duration_s <= 200.0
    low, high = found.duration_ci95_s
    assert low < found.duration_s < high <= found.longest_s
    assert 0.0 <= found.escape <= 0.05
    assert found.longest_s == found.profile.duration_s
    assert 'middle amplitudes' in found.reason


def test_the_profile_is_one_that_the_drive_reads(found):
    again = Profile.from_yaml(found.profile.to_yaml())
    assert again == found.profile
    again.check(8.8)
    assert again.reacts


def test_reversals_are_most_of_a_plan_and_beat_waiting_on_a_branch(known, found):
    assert sum(one.kind == 'reversal' for one in found.steps) > 0.4 * len(found.steps)
    foresight = Foresight(known.posterior, (7.0, 7.6), 6.0, 8.8, paths=160)
    fold = foresight.fold_amplitude
    rise, fall = (
        Hold(8.8, 40.0, until_above_m=0.3 * fold),
        Hold(6.2, 40.0, until_below_m=0.7 * fold),
    )
    drops = []
    for steps in ([Hold(6.2, 12.0)], [rise, fall]):
        end, told = foresight.follow(foresight.start(6.0, 0.0), [Move(step) for step in steps])
        spread = foresight.spread(foresight.nothing + told) / foresight.deviations
        drops.append(-np.log(spread).sum() / end[:, TIME].mean())
    assert drops[1] > 5.0 * drops[0]


@pytest.mark.parametrize('ceiling', [6.05, 6.2, 6.4126])
def test_below_the_fold_nothing_is_faster_than_the_ceiling_and_little_is_learnt(
    known, ceiling, monkeypatch
):
    settings = PlanSettings(budget_s=60.0, speed_ceiling_mps=ceiling)
    with pytest.raises(IdentificationError, match=f'{ceiling:g} m/s.*teaches anything'):
        plan(known, settings)
    monkeypatch.setattr(planning, '_LEARNT', -1.0)
    plan(known, settings).profile.check(ceiling)


def test_between_the_fold_and_v_c_nothing_is_faster_than_the_ceiling_each_time_anew(known):
    found, again = (plan(known, PlanSettings(budget_s=200.0, speed_ceiling_mps=7.7)) for _ in 'ab')
    found.profile.check(7.7)
    assert again.to_json() == found.to_json()


def test_speeds_and_costs_that_make_no_plan_are_refused(known):
    for name, wrong in (
        ('start_speed_mps', {'speed_ceiling_mps': 7.0, 'start_speed_mps': 7.5}),
        ('speed_ceiling_mps', {'speed_ceiling_mps': 5.0}),
        ('budget_s', {'budget_s': 1.0}),
        ('max_escape', {'max_escape': 1.5}),
        ('speeds_mps', {'speeds_mps': (-1.0,)}),
    ):
        with pytest.raises(ConfigError, match=name):
            plan(known, PlanSettings(**wrong))
    with pytest.raises(IdentificationError, match='teaches anything'):
        plan(known, PlanSettings(budget_s=10.0, start_amplitude_m=6e-4, start_speed_mps=8.0))


def test_without_v_n_it_begins_with_a_sweep_and_says_why(known):
    blind = replace(known, v_n=None, unknown={'v_n': 'nothing hunted'})
    found = plan(blind, PlanSettings(speed_ceiling_mps=9.0, budget_s=120.0))
    assert found.escape is None
    assert found.quantities == ()
    assert 'without v_n nothing better can be planned' in found.reason
    assert 'nothing hunted' in found.reason
    found.profile.check(9.0)
    assert found.duration_s <= 125.0


def test_of_a_supercritical_rig_nothing_must_be_known_that_it_has_not(known):
    soft = replace(known, v_n=None, criticality='supercritical', unknown={'v_n': 'it has no fold'})
    found = plan(soft, PlanSettings(speed_ceiling_mps=9.0, budget_s=120.0))
    assert found.reason.endswith('a sweep to 9 m/s: it has no fold')


def test_deviations_are_told_as_a_person_writes_them():
    told = Prediction('A_u(7 m/s)', 'm', 2e-3, 1e-4, 9.2e-5).told
    assert (told(1.02e-4), told(9.2e-5)) == ('100 um', '92 um')


def test_a_sweep_to_a_speed_of_rest_promises_no_hunting(known):
    """Rest seen at 7.2 m/s, known to half a per cent; no ceiling given: nothing is above it."""
    rested = replace(known, v_c=None, speeds=(7.1, 7.2), bracket=Bracket(v_c=7.164))
    assert 'hunting' not in plan(rested, PlanSettings(budget_s=60.0)).reason


@pytest.fixture(scope='module')
def foresight(known):
    return Foresight(known.posterior, (7.0, 7.6), 6.0, 8.8, paths=400)


def test_from_the_unstable_branch_about_half_of_the_paths_begin_to_hunt(known, foresight):
    unstable = float(known.branch('unstable', [7.6])[0][0])
    for factor, low, high in ((0.3, 0.0, 0.02), (1.0, 0.3, 0.7), (1.5, 0.95, 1.0)):
        start = foresight.start(7.6, factor * unstable)
        end, _ = foresight.follow(start, [Move(Hold(7.6, 60.0, 1.0), wanted=False)])
        assert low <= end[:, ESCAPED].mean() <= high


def test_what_is_told_grows_with_the_square_of_the_amplitude(foresight):
    """Held on a known law for a time T: A^2 T / 2 D, cell by cell, whatever the path."""
    hold = [Move(Hold(6.4, 20.0, 1.0), wanted=False)]
    quiet, little = foresight.follow(foresight.start(6.4, 0.0), hold)
    _, much = foresight.follow(foresight.start(6.4, 5e-4), hold)
    assert np.trace(much) > 30.0 * np.trace(little)
    assert (np.linalg.eigvalsh(much) > -1e-9 * np.trace(much)).all()
    assert quiet[:, TIME] == pytest.approx(np.full(400, 20.0))
    more = foresight.spread(foresight.nothing + much)
    assert (more <= foresight.spread(foresight.nothing) * (1.0 + 1e-9)).all()
    assert math.isclose(
        float(foresight.spread(foresight.nothing)[1]), float(foresight.deviations[1])
    )


def test_too_few_forms_with_a_fold_are_refused(known):
    p = known.posterior.p.copy()
    p[:-20, 3] *= -1.0
    with pytest.raises(IdentificationError, match='expected 40'):
        Foresight(replace(known.posterior, p=p), (7.0,), 6.0, 8.8, paths=10)
