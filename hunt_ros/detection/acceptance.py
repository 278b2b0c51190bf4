"""
Whether a newly identified normal form may replace the one in force without being asked.

A form that alarms later at any speed, is less sure of itself, or hunts at another frequency (it
may be that of another rig) waits for a person; any other is taken at once. So is one that a
person went back to: it carries a mark, and whoever set the mark has seen what it does.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import NormalForm

#: Line of the provenance that marks a form which a person went back to.
_MARK = 'rolled back'

#: Speeds at which two forms are compared, as fractions of v_c: up to v_c itself.
_PLACES = np.linspace(0.2, 1.0, 321)


#: A new form may raise the unstable amplitude by this factor: two fits of one rig differ by less.
_AMPLITUDE = 1.15
#: ... and v_n and v_c by this one,
_SPEED = 1.02
#: change the hunting frequency by this one: another is that of another rig,
_FREQUENCY = 1.1
#: and widen the standard deviation of v_c by this one.
_WIDTH = 2.0


def objections(new: IdentifiedNormalForm, current: IdentifiedNormalForm | None) -> list[str]:
    """
    Say what speaks against taking over a new form without asking.

    Parameters
    ----------
    new, current : IdentifiedNormalForm
        `current` None: nothing is in force, and nothing speaks against. Nor does
        anything speak against a `new` one that a person went back to.

    Returns
    -------
    list of str
        One line each; empty where the new form may be taken over.
    """
    if current is None or is_rolled_back(new):
        return []
    found = _later(new.form, current.form)
    old_hz, new_hz = current.form.frequency_hz, new.form.frequency_hz
    if not 1.0 / _FREQUENCY <= new_hz / old_hz <= _FREQUENCY:
        found.append(
            f'hunts at {new_hz:.3g} Hz, the one in force at {old_hz:.3g} Hz: another rig?'
        )
    before, after = current.std('v_c'), new.std('v_c')
    if before > 0.0 and after > before * _WIDTH:
        found.append(f'widens the standard deviation of v_c from {before:.3f} to {after:.3f} m/s')
    return found


def _later(new: NormalForm, current: NormalForm) -> list[str]:
    """
    Say where `new` would alarm later than `current`: one line, or none.

    The two are compared by the amplitude beyond which each alarms, at every speed: that of the
    unstable branch; infinite where there is none and quiet motion is stable; zero where it is
    not. A speed is allowed to be off by `_SPEED`.
    """
    speeds = current.critical_speed * _PLACES
    before = _threshold(current, speeds)
    after = _threshold(new, speeds * _SPEED)
    late = np.flatnonzero(after > before * _AMPLITUDE)
    if not late.size:
        return []
    k = int(late[-1])
    words = f'alarms {_words(after[k])} at {speeds[k]:.2f} m/s, the one in force'
    return [f'{words} {_words(before[k])}']


def _words(amplitude: float) -> str:
    """Say beyond which amplitude, m, a form alarms."""
    if math.isinf(amplitude):
        return 'never'
    return f'beyond {1e3 * amplitude:.3g} mm' if amplitude > 0.0 else 'at any amplitude'


def _threshold(form: NormalForm, speeds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the amplitude beyond which the motion ends on the limit cycle, m."""
    unstable = form.unstable_amplitude(speeds)
    none = np.where(form.growth_rate(speeds) < 0.0, math.inf, 0.0)
    return np.where(np.isfinite(unstable), unstable, none)


def rolled_back(form: IdentifiedNormalForm) -> IdentifiedNormalForm:
    """Return the form with the mark that a person went back to it."""
    return replace(form, provenance={**form.provenance, _MARK: 'by the operator'})


def is_rolled_back(form: IdentifiedNormalForm) -> bool:
    """Whether a person went back to this form."""
    return _MARK in form.provenance


def form_event(form: IdentifiedNormalForm | None) -> tuple[str, str]:
    """Return the word and the cause of the event that a form was taken over."""
    if form is None:
        return 'normal_form_changed', 'no normal form is in force'
    if is_rolled_back(form):
        return 'normal_form_reverted', f'{form.words}: the operator went back to this normal form'
    return 'normal_form_changed', f'{form.words}: a new normal form is in force'
