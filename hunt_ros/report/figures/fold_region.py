"""The fold and the amplitude there, as far as they are known together."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hunt_ros.identification.posterior import QUANTITIES, Posterior
from hunt_ros.report.figures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Share of a two-dimensional normal distribution inside each ellipse.
_SHARES = (0.68, 0.95)


def fold_region(posterior: Posterior) -> Figure:
    """
    Draw v_n and the amplitude at it, draw by draw, and the region that holds most of them.

    Parameters
    ----------
    posterior : Posterior
        Draws; those without a fold are left out.

    Returns
    -------
    Figure
        One column wide.
    """
    columns = [QUANTITIES.index(name) for name in ('v_n', 'fold_amplitude')]
    rows = posterior.table[:, columns] * np.array([1.0, style.MILLIMETRES])
    rows = rows[np.isfinite(rows).all(axis=1)]
    # Half the central 68 %: far draws do not stretch it.
    below, middle, above = np.percentile(rows, [15.87, 50.0, 84.13], axis=0)
    std = 0.5 * (above - below)
    correlation = posterior.correlations()[columns[0], columns[1]]
    turn = np.linspace(0.0, 2.0 * math.pi, 181)
    # A circle, made an ellipse by the Cholesky factor of the correlation.
    circle = np.stack([np.cos(turn), np.sin(turn)])
    circle[1] = correlation * circle[0] + math.sqrt(max(1.0 - correlation**2, 0.0)) * circle[1]
    with style.journal_style():
        figure = style.new_figure()
        axes = figure.subplots()
        style.frame(axes, r'Nonlinear critical speed $v_n$ (m/s)', 'Amplitude there (mm)')
        axes.plot(*rows.T, '.', color=style.MUTED, markersize=2.0, alpha=0.5)
        for share, dashes in zip(_SHARES, ('-', '--'), strict=True):
            radius = math.sqrt(-2.0 * math.log(1.0 - share))
            ellipse = middle[:, None] + radius * std[:, None] * circle
            axes.plot(*ellipse, dashes, color=style.STABLE, label=f'{100.0 * share:.0f} %')
        # Far draws are there, and do not set the scale.
        low, high = middle - 4.5 * std, middle + 4.5 * std
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        style.legend_above(axes)
        return figure
