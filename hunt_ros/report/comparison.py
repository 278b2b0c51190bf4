"""Recordings side by side: each identified by itself, in one diagram and one table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from hunt_ros.dynamics.normal_form import COEFFICIENTS
from hunt_ros.report.figures.diagram import MODEL_COLOURS, Curve, bifurcation_diagram, form_curve
from hunt_ros.report.numbers import rounded, shown
from hunt_ros.report.tables import SYMBOLS, table
from hunt_ros.samples import Uncertain, Unknown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hunt_ros.analysis.steady_state import SteadyState
    from hunt_ros.identification.result import Identification

#: Told apart by their colours.
MOST = len(MODEL_COLOURS)


def names_of(alone: Sequence[Identification]) -> list[str]:
    """Return a short name of each recording: the last part of its path, or all of it."""
    paths = [one.records[0].source for one in alone]
    short = [PurePath(path).name for path in paths]
    return short if len(set(short)) == len(short) else paths


def comparison_diagram(alone: Sequence[Identification]) -> Figure:
    """
    Draw the branches of several recordings, each identified by itself, over their points.

    Parameters
    ----------
    alone : sequence of Identification
        At most `MOST`; one without a normal form has points alone.

    Returns
    -------
    Figure
        One page wide.
    """
    forms = [one.normal_form.form for one in alone if one.normal_form is not None]
    speeds = [state.speed for one in alone for state in one.steady_states]
    speeds += [form.critical_speed for form in forms]
    speeds += [v_n for form in forms if (v_n := form.nonlinear_critical_speed) is not None]
    low, high = (min(speeds), max(speeds)) if speeds else (0.0, 1.0)
    margin = 0.05 * max(high - low, 0.05 * high)
    low, high = max(0.0, low - margin), high + margin
    curves = []
    states: dict[str, Sequence[SteadyState]] = {}
    for name, one, colour in zip(names_of(alone), alone, MODEL_COLOURS, strict=False):
        if one.normal_form is not None:
            curves.append(form_curve(one.normal_form.form, low, high, name, colour=colour))
        else:  # its points have a name all the same
            nothing = np.full(1, np.nan)
            curves.append(Curve(name, nothing, nothing, nothing, colour=colour))
        states[colour] = one.steady_states
    return bifurcation_diagram(curves, low, high, states)


def comparison_table(alone: Sequence[Identification]) -> str:
    """Return the critical speeds and coefficients side by side as HTML; of two, the difference."""
    rows = []
    for name in ('v_c', 'v_n', 'hysteresis_width', *COEFFICIENTS):
        found = [one.quantity(name) for one in alone]
        unit = '' if name in COEFFICIENTS else ' (m/s)'
        cells = [shown(None if isinstance(one, Unknown) else one) for one in found]
        if len(alone) == 2:
            cells += _difference(*found)
        rows.append([f'{SYMBOLS[name]}{unit}', *cells])
    header = ['', *map(escape, names_of(alone))]
    if len(alone) == 2:
        header += ['difference', 'in standard deviations']
    return table(header, rows, 'Each recording by itself, as if the others had not been made.')


def to_json(alone: Sequence[Identification]) -> list[dict[str, Any]]:
    """Return the entry `compared` of `hunt report --json`."""
    found = []
    for name, one in zip(names_of(alone), alone, strict=True):
        whole = one.to_json()
        keys = ('v_c', 'v_n', 'hysteresis_width', 'coefficients', 'warnings')
        found.append({'recording': name, **{key: whole[key] for key in keys}})
    return found


def _difference(first: Uncertain | Unknown, second: Uncertain | Unknown) -> list[str]:
    """Return the second less the first, and how many standard deviations that is."""
    if isinstance(first, Unknown) or isinstance(second, Unknown):
        return ['', '']
    std = math.hypot(first.std, second.std)
    change = Uncertain(second.value - first.value, std)
    known = 0.0 < std < math.inf
    return [rounded(change)[0], rounded(change.value / std, digits=2)[0] if known else '']
