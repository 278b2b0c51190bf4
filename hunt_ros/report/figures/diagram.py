"""
The bifurcation diagram: branches of any model, their bands, and measured points.

Stable is solid and unstable dashed in every figure (the paper, Figs. 4 and 10).
`draw_branches` and `draw_states` draw all of them; the figures around choose what is shown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.limit_cycle import Branch
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.report.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hunt_ros.analysis.steady_state import SteadyState

Array = NDArray[np.float64]
#: 'stable', 'unstable' -> speed (m/s), lower and upper edge (m), each shape (n,).
Bands = Mapping[str, tuple[Array, Array, Array]]

MODEL_COLOURS = tuple(
    style.COLOURS[role][0] for role in ('ink', 'stable', 'unstable', 'up', 'down', 'roughness')
)
#: Points of a branch over the speeds of a figure.
_POINTS = 801
#: Draws behind a band.
_DRAWS = 400
#: A band is drawn where at least this share of the draws has the branch.
_MOST = 0.8


@dataclass(frozen=True, eq=False)
class Curve:
    """
    Steady states of one model.

    Parameters
    ----------
    label : str
        For the legend; unused without a colour.
    speed, unstable, stable : ndarray, shape (n,)
        m/s and m; NaN where there is no branch.
    quiet_unstable : ndarray of bool, shape (n,), optional
        Where the quiet state grows; without it that state is not drawn.
    bands : mapping
        Regions to shade.
    colour : str
        Of the model; '' for the colours of stable and unstable states, which are then named.
    look : mapping
        Further properties of its lines; dashes here hold for both branches.
    """

    label: str
    speed: Array
    unstable: Array
    stable: Array
    quiet_unstable: NDArray[np.bool_] | None = None
    bands: Bands = field(default_factory=dict)
    colour: str = ''
    look: Mapping[str, Any] = field(default_factory=dict)


def branch_points(form: NormalForm, low: float, high: float) -> tuple[Array, Array, Array]:
    """
    Both branches over a range of speeds, joined where they meet.

    Parameters
    ----------
    form : NormalForm
        Whatever its kind.
    low, high : float
        m/s.

    Returns
    -------
    speed, unstable, stable : ndarray
        m/s and m; NaN where there is no branch. The fold and the Hopf point are among
        the speeds, so that no rounding opens the ends of the curves.
    """
    fold = form.saddle_node()
    v_c = form.critical_speed
    special = [x for x in (v_c, fold[0] if fold else v_c) if low <= x <= high]
    speed = np.union1d(np.linspace(low, high, _POINTS), special)
    if fold and low < fold[0] < high:  # the square root's end needs points close to it
        speed = np.union1d(speed, fold[0] + (high - fold[0]) * np.linspace(0, 0.1, 40) ** 2)
    unstable, stable = form.steady_amplitudes(speed)
    if fold:
        at = speed == fold[0]
        unstable[at] = stable[at] = fold[1]
    unstable[(speed == v_c) & np.isnan(unstable)] = 0.0 if form.D4 > 0.0 else np.nan
    stable[(speed == v_c) & np.isnan(stable)] = 0.0 if form.D4 < 0.0 else np.nan
    return speed, unstable, stable


def form_curve(form: NormalForm, low: float, high: float, label: str = '', **more: Any) -> Curve:
    """Steady states of a normal form between two speeds, m/s; `more`: further fields."""
    speed, unstable, stable = branch_points(form, low, high)
    # By its own growth rate: D7 can bring the quiet state back at another speed.
    return Curve(label, speed, unstable, stable, form.growth_rate(speed) > 0.0, **more)


def branch_curve(branch: Branch, label: str, **more: Any) -> Curve:
    """Limit cycles of the full model, as `limit_cycles` followed them."""
    stable = branch.stable
    # A cycle at the change belongs to both, so that the line is not broken there.
    joined = stable | np.append(stable[1:], False)
    amplitude = branch.amplitude
    return Curve(
        label, branch.speed, np.where(~stable, amplitude, np.nan),
        np.where(joined, amplitude, np.nan), **more,
    )  # fmt: skip


def bands_of_draws(
    identified: IdentifiedNormalForm, low: float, high: float, seed: int = 0
) -> Bands:
    """
    Take the bands of the branches from the forms that are as likely: 2.5 % to 97.5 % of them.

    Parameters
    ----------
    identified : IdentifiedNormalForm
        Without a covariance there are no bands.
    low, high : float
        Speeds, m/s.
    seed : int
        Of the draws.

    Returns
    -------
    dict
        Only where most draws have the branch.
    """
    if not identified.covariance.any():
        return {}
    speed = np.linspace(low, high, 241)
    drawn = [form.steady_amplitudes(speed) for form in identified.draws(_DRAWS, seed)]
    bands = {}
    for name, index in (('unstable', 0), ('stable', 1)):
        amplitudes = np.array([pair[index] for pair in drawn])
        often = np.isfinite(amplitudes).mean(axis=0) >= _MOST
        if often.sum() >= 2:
            lower, upper = np.nanpercentile(amplitudes[:, often], [2.5, 97.5], axis=0)
            bands[name] = (speed[often], lower, upper)
    return bands


def draw_branches(axes: Axes, curves: Sequence[Curve]) -> None:
    """
    Draw models, whatever they are of.

    Parameters
    ----------
    axes : Axes
        To draw into; labels and limits are its owner's.
    curves : sequence of Curve
        The first is drawn on top.
    """
    scale = style.MILLIMETRES
    for place, curve in enumerate(curves):
        look = {'zorder': 3.0 - 0.1 * place, **curve.look}
        own = {'stable': style.STABLE, 'unstable': style.UNSTABLE}
        colours = dict.fromkeys(own, curve.colour) if curve.colour else own
        for name, (speed, lower, upper) in curve.bands.items():
            axes.fill_between(
                speed, scale * lower, scale * upper, color=colours[name], alpha=0.18, lw=0
            )
        labels = {'stable': curve.label, 'unstable': ''} if curve.colour else {n: n for n in own}
        for name, values, dashes in (
            ('stable', curve.stable, '-'), ('unstable', curve.unstable, '--'),
        ):  # fmt: skip
            axes.plot(
                curve.speed, scale * values,
                **{'linestyle': dashes, **look}, color=colours[name], label=labels[name] or None,
            )  # fmt: skip
        if curve.quiet_unstable is not None:
            growing = curve.quiet_unstable
            for there, name, dashes in ((~growing, 'stable', '-'), (growing, 'unstable', '--')):
                edge = there | np.append(there[1:], False) | np.append(False, there[:-1])
                quiet = np.where(edge if dashes == '--' else there, 0.0, np.nan)
                drawn = {'color': colours[name], 'linestyle': dashes, 'zorder': look['zorder']}
                axes.plot(curve.speed, quiet, **drawn)


def draw_states(
    axes: Axes, states: Sequence[SteadyState], colour: str = '', joined: bool = False
) -> None:
    """
    Draw measured steady amplitudes with their standard deviations, mm against m/s.

    Parameters
    ----------
    axes : Axes
        To draw into.
    states : sequence of SteadyState
        Markers tell the direction of the speed.
    colour : str
        '' for that of the direction.
    joined : bool
        Join neighbours by a thin line, to follow the direction by eye.
    """
    for direction, (marker, usual, label) in style.DIRECTIONS.items():
        chosen = sorted((x for x in states if x.direction == direction), key=lambda x: x.speed)
        if not chosen:
            continue
        std = np.array([state.amplitude_std for state in chosen])
        # Runs held at one speed each have no neighbours to be joined to.
        dotted = joined and direction != 'hold'
        axes.errorbar(
            [state.speed for state in chosen],
            [style.MILLIMETRES * state.amplitude for state in chosen],
            yerr=style.MILLIMETRES * np.where(np.isfinite(std), std, 0.0),
            fmt=marker,
            color=colour or usual,
            markerfacecolor='none',
            markeredgewidth=0.9,
            elinewidth=0.6,
            linestyle=(0, (1, 1.5)) if dotted else 'none',
            linewidth=0.6,
            label=None if label in axes.get_legend_handles_labels()[1] else label,
            zorder=4,
        )


def bifurcation_diagram(
    curves: Sequence[Curve],
    low: float,
    high: float,
    states: Mapping[str, Sequence[SteadyState]] | None = None,
    highest: float | None = None,
    columns: int = 3,
) -> Figure:
    """
    Draw a figure of models and measurements, one page wide.

    Parameters
    ----------
    curves : sequence of Curve
        The first is drawn on top.
    low, high : float
        Speeds shown, m/s.
    states : mapping of str to sequence of SteadyState
        Measurements by their colour, see `draw_states`.
    highest : float, optional
        Largest amplitude shown, m; default: what is drawn, and a little more.
    columns : int
        Of the legend.
    """
    states = states or {}
    with style.journal_style():
        figure = style.new_figure(style.PAGE, 0.5 * style.PAGE)
        axes = figure.subplots()
        style.frame(axes, style.SPEED_LABEL, style.AMPLITUDE_LABEL)
        draw_branches(axes, curves)
        for colour, measured in states.items():
            draw_states(axes, measured, colour)
        if highest is None:
            amplitudes = [x.amplitude for measured in states.values() for x in measured]
            values = [np.array([0.0, *amplitudes])]
            for curve in curves:
                inside = (curve.speed >= low) & (curve.speed <= high)
                # What is unstable lies below what is stable, or runs away.
                known = np.isfinite(curve.stable[inside]).any()
                values.append((curve.stable if known else curve.unstable)[inside])
            highest = 1.12 * float(np.nanmax(np.concatenate(values)))
        top = style.MILLIMETRES * highest or 1.0
        axes.set_xlim(low, high)
        axes.set_ylim(-0.03 * top, top)
        style.legend_above(axes, columns)
        return figure
