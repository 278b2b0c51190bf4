"""
Fig. 6: the steady amplitudes as measured, speed up and speed down, and nothing else.

No model stands in this figure: the two critical speeds are those read off the jumps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from hunt_ros.report.figures import style
from hunt_ros.report.result import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def hysteresis_loop(
    result: Result, marks: Mapping[str, tuple[float, float]] | None = None
) -> Figure:
    """
    Draw the hysteresis loop.

    Parameters
    ----------
    result : Result
        Its `steady_states` and `observed` are shown.
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
        for direction in style.DIRECTIONS:
            states = result.steady_states(direction)
            _maxima(axes, states, direction)
            # Runs held at one speed each have no neighbours to be joined to.
            measured_points(axes, states, direction, joined=direction != 'hold')
        axes.margins(x=0.06)
        # Room above the loop for the names of the critical speeds.
        top = 1.3 * axes.get_ylim()[1]
        # A quiet state is a whole marker, not half of one on the axis.
        axes.set_ylim(-0.03 * top, top)
        _observed_speeds(axes, result)
        for letter, (speed, amplitude) in (marks or {}).items():
            axes.annotate(
                f'({letter})',
                (speed, style.MILLIMETRES * amplitude),
                xytext=(0, 5),
                textcoords='offset points',
                ha='center',
                color=style.INK,
            )
        if axes.get_legend_handles_labels()[0]:
            style.legend_above(axes, columns=2)
        return figure


def measured_points(
    axes: Axes, states: list[Mapping[str, Any]], direction: str, joined: bool = False
) -> None:
    """
    Plot measured steady amplitudes with their standard deviations.

    Parameters
    ----------
    axes : Axes
        Speed in m/s, amplitude in mm.
    states : list of mapping
        Entries of `steady_states`.
    direction : str
        Key of `style.DIRECTIONS`.
    joined : bool
        Join neighbours by a thin line, to follow the direction by eye.
    """
    if not states:
        return
    marker, colour, words = style.DIRECTIONS[direction]
    amplitudes = [style.MILLIMETRES * float(state['amplitude_m']) for state in states]
    spread = [style.MILLIMETRES * float(state.get('amplitude_std_m') or 0.0) for state in states]
    axes.errorbar(
        [float(state['speed_mps']) for state in states],
        amplitudes,
        yerr=spread if any(spread) else None,
        fmt=marker,
        color=colour,
        markerfacecolor='none',
        markeredgewidth=0.9,
        elinewidth=0.6,
        linestyle=(0, (1, 1.5)) if joined else 'none',
        linewidth=0.6,
        label=words,
        zorder=3,
    )


def has_maxima(result: Result) -> bool:
    """Whether the paper's amplitude is known of any steady state."""
    return any(state.get('maxima_m') is not None for state in result.steady_states())


def _maxima(axes: Axes, states: list[Mapping[str, Any]], direction: str) -> None:
    """Plot the paper's amplitude, pale behind the hunting component's."""
    known = [state for state in states if state.get('maxima_m') is not None]
    if not known:
        return
    marker, colour, _ = style.DIRECTIONS[direction]
    axes.plot(
        [float(state['speed_mps']) for state in known],
        [style.MILLIMETRES * float(state['maxima_m']) for state in known],
        marker,
        color=colour,
        markerfacecolor='none',
        markeredgewidth=0.6,
        markersize=2.6,
        alpha=0.45,
        zorder=2,
        label='mean of the maxima' if not _named(axes, 'mean of the maxima') else None,
    )


def _named(axes: Axes, label: str) -> bool:
    return label in axes.get_legend_handles_labels()[1]


def _observed_speeds(axes: Axes, result: Result) -> None:
    """Mark the critical speeds as read off the jumps, with half a speed step either side."""
    step = result.value('observed.step_mps') or 0.0
    seen = {key: result.value(f'observed.{key}') for key in ('v_n', 'v_c')}
    known = [speed for speed in seen.values() if speed is not None]
    left, right = axes.get_xlim()
    # Names beside each other, turned outwards where they would meet.
    crowded = len(known) == 2 and abs(known[1] - known[0]) < 0.35 * (right - left)
    sides = {'v_n': 'right', 'v_c': 'left'} if crowded else dict.fromkeys(seen, 'center')
    for key, speed in seen.items():
        if speed is None:
            continue
        # A name at the edge would lie on the numbers of the axis.
        if speed < left + 0.15 * (right - left):
            sides[key] = 'left'
        elif speed > right - 0.15 * (right - left):
            sides[key] = 'right'
        if step:
            axes.axvspan(speed - step / 2, speed + step / 2, color=style.GRID, lw=0, zorder=0)
        axes.axvline(speed, color=style.MUTED, linewidth=0.6, linestyle=(0, (4, 2)), zorder=1)
        axes.annotate(
            f'${key}$ observed\n{speed:.2f} m/s',
            (speed, 1.0),
            xycoords=('data', 'axes fraction'),
            xytext=(0, -1),
            textcoords='offset points',
            ha=sides[key],
            va='top',
            fontsize=6.5,
            color=style.MUTED,
            backgroundcolor=style.PAPER,
        )
    axes.set_xlim(left, right)
