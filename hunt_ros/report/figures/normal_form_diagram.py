"""
Figs. 9 and 10: the identified normal form, by itself and over the measured points.

Fig. 9 is the form alone, without dimensions. Fig. 10 sets it against what was
measured, with the bands in which the branches lie with 95 % probability.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.report.figures import style
from hunt_ros.report.figures.branch_lines import Bands, bands_of_draws, plot_form
from hunt_ros.report.figures.hysteresis import hysteresis_loop, measured_points
from hunt_ros.report.result import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hunt_ros.identification.result import Identification


def normal_form_alone(form: NormalForm) -> Figure:
    """
    Draw r against the detuning, with the Hopf point and the saddle-node.

    Parameters
    ----------
    form : NormalForm
        In the amplitude coordinate.

    Returns
    -------
    Figure
        One column wide.

    References
    ----------
    The paper, Fig. 9, Eqs. (26) to (28).
    """
    with style.journal_style():
        figure = style.new_figure()
        axes = figure.subplots()
        style.frame(axes, r'Detuning $\epsilon = v/v_c - 1$', r'Amplitude $r$')
        v_c, fold = form.critical_speed, form.saddle_node()
        below = v_c - fold[0] if fold else 0.15 * v_c
        plot_form(axes, form, v_c - 1.3 * below, v_c + 0.7 * below, dimensionless=True)
        points = [('Hopf point', 0.0, 0.0, (4, 5))]
        if fold:
            eps, r = float(form.detuning(fold[0])), 0.5 * fold[1] / form.length_scale
            points.append(('saddle-node', eps, r, (7, -2)))
        for words, x, y, offset in points:
            axes.plot([x], [y], 'o', color=style.INK, zorder=4)
            axes.annotate(words, (x, y), xytext=offset, textcoords='offset points', fontsize=6.5)
        style.legend_above(axes)
        return figure


def diagram(identified: IdentifiedNormalForm, result: Result) -> Figure:
    """
    Draw the branches of the identified form with their bands over the measured points.

    Parameters
    ----------
    identified : IdentifiedNormalForm
        The form, and where the document has no intervals, its covariance.
    result : Result
        Measured points, and the intervals of the branches.

    Returns
    -------
    Figure
        One page wide.

    References
    ----------
    The paper, Fig. 10.
    """
    form = identified.form
    speeds = [float(state['speed_mps']) for state in result.steady_states()]
    v_c, v_n = form.critical_speed, form.nonlinear_critical_speed
    first = v_n if v_n is not None else v_c
    low = min([*speeds, first - 0.05 * v_c]) - 0.01 * v_c
    high = max([*speeds, v_c + 0.05 * v_c]) + 0.01 * v_c
    with style.journal_style():
        figure = style.new_figure(style.PAGE, 0.5 * style.PAGE)
        axes = figure.subplots()
        style.frame(axes, style.SPEED_LABEL, style.AMPLITUDE_LABEL)
        shaded = bands_of_document(result.branches()) or bands_of_draws(identified, low, high)
        for name, colour in (('stable', style.STABLE), ('unstable', style.UNSTABLE)):
            if name in shaded:
                speed, lower, upper = shaded[name]
                mm = style.MILLIMETRES
                axes.fill_between(speed, mm * lower, mm * upper, color=colour, alpha=0.18, lw=0)
        plot_form(axes, form, low, high)
        for direction in style.DIRECTIONS:
            measured_points(axes, result.steady_states(direction), direction)
        top = max(
            [style.MILLIMETRES * float(s['amplitude_m']) for s in result.steady_states()]
            + [style.MILLIMETRES * float(np.nanmax(form.stable_amplitude(np.linspace(v_c, high))))]
        )
        top = 1.15 * top if math.isfinite(top) else axes.get_ylim()[1]
        axes.set_ylim(-0.04 * top, top)
        _critical_speed(axes, result, 'v_n')
        _critical_speed(axes, result, 'v_c')
        style.legend_above(axes, columns=5)
        return figure


def identified_diagram(identification: Identification) -> Figure:
    """Draw an identification: `diagram`, or only what was measured where it has no form."""
    result = Result(identification.to_json())
    if identification.normal_form is None:
        return hysteresis_loop(result)
    return diagram(identification.normal_form, result)


def bands_of_document(branches: Sequence[Mapping[str, Any]]) -> Bands:
    """
    Read the bands of the branches from the intervals of a document.

    Returns
    -------
    dict
        'stable', 'unstable' -> speed (m/s), lower and upper edge (m), each shape (n,);
        a branch without two intervals is left out.
    """
    bands: Bands = {}
    for name in ('stable', 'unstable'):
        rows = [
            (float(point['speed_mps']), *map(float, point[f'{name}_ci95_m']))
            for point in branches
            if point.get(f'{name}_ci95_m') is not None
        ]
        if len(rows) >= 2:
            speed, lower, upper = np.array(rows).T
            bands[name] = (speed, np.maximum(lower, 0.0), upper)
    return bands


def _critical_speed(axes: Axes, result: Result, key: str) -> None:
    """Mark a critical speed of the form, with its 95 % interval as a bar at the bottom."""
    entry = result.get(key)
    if not isinstance(entry, Mapping) or entry.get('value') is None:
        return
    value = float(entry['value'])
    axes.axvline(value, color=style.MUTED, linewidth=0.5, linestyle=':', zorder=0)
    label = f'$v_{key[-1]}$'
    axes.annotate(
        label,
        (value, 1.0),
        xycoords=('data', 'axes fraction'),
        xytext=(2, -1),
        textcoords='offset points',
        va='top',
        color=style.MUTED,
    )
    if entry.get('ci95') is not None:
        low, high = (float(x) for x in entry['ci95'])
        left, right = axes.get_xlim()
        axes.plot(
            [max(low, left), min(high, right)],
            [axes.get_ylim()[0]] * 2,
            color=style.INK,
            linewidth=2.5,
            solid_capstyle='butt',
            clip_on=False,
        )
        axes.set_xlim(left, right)
