"""Figs. 5 and 7: the panels of one speed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from hunt_ros.report.figures import style
from hunt_ros.report.response import Response

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hunt_ros.analysis.phase_portrait import PhasePortrait
    from hunt_ros.analysis.poincare import PoincareSection
    from hunt_ros.analysis.spectrum import Spectrum

_Kind = TypeVar('_Kind')

#: Length of the time history, s.
_SHOWN_S = 4.0
#: Points of the phase portrait: enough for a closed band, few enough for a small file.
_PORTRAIT_POINTS = 3000
#: Highest frequency shown in the spectrum, Hz, where the data reach it.
_TOP_HZ = 15.0


def response_panels(response: Response, letter: str = '') -> Figure:
    """
    Draw the four panels of one speed.

    Parameters
    ----------
    response : Response
        What is shown.
    letter : str
        Of the panel group, 'a' to 'd'.

    Returns
    -------
    Figure
        Half a page wide: four of them make the paper's Fig. 5, two Fig. 7.
    """
    with style.journal_style():
        figure = style.new_figure(style.PAGE / 2, 0.58 * style.PAGE)
        axes = figure.subplot_mosaic('hhh;spm')
        head = f'({letter}) ' if letter else ''
        axes['h'].set_title(f'{head}{response.speed:.2f} m/s')
        history = response if response.time.size else None
        plane = r'$y$ (mm)', r'$\dot{y}$ (mm/s)'
        _panel(axes['h'], 'Time (s)', r'$y$ (mm)', history, _history)
        _panel(axes['s'], 'Frequency (Hz)', r'PSD (mm$^2$/Hz)', response.spectrum, _spectrum)
        _panel(axes['p'], *plane, response.portrait, _portrait)
        _panel(axes['m'], *plane, response.section, _section)
        if response.section and response.portrait:
            # On the scale of the whole orbit, or a point would look like a cloud.
            _centred(axes['m'], _points(response.portrait))
        return figure


def _panel(
    axes: Axes, xlabel: str, ylabel: str, what: _Kind | None, draw: Callable[[Axes, _Kind], None]
) -> None:
    """Draw what a panel shows, or that it is not known."""
    style.frame(axes, xlabel, ylabel)
    if what is not None:
        draw(axes, what)
        return
    axes.text(0.5, 0.5, 'not known', transform=axes.transAxes, ha='center', va='center')
    axes.set_xticks([])
    axes.set_yticks([])


def _section(axes: Axes, section: PoincareSection) -> None:
    points = _points(section)
    axes.plot(points[:, 0], points[:, 1], '.', color=style.STABLE, markersize=2.5)
    _centred(axes, points)


def _history(axes: Axes, response: Response) -> None:
    start = max(float(response.time[-1]) - _SHOWN_S, 0.0)
    shown = response.time >= start
    axes.plot(
        response.time[shown] - start,
        style.MILLIMETRES * response.lateral[shown],
        color=style.INK,
        linewidth=0.7,
    )
    axes.set_xlim(0.0, min(_SHOWN_S, float(response.time[-1])))


def _spectrum(axes: Axes, spectrum: Spectrum) -> None:
    """Draw the spectrum, with its named lines."""
    inside = (spectrum.frequency_hz > 0.0) & (spectrum.frequency_hz <= _TOP_HZ)
    inside &= spectrum.density > 0.0
    power = style.MILLIMETRES**2 * spectrum.density[inside]
    axes.semilogy(spectrum.frequency_hz[inside], power, color=style.INK, linewidth=0.7)
    axes.set_xlim(0.0, float(spectrum.frequency_hz[inside][-1]))
    axes.set_ylim(max(power.min(), 1e-9 * power.max()), 30.0 * power.max())
    for line in spectrum.lines:
        if line.frequency_hz > axes.get_xlim()[1]:
            continue
        hunting = line.name == 'hunting'
        colour = style.STABLE if hunting else style.ROUGHNESS
        order = '' if hunting else line.name.removeprefix('roughness').strip()
        name = r'$f_h$' if hunting else rf'${order}f_r$'
        look = {'linewidth': 0.7, 'linestyle': (0, (3, 2)), 'zorder': 0}
        style.upright(axes, line.frequency_hz, name, colour, look, xytext=(1.5, 0), fontsize=6.5)


def _portrait(axes: Axes, portrait: PhasePortrait) -> None:
    points = _points(portrait)[-_PORTRAIT_POINTS:]
    axes.plot(points[:, 0], points[:, 1], color=style.INK, linewidth=0.35)
    _centred(axes, points)


def _points(orbit: PhasePortrait | PoincareSection) -> NDArray[np.float64]:
    """Displacement and velocity in mm and mm/s, shape (n, 2)."""
    return style.MILLIMETRES * np.column_stack([orbit.displacement, orbit.velocity])


def _centred(axes: Axes, points: NDArray[np.float64]) -> None:
    """Centre the axes on zero, with the same margin on both."""
    x, y = 1.15 * np.maximum(np.abs(points).max(axis=0), 1e-9)
    axes.set_xlim(-x, x)
    axes.set_ylim(-y, y)
    end = float(f'{0.7 * x:.1g}')
    axes.set_xticks([-end, end])  # the numbers of three would touch in a narrow panel
