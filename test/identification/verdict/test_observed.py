"""What is read off the jumps is given only where the steps of the speed show it."""

from __future__ import annotations

import pytest

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds
from hunt_ros.identification.verdict.reasons import resolved


@pytest.mark.parametrize('criticality', ['subcritical', 'supercritical', None])
@pytest.mark.parametrize('steps', [0.0, 1.0, 1.03])
def test_jumps_no_more_than_a_step_apart_are_no_hysteresis(criticality, steps):
    seen = ObservedCriticalSpeeds(8.0, 8.0 - 0.2 * steps, 0.2, 1e-4)
    found = resolved(seen, criticality)
    assert found[0].v_n is None
    assert found[0].hysteresis_width is None
    assert found[0].v_c == seen.v_c
    assert found[1]


def test_jumps_two_steps_apart_are_one_unless_the_rig_is_supercritical():
    seen = ObservedCriticalSpeeds(8.0, 7.6, 0.2, 1e-4)
    for criticality in ('subcritical', None):
        found = resolved(seen, criticality)
        assert found[0] == seen
        assert not found[1]
    assert resolved(seen, 'supercritical')[0].v_n is None


def test_a_jump_down_alone_is_given():
    seen = ObservedCriticalSpeeds(None, 6.4, 0.2, 1e-4)
    assert resolved(seen, 'subcritical')[0] == seen
    assert resolved(seen, None)[0] == seen


def test_nothing_seen_needs_no_reason_of_its_own():
    assert resolved(ObservedCriticalSpeeds(8.0, None, 0.2, 1e-4), 'supercritical')[1] == ''
