"""
Whether a newly identified normal form may replace the one in force without being asked.

A form that makes the alarm later, or less sure of itself, waits for a person; one
that makes it earlier or sharper is taken at once. So is one that a person went back to:
it carries a mark, and whoever set the mark has seen what it does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.settings import Settings, setting

#: Line of the provenance that marks a form which a person went back to.
_MARK = 'rolled back'

#: Speeds between v_n and v_c at which two thresholds are compared, as fractions.
_PLACES = np.array([0.25, 0.5, 0.75, 0.9])


@dataclass(frozen=True)
class AcceptanceConfig(Settings):
    """Bounds within which a new normal form is taken over by itself."""

    accept_amplitude_factor: float = setting(
        1.15, 'a new form may raise the unstable amplitude by this factor', low=1.0, high=10.0
    )
    accept_speed_factor: float = setting(
        1.02, 'a new form may raise v_n and v_c by this factor', low=1.0, high=10.0
    )
    accept_width_factor: float = setting(
        2.0,
        'a new form may widen the standard deviation of v_c by this factor',
        low=1.0,
        high=100.0,
    )


def objections(
    new: IdentifiedNormalForm, current: IdentifiedNormalForm | None, config: AcceptanceConfig
) -> list[str]:
    """
    Say what speaks against taking over a new form without asking.

    Parameters
    ----------
    new, current : IdentifiedNormalForm
        `current` None: nothing is in force, and nothing speaks against. Nor does
        anything speak against a `new` one that a person went back to.
    config : AcceptanceConfig
        The bounds.

    Returns
    -------
    list of str
        One line each; empty where the new form may be taken over.
    """
    if current is None or is_rolled_back(new):
        return []
    found = []
    factor = _amplitude_factor(new.form, current.form)
    if factor > config.accept_amplitude_factor:
        found.append(f'raises the unstable amplitude by a factor {factor:.2f}')
    for name, before, after in (
        ('v_c', current.form.critical_speed, new.form.critical_speed),
        (
            'v_n',
            current.form.nonlinear_critical_speed or current.form.critical_speed,
            new.form.nonlinear_critical_speed or new.form.critical_speed,
        ),
    ):
        if after > before * config.accept_speed_factor:
            found.append(f'raises {name} from {before:.3f} to {after:.3f} m/s')
    before, after = current.std('v_c'), new.std('v_c')
    if before > 0.0 and after > before * config.accept_width_factor:
        found.append(f'widens the standard deviation of v_c from {before:.3f} to {after:.3f} m/s')
    return found


def rolled_back(form: IdentifiedNormalForm) -> IdentifiedNormalForm:
    """Return the form with the mark that a person went back to it."""
    return replace(form, provenance={**form.provenance, _MARK: 'by the operator'})


def is_rolled_back(form: IdentifiedNormalForm) -> bool:
    """Whether a person went back to this form."""
    return _MARK in form.provenance


def form_event(form: IdentifiedNormalForm | None) -> tuple[str, str]:
    """Return the word and the detail of the event that a form was taken over."""
    if form is None:
        return 'normal_form_changed', 'none is in force'
    v_n = form.form.nonlinear_critical_speed
    detail = f'v_c {form.form.critical_speed:.3f} m/s'
    if v_n is not None:
        detail += f', v_n {v_n:.3f} m/s'
    return ('normal_form_reverted' if is_rolled_back(form) else 'normal_form_changed'), detail


def _amplitude_factor(new: NormalForm, current: NormalForm) -> float:
    """Largest ratio of the unstable amplitudes over the hysteresis region of `current`."""
    v_n = current.nonlinear_critical_speed
    if v_n is None:
        return 1.0
    speeds = v_n + _PLACES * (current.critical_speed - v_n)
    before, after = current.unstable_amplitude(speeds), new.unstable_amplitude(speeds)
    # Where the new form has no unstable branch below its own v_n, nothing can hunt: the
    # quiet basin has become unbounded there, which is the largest rise of all.
    rises = np.where(
        np.isfinite(after),
        after / before,
        np.where(speeds < new.critical_speed, math.inf, 0.0),
    )
    return float(np.nanmax(rises, initial=0.0))
