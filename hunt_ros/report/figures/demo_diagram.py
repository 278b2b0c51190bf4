"""The picture at the end of the demo: what was measured, what was refitted, and the truth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.report.figures import style
from hunt_ros.report.figures.branch_lines import bands_of_draws, branch_points, plot_form

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hunt_ros.analysis.steady_state import SteadyState
    from hunt_ros.dynamics.limit_cycle import Branch


def draw_demo_diagram(
    identified: IdentifiedNormalForm,
    states: Sequence[SteadyState],
    truth: Branch,
    path: Path,
    speeds: tuple[float, float] = (5.9, 8.9),
) -> None:
    """
    Draw the refitted branches with their bands over the measured amplitudes and the truth.

    Parameters
    ----------
    identified : IdentifiedNormalForm
        Refitted from the recording.
    states : sequence of SteadyState
        Measured amplitudes.
    truth : Branch
        Limit cycles of the simulated rig.
    path : Path
        PNG to write.
    speeds : (float, float)
        Range of the speed axis, m/s.
    """
    low, high = speeds
    figure = style.new_figure(style.PAGE, 0.5 * style.PAGE)
    with style.journal_style():
        axes = figure.add_subplot()
        style.frame(axes, style.SPEED_LABEL, style.AMPLITUDE_LABEL)
        colours = {'stable': style.STABLE, 'unstable': style.UNSTABLE}
        for name, (speed, lower, upper) in bands_of_draws(identified, low, high).items():
            axes.fill_between(
                speed,
                style.MILLIMETRES * lower,
                style.MILLIMETRES * upper,
                color=colours[name],
                alpha=0.2,
                linewidth=0.0,
            )
        plot_form(axes, identified.form, low, high)
        inside = (truth.speed >= low) & (truth.speed <= high)
        axes.plot(
            truth.speed[inside],
            style.MILLIMETRES * truth.amplitude[inside],
            color=style.INK,
            linewidth=0.8,
            linestyle=(0, (1, 1.2)),
            label='truth of the simulated rig',
        )
        speed, unstable, stable = branch_points(PAPER_NORMAL_FORM, low, high)
        for branch, label in ((unstable, 'coefficients (33) of the paper'), (stable, None)):
            axes.plot(
                speed,
                style.MILLIMETRES * branch,
                color=style.MUTED,
                linewidth=0.7,
                linestyle='-.',
                label=label,
            )
        _measured(axes, states)
        axes.set_ylim(bottom=0.0)
        style.legend_above(axes, columns=4)
        figure.savefig(path, dpi=200, facecolor=style.PAPER)


def _measured(axes: Axes, states: Sequence[SteadyState]) -> None:
    """Plot the measured amplitudes, each direction with its marker."""
    for direction, (marker, colour, words) in style.DIRECTIONS.items():
        chosen = [state for state in states if state.direction == direction]
        if chosen:
            axes.plot(
                [state.speed for state in chosen],
                [style.MILLIMETRES * state.amplitude for state in chosen],
                marker,
                color=colour,
                markerfacecolor='none',
                markeredgewidth=0.8,
                label=f'measured, {words}',
            )
