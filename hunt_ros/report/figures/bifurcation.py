"""
One bifurcation diagram of several models: normal forms, full-model branches, measured points.

Each model has one colour; stable is solid and unstable dashed, as in the paper's Figs. 4, 9
and 10. The figures of a report have modules of their own; this one compares models.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.limit_cycle import Branch
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.report.figures import style
from hunt_ros.report.figures.branch_lines import branch_points

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_MODEL_COLOURS = tuple(
    style.COLOURS[role][0] for role in ('ink', 'stable', 'unstable', 'up', 'down', 'roughness')
)


@dataclass(frozen=True, eq=False)
class Curve:
    """
    Steady amplitudes of one model.

    Parameters
    ----------
    label : str
        For the legend.
    speed, unstable, stable : ndarray, shape (n,)
        m/s and m; NaN where there is no branch.
    band : tuple of ndarray, optional
        speed (m/s), lower and upper edge (m) of a region to shade.
    """

    label: str
    speed: Array
    unstable: Array
    stable: Array
    band: tuple[Array, Array, Array] | None = None


@dataclass(frozen=True, eq=False)
class Points:
    """
    Measured steady amplitudes of one direction of the speed.

    Parameters
    ----------
    direction : 'up', 'down' or 'hold'
        Gives marker and legend.
    speed, amplitude : ndarray, shape (n,)
        m/s and m.
    std : ndarray, shape (n,), optional
        Standard deviation of the amplitude, m: drawn as an error bar.
    """

    direction: str
    speed: Array
    amplitude: Array
    std: Array | None = None


def form_curve(form: NormalForm, low: float, high: float, label: str) -> Curve:
    """Steady states of a normal form between two speeds, m/s."""
    return Curve(label, *branch_points(form, low, high))


def branch_curve(branch: Branch, label: str) -> Curve:
    """Limit cycles of the full model, as `limit_cycles` followed them."""
    stable = branch.stable
    # A cycle at the change belongs to both, so that the line is not broken there.
    joined = stable | np.append(stable[1:], False)
    return Curve(
        label,
        branch.speed,
        np.where(~stable, branch.amplitude, np.nan),
        np.where(joined, branch.amplitude, np.nan),
    )


def bifurcation_diagram(
    curves: Sequence[Curve],
    low: float,
    high: float,
    points: Sequence[Points] = (),
    critical_speed: float | None = None,
    highest: float | None = None,
) -> Figure:
    """
    Draw models and measurements into one picture.

    Parameters
    ----------
    curves : sequence of Curve
        The first is drawn on top; up to six have colours of their own.
    low, high : float
        Speeds shown, m/s.
    points : sequence of Points
        Measurements.
    critical_speed : float, optional
        v_c, m/s: the quiet state is drawn stable below and unstable above it.
    highest : float, optional
        Largest amplitude shown, m; default: what is drawn, and a little more.

    Returns
    -------
    Figure
        One page wide.
    """
    mm = style.MILLIMETRES
    with style.journal_style():
        figure = style.new_figure(style.PAGE, 0.5 * style.PAGE)
        axes = figure.subplots()
        style.frame(axes, style.SPEED_LABEL, style.AMPLITUDE_LABEL)
        for place, curve in enumerate(curves):
            colour = _MODEL_COLOURS[place % len(_MODEL_COLOURS)]
            order = 3.0 - 0.1 * place
            if curve.band is not None:
                speed, lower, upper = curve.band
                axes.fill_between(
                    speed, mm * lower, mm * upper, color=colour, alpha=0.18, linewidth=0
                )
            axes.plot(
                curve.speed, mm * curve.stable, color=colour, label=curve.label, zorder=order
            )
            axes.plot(curve.speed, mm * curve.unstable, color=colour, linestyle='--', zorder=order)
        for group in points:
            marker, colour, label = style.DIRECTIONS[group.direction]
            std = None if group.std is None else mm * group.std
            axes.errorbar(
                group.speed,
                mm * group.amplitude,
                yerr=std,
                fmt=marker,
                color=colour,
                markerfacecolor='none',
                label=label,
                zorder=4,
            )
        if critical_speed is not None:
            axes.plot([low, critical_speed], [0.0, 0.0], color=style.MUTED)
            axes.plot([critical_speed, high], [0.0, 0.0], color=style.MUTED, linestyle='--')
        axes.set_xlim(low, high)
        top = mm * highest if highest else _top(curves, points, low, high)
        axes.set_ylim(-0.03 * top, top)
        style.legend_above(axes, columns=3)
        return figure


def _top(curves: Sequence[Curve], points: Sequence[Points], low: float, high: float) -> float:
    """Upper end of the amplitude axis, mm."""
    values = [np.zeros(1)] + [group.amplitude for group in points]
    for curve in curves:
        shown = (curve.speed >= low) & (curve.speed <= high)
        values += [curve.stable[shown], curve.unstable[shown]]
    largest = float(np.nanmax(np.concatenate(values)))
    return 1.12 * style.MILLIMETRES * largest if largest > 0.0 else 1.0
