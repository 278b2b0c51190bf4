"""The picture of a calibration: known displacements, what the calibration makes of a reading."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hunt_ros.drivers.calibration import Calibration
from hunt_ros.report.figures.style import INK, MUTED, STABLE, frame, journal_style, new_figure
from hunt_ros.samples import Uncertain
from hunt_ros.sensors import SENSORS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: How axes show SI: unit and factor.
_SHOWN = {'m': ('mm', 1e3), 'rad': ('mrad', 1e3)}


def calibration_figure(
    points: Sequence[tuple[float, float]],
    calibration: Calibration,
    residuals: Sequence[Uncertain],
) -> Figure:
    """
    Draw a calibration above its residuals.

    Parameters
    ----------
    points : sequence of (float, float)
        Reading, known displacement in SI.
    calibration : Calibration
        Made from them.
    residuals : sequence of Uncertain
        Known displacement less that of the calibration, SI, one a point; NaN deviation: unknown.
    """
    si = next((each.unit for each in SENSORS if each.name == calibration.channel), '')
    unit, factor = _SHOWN.get(si, (si, 1.0))
    readings, known = (np.array(column) for column in zip(*points, strict=True))
    figure = new_figure(height=3.3)
    with journal_style():
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
        grid = np.linspace(readings.min(), readings.max(), 200)
        above.plot(grid, factor * calibration.apply(grid), color=STABLE)
        above.plot(readings, factor * known, 'o', color=INK, markerfacecolor='none')
        frame(above, '', f'Displacement ({unit})')
        below.axhline(0.0, color=MUTED, linewidth=0.6)
        stds = np.array([residual.std for residual in residuals])
        values = np.array([residual.value for residual in residuals])
        bars = factor * np.where(np.isfinite(stds), stds, 0.0)
        below.errorbar(readings, factor * values, yerr=bars, fmt='o', color=INK, markersize=3)
        frame(below, 'Reading', f'Residual ({unit})')
    return figure
