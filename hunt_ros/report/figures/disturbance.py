"""
Fig. 11: the size of the disturbance, read off the width of the hysteresis (Appendix A).

A disturbance throws the wheelset out of the quiet basin where the unstable amplitude
has come down to it, below v_c; and down off the limit cycle where the two branches
have come as close as that, above v_n.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.report.figures import style
from hunt_ros.report.figures.branch_lines import plot_form

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def disturbance_from_width(
    form: NormalForm, observed: tuple[float | None, float | None], disturbance: float | None
) -> Figure:
    """
    Draw the branches with no disturbance, and with the one that the measured width gives.

    Parameters
    ----------
    form : NormalForm
        Subcritical, with a fold: without one there is no width to speak of.
    observed : (v_n, v_c)
        As read off the jumps, m/s; None where there was no jump.
    disturbance : float or None
        Its size as an amplitude, m; None where it is not known.

    Returns
    -------
    Figure
        One page wide: (a) an infinitely small disturbance, (b) the measured one.

    References
    ----------
    The paper, Appendix A, Fig. 11.
    """
    with style.journal_style():
        figure = style.new_figure(style.PAGE, 0.36 * style.PAGE)
        left, right = figure.subplots(1, 2, sharex=True, sharey=True)
        fold, v_c = form.nonlinear_critical_speed, form.critical_speed
        for axes, title in ((left, '(a) no disturbance'), (right, '(b) as measured')):
            _branches(axes, form)
            style.frame(axes, style.SPEED_LABEL, style.AMPLITUDE_LABEL)
            axes.set_title(title)
        top = left.get_ylim()[1]
        left.set_ylim(-0.04 * top, 1.25 * top)  # shared: room above for the width
        right.set_ylabel('')
        left.legend(loc='center right')
        _width(left, fold, v_c, r'$\Delta v_\mathrm{cr}$')
        _width(right, *observed, r'$\Delta v_\mathrm{cr}$')
        _threshold_arrows(right, form, observed)
        if disturbance is not None:
            size = style.MILLIMETRES * disturbance
            right.axhline(size, color=style.INK, linewidth=0.7, linestyle=(0, (1, 2)))
            right.annotate(
                f'disturbance {size:.3g} mm',
                (1.0, size),
                xycoords=('axes fraction', 'data'),
                xytext=(0, 2),
                textcoords='offset points',
                ha='right',
                va='bottom',
                fontsize=6.5,
            )
        else:
            words = 'disturbance not known'
            right.text(0.98, 0.42, words, transform=right.transAxes, ha='right')
        return figure


def _branches(axes: Axes, form: NormalForm) -> None:
    """Plot the branches around the hysteresis region."""
    v_c, fold = form.critical_speed, form.nonlinear_critical_speed
    low = v_c - 1.45 * (v_c - fold) if fold else 0.8 * v_c
    high = v_c + 0.6 * (v_c - low)
    plot_form(axes, form, low, high)


def _width(axes: Axes, low: float | None, high: float | None, symbol: str) -> None:
    """Draw the width between two critical speeds as a measure above the branches."""
    for speed in (low, high):
        if speed is not None:
            axes.axvline(speed, color=style.MUTED, linewidth=0.5, linestyle=':')
    if low is None or high is None:
        axes.text(0.5, 0.93, 'width not known', transform=axes.transAxes, ha='center')
        return
    height = 0.94 * axes.get_ylim()[1]
    axes.annotate(
        '', (low, height), (high, height), arrowprops={'arrowstyle': '<->', 'linewidth': 0.7}
    )
    axes.annotate(
        f'{symbol} = {high - low:.2f} m/s',
        (0.5 * (low + high), height),
        xytext=(0, -3),
        textcoords='offset points',
        ha='center',
        va='top',
    )


def _threshold_arrows(
    axes: Axes, form: NormalForm, observed: tuple[float | None, float | None]
) -> None:
    """Draw the disturbance as thick arrows where it crosses the unstable branch."""
    v_n, v_c = observed
    mm = style.MILLIMETRES
    arrows = []
    if v_c is not None:
        arrows.append((v_c, 0.0, float(form.unstable_amplitude(v_c))))
    if v_n is not None:
        unstable, stable = (float(x) for x in form.steady_amplitudes(v_n))
        arrows.append((v_n, stable, unstable))
    for speed, start, end in arrows:
        if not np.isfinite(start + end):
            continue  # the jump was seen outside the hysteresis region of the model
        axes.annotate(
            '',
            (speed, mm * end),
            (speed, mm * start),
            arrowprops={
                'arrowstyle': '-|>',
                'linewidth': 2.0,
                'color': style.INK,
                'shrinkA': 0.0,
                'shrinkB': 0.0,
            },
        )
