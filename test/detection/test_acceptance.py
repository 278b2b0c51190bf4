"""A new normal form is taken over when it makes the alarm earlier or sharper, not otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hunt_ros.detection.acceptance import is_rolled_back, objections, rolled_back
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM


def _identified(std_v_c: float = 0.05, **changes: float) -> IdentifiedNormalForm:
    covariance = np.zeros((6, 6))
    covariance[0, 0] = std_v_c**2
    return IdentifiedNormalForm(replace(PAPER_NORMAL_FORM, **changes), covariance)


#: Subcritical, without a quintic term: no fold, an unstable branch at every speed below v_c.
NO_FOLD = {'D15': 0.0, 'D10': 0.0, 'D7': 0.0}
#: Limit cycles from zero on above v_c, nothing below.
SUPERCRITICAL = {'D4': -2000.0}


@pytest.mark.parametrize(
    ('new', 'current'),
    [
        (_identified(), None),
        (_identified(0.01), _identified(0.05)),
        (_identified(D4=2600.0, critical_speed=7.8), _identified()),
        (_identified(**NO_FOLD), _identified()),
        (_identified(), _identified(**SUPERCRITICAL)),
        (_identified(critical_speed=7.0), _identified(**SUPERCRITICAL)),
        (_identified(frequency_hz=2.9), _identified()),
    ],
    ids=[
        'the first',
        'sharper',
        'earlier',
        'no fold',
        'of a supercritical one',
        'of a faster one',
        'the same rig',
    ],
)
def test_a_form_that_alarms_no_later_at_any_speed_is_taken_over(new, current) -> None:
    assert objections(new, current) == []


@pytest.mark.parametrize(
    ('new', 'current', 'word'),
    [
        (_identified(frequency_hz=12.0), _identified(frequency_hz=2.8), '12 Hz'),
        (_identified(**SUPERCRITICAL), _identified(**NO_FOLD), 'alarms never at'),
        (_identified(D4=1400.0), _identified(), 'mm at'),
        (_identified(critical_speed=8.4), _identified(), 'force at any amplitude'),
        (_identified(D15=-9e7), _identified(), 'alarms never at'),
        (_identified(std_v_c=0.2), _identified(), 'widens'),
    ],
)
def test_a_form_that_alarms_later_is_less_sure_or_of_another_rig_waits(new, current, word) -> None:
    assert any(word in line for line in objections(new, current))


def test_a_form_that_a_person_went_back_to_is_taken_over_whatever_it_does() -> None:
    later = _identified(2.0, D4=1400.0, critical_speed=8.4)
    assert objections(later, _identified())
    assert objections(rolled_back(later), _identified()) == []


def test_the_mark_survives_the_parameter_file_and_the_numbers_stay() -> None:
    form = _identified(critical_speed=8.4)
    back = IdentifiedNormalForm.from_yaml(rolled_back(form).to_yaml())
    assert is_rolled_back(back)
    assert not is_rolled_back(IdentifiedNormalForm.from_yaml(form.to_yaml()))
    assert back.form == form.form
    assert rolled_back(back).to_yaml() == back.to_yaml()
