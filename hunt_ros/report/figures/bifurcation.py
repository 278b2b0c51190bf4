"""
The figures of one identification: what was measured, and the normal form over it.

Fig. 6 is the loop as measured, without any model. Fig. 10 sets the identified
form against what was measured, with the bands in which the branches lie with 95 % probability.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from hunt_ros.report.figures import style
from hunt_ros.report.figures.diagram import (
    bands_of_draws,
    bifurcation_diagram,
    draw_states,
    form_curve,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hunt_ros.identification.result import Identification
    from hunt_ros.samples import Uncertain


def hysteresis_loop(
    one: Identification, marks: Mapping[str, tuple[float, float]] | None = None
) -> Figure:
    """
    Draw the steady amplitudes as measured, speed up and speed down.

    No model stands in this figure: the two critical speeds are those read off the jumps.

    Parameters
    ----------
    one : Identification
        Its `steady_states`, `observed` and `bracket` are shown.
    marks : mapping of str to (speed, amplitude), optional
        Letters to put beside points, m/s and m: the panels of Fig. 5.

    Returns
    -------
    Figure
        One column wide.

    References
    ----------
    The paper, Fig. 6 and Sect. 2.4.
    """
    with style.journal_style():
        figure = style.new_figure()
        axes = figure.subplots()
        style.frame(axes, style.SPEED_LABEL, style.AMPLITUDE_LABEL)
        for source in dict.fromkeys(state.source for state in one.steady_states):
            draw_states(axes, [x for x in one.steady_states if x.source == source], joined=True)
        _maxima(axes, one)
        _seen_without_model(axes, one)
        axes.margins(x=0.06)
        # Room above the loop for the names of the critical speeds.
        top = 1.3 * axes.get_ylim()[1]
        # A quiet state is a whole marker, not half of one on the axis.
        axes.set_ylim(-0.03 * top, top)
        _observed_speeds(axes, one)
        for letter, (speed, amplitude) in (marks or {}).items():
            axes.annotate(
                f'({letter})',
                (speed, style.MILLIMETRES * amplitude),
                xytext=(0, 5),
                textcoords='offset points',
                ha='center',
                color=style.INK,
            )
        style.legend_above(axes, columns=2)
        return figure


def identified_diagram(one: Identification) -> Figure:
    """
    Draw the branches of the identified form with their bands over the measured points.

    Parameters
    ----------
    one : Identification
        Without a normal form only what was measured is drawn.

    Returns
    -------
    Figure
        One page wide.

    References
    ----------
    The paper, Fig. 10.
    """
    if one.normal_form is None:
        return hysteresis_loop(one)
    form, states = one.normal_form.form, one.steady_states
    speeds = [state.speed for state in states]
    v_c, v_n = form.critical_speed, form.nonlinear_critical_speed
    first = v_n if v_n is not None else v_c
    low = min([*speeds, first - 0.05 * v_c]) - 0.01 * v_c
    high = max([*speeds, v_c + 0.05 * v_c]) + 0.01 * v_c
    curve = form_curve(form, low, high, bands=bands_of_draws(one.normal_form, low, high))
    figure = bifurcation_diagram([curve], low, high, {'': states}, columns=5)
    with style.journal_style():
        _seen_without_model(figure.axes[0], one)
        for name, speed in (('v_n', one.v_n), ('v_c', one.v_c)):
            if speed is not None:
                _critical_speed(figure.axes[0], name, speed)
    return figure


def _critical_speed(axes: Axes, name: str, speed: Uncertain) -> None:
    """Mark a critical speed of the form, with its 95 % interval as a bar at the bottom."""
    line = {'linewidth': 0.5, 'linestyle': ':', 'zorder': 0}
    style.upright(axes, speed.value, f'${name}$', style.MUTED, line, xytext=(2, -1))
    if math.isfinite(speed.low + speed.high):
        left, right = axes.get_xlim()
        axes.plot(
            [max(speed.low, left), min(speed.high, right)],
            [axes.get_ylim()[0]] * 2,
            color=style.INK,
            linewidth=2.5,
            solid_capstyle='butt',
            clip_on=False,
        )
        axes.set_xlim(left, right)


def _maxima(axes: Axes, one: Identification) -> None:
    """Plot the paper's amplitude, pale behind the hunting component's."""
    label: str | None = 'mean of the maxima'
    for direction, (marker, colour, _) in style.DIRECTIONS.items():
        known = [
            (state.speed, style.MILLIMETRES * state.maxima)
            for state in one.steady_states
            if state.direction == direction and math.isfinite(state.maxima)
        ]
        if known:
            axes.plot(
                *zip(*known, strict=True), marker, color=colour, markerfacecolor='none',
                markeredgewidth=0.6, markersize=2.6, alpha=0.45, zorder=2, label=label,
            )  # fmt: skip
            label = None


def _seen_without_model(axes: Axes, one: Identification) -> None:
    """Mark kicks that died, kicks that stayed, and the bounds of v_n that follow."""
    for kind, marker in (('died', 'v'), ('stayed', '^')):
        kicks = [
            (event.speed, style.MILLIMETRES * event.kick)
            for event in one.bracket.events
            if event.kind == kind and math.isfinite(event.kick)
        ]
        if kicks:
            label = f'kick that {kind}'
            axes.plot(
                *zip(*kicks, strict=True), marker, color=style.MUTED, mfc='none', label=label
            )
    low, high = one.bracket.v_n
    if one.bracket.coexistence and low is not None and high is not None:
        axes.axvspan(low, high, color=style.MUTED, alpha=0.12, lw=0, zorder=0)


def _observed_speeds(axes: Axes, one: Identification) -> None:
    """Mark the critical speeds as read off the jumps, with half a speed step either side."""
    step = one.observed.step or 0.0
    left, right = axes.get_xlim()
    for key, speed in {'v_n': one.observed.v_n, 'v_c': one.observed.v_c}.items():
        if speed is None:
            continue
        # The names are turned outwards; one at the edge would lie on the numbers of the axis.
        share = (speed - left) / (right - left)
        outwards = 'right' if key == 'v_n' else 'left'
        side = 'left' if share < 0.25 else 'right' if share > 0.75 else outwards
        if step:
            axes.axvspan(speed - step / 2, speed + step / 2, color=style.GRID, lw=0, zorder=0)
        line = {'linewidth': 0.6, 'linestyle': (0, (4, 2)), 'zorder': 1}
        style.upright(
            axes, speed, f'${key}$ observed\n{speed:.2f} m/s', style.MUTED, line,
            xytext=(3 if side == 'left' else -3, -1), ha=side, fontsize=6.5,
        )  # fmt: skip
    axes.set_xlim(left, right)
