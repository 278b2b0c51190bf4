"""
Fig. 3: the normal form cut off after its cubic term, over the measured points.

It has the Hopf point and the start of the unstable branch, but nothing that the
wheelset could settle on: what was measured lies on no branch of it, which is why the
quintic term is needed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.report.figures import style
from hunt_ros.report.figures.hysteresis import measured_points
from hunt_ros.report.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def cubic_amplitude(form: NormalForm, speed: ArrayLike) -> NDArray[np.float64]:
    """
    Nontrivial steady amplitude of the cubic normal form, 2 d0 sqrt(-D1 eps / D4).

    Parameters
    ----------
    form : NormalForm
        Of which only v_c, D1, D4 and d0 count.
    speed : array_like
        m/s, any shape.

    Returns
    -------
    ndarray
        m; NaN where there is none. Unstable where D4 > 0, stable where D4 < 0.

    References
    ----------
    The paper, Eq. (28) with D'7 = D'10 = D'15 = 0; Fig. 3.
    """
    if form.D4 == 0.0:
        return np.full(np.shape(speed), np.nan)
    square = -form.D1 * form.detuning(speed) / form.D4
    amplitude: NDArray[np.float64] = (
        2.0 * form.length_scale * np.sqrt(np.where(square >= 0.0, square, np.nan))
    )
    return amplitude


def cubic_alone(form: NormalForm, result: Result) -> Figure:
    """
    Draw the branches of the cubic form and the measured points.

    Parameters
    ----------
    form : NormalForm
        The identified form.
    result : Result
        Its measured steady states are shown.

    Returns
    -------
    Figure
        One column wide.
    """
    with style.journal_style():
        figure = style.new_figure()
        axes = figure.subplots()
        style.frame(axes, style.SPEED_LABEL, style.AMPLITUDE_LABEL)
        speeds = [float(state['speed_mps']) for state in result.steady_states()]
        v_c = form.critical_speed
        low, high = min([*speeds, 0.8 * v_c]), max([*speeds, 1.1 * v_c])
        speed = np.union1d(np.linspace(low, high, 601), [v_c])
        unstable = form.D4 > 0.0
        mm = style.MILLIMETRES
        axes.plot(
            speed,
            mm * cubic_amplitude(form, speed),
            color=style.UNSTABLE if unstable else style.STABLE,
            linestyle='--' if unstable else '-',
            label=f'cubic form, {"unstable" if unstable else "stable"}',
        )
        axes.plot([low, v_c], [0.0, 0.0], color=style.STABLE, label='quiet state, stable')
        axes.plot(
            [v_c, high], [0.0, 0.0], color=style.UNSTABLE, linestyle='--', label='_nolegend_'
        )
        for direction in style.DIRECTIONS:
            measured_points(axes, result.steady_states(direction), direction)
        amplitudes = [mm * float(state['amplitude_m']) for state in result.steady_states()]
        top = max([*amplitudes, mm * float(cubic_amplitude(form, low if unstable else high))])
        axes.set_xlim(low - 0.03 * (high - low), high + 0.03 * (high - low))
        axes.set_ylim(-0.04 * top, 1.08 * top)
        style.legend_above(axes)
        return figure
