"""
A user's own model beside the measurement: drawn, with residuals in standard deviations.

A model is a table of steady amplitudes (speed, amplitude, stability) of whatever origin, or a
rig in YAML whose limit cycles are followed here.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.limit_cycle import limit_cycles
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.errors import HuntError
from hunt_ros.report.figures import style
from hunt_ros.report.figures.hysteresis import measured_points
from hunt_ros.report.figures.normal_form_diagram import bands_of_document
from hunt_ros.report.numbers import plain
from hunt_ros.report.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

#: Names that a column may have.
_COLUMNS = {
    'speed': ('v', 'speed', 'speed_mps'),
    'amplitude': ('A', 'amplitude', 'amplitude_m'),
    'stability': ('stability', 'stable'),
}
_STABLE = {'stable': True, '1': True, 'true': True, 'unstable': False, '0': False, 'false': False}
#: Rows of a table, at most, and largest amplitude, m: more is another unit.
_MOST_ROWS, _LARGEST_M = 100_000, 1.0
#: A measured state hunts where it is above this share of the model's limit cycle.
_HUNTS = 0.5


@dataclass(frozen=True, eq=False)
class Model:
    """
    Steady amplitudes of a model.

    Parameters
    ----------
    label : str
        For the legend.
    speed, amplitude : ndarray, shape (n,)
        m/s, m, in the order of the branch.
    stable : ndarray of bool, shape (n,)
    """

    label: str
    speed: Array
    amplitude: Array
    stable: NDArray[np.bool_]

    def branch(self, stable: bool) -> tuple[Array, Array]:
        """Speeds, increasing, and amplitudes of one branch, m/s and m; without rest."""
        part = (self.stable == stable) & (self.amplitude > 0.0)
        order = np.argsort(self.speed[part], kind='stable')
        return self.speed[part][order], self.amplitude[part][order]

    def at(self, stable: bool, speeds: Array) -> Array:
        """Amplitude of one branch, m; NaN outside its speeds."""
        speed, amplitude = self.branch(stable)
        if not speed.size:
            return np.full(speeds.shape, math.nan)
        found: Array = np.interp(speeds, speed, amplitude, left=math.nan, right=math.nan)
        return found


@dataclass(frozen=True)
class Residual:
    """
    What was found, less what the model says, in standard deviations.

    Parameters
    ----------
    branch : str
        'stable': a measured steady state; 'unstable': the identified branch.
    speed, found, model, deviations : float
        m/s, m, m, and their difference over its standard deviation.
    """

    branch: str
    speed: float
    found: float
    model: float
    deviations: float


def model_of(text: str, source: str) -> Model:
    """
    Read a model.

    Parameters
    ----------
    text : str
        A rig in YAML where `source` ends in .yaml or .yml, else a table in CSV.
    source : str
        Named in messages and in the legend.

    Raises
    ------
    HuntError
        One line: what is wrong in it, and where.
    """
    if source.lower().endswith(('.yaml', '.yml')):
        branch = limit_cycles(RigParameters.from_yaml(text, source))
        return Model(source, branch.speed, branch.amplitude, branch.stable)
    rows = [row for row in csv.reader(text.splitlines()) if any(cell.strip() for cell in row)]
    header = [cell.strip() for cell in rows[0]] if rows else []
    places = []
    for name, words in _COLUMNS.items():
        place = next((header.index(word) for word in words if word in header), None)
        if place is None:
            raise HuntError(f'{source}: no column {" or ".join(words)} for the {name}')
        places.append(place)
    if not 2 <= len(rows) <= _MOST_ROWS:
        raise HuntError(f'{source}: {len(rows) - 1} rows, expected 1 to {_MOST_ROWS}')
    found = [_row(row, places, f'{source}, row {k}') for k, row in enumerate(rows[1:], 2)]
    speed, amplitude, stable = zip(*found, strict=True)
    return Model(source, np.array(speed), np.array(amplitude), np.array(stable, dtype=np.bool_))


def _row(row: Sequence[str], places: Sequence[int], where: str) -> tuple[float, float, bool]:
    """Read speed, amplitude and stability from a row of the table."""
    try:
        cells = [row[place].strip() for place in places]
        speed, amplitude = float(cells[0]), float(cells[1])
        stable = _STABLE[cells[2].lower()]
    except (IndexError, ValueError, KeyError):
        raise HuntError(
            f'{where}: {",".join(row)} is no speed (m/s), amplitude (m), stable or unstable'
        ) from None
    if not (0.0 < speed < math.inf and 0.0 <= amplitude <= _LARGEST_M):
        raise HuntError(
            f'{where}: speed {speed:g} m/s, amplitude {amplitude:g} m: expected a positive speed'
            f' and an amplitude from 0 to {_LARGEST_M:g} m'
        )
    return speed, amplitude, stable


def residuals(model: Model, result: Result) -> list[Residual]:
    """
    Compare a model with what was measured and identified.

    Returns
    -------
    list of Residual
        Of the measured hunting states, and of the identified unstable branch, where both the
        model and a standard deviation are there.
    """
    found = []
    for state in result.steady_states():
        std = float(state.get('amplitude_std_m') or 0.0)
        speed, amplitude = float(state['speed_mps']), float(state['amplitude_m'])
        value = float(model.at(True, np.array([speed]))[0])
        if std > 0.0 and math.isfinite(value) and amplitude > _HUNTS * value:
            found.append(Residual('stable', speed, amplitude, value, (amplitude - value) / std))
    for point in result.branches():
        std = float(point.get('unstable_std_m') or 0.0)
        speed = float(point['speed_mps'])
        value = float(model.at(False, np.array([speed]))[0])
        if std > 0.0 and math.isfinite(value):
            amplitude = float(point['unstable_amplitude_m'])
            found.append(Residual('unstable', speed, amplitude, value, (amplitude - value) / std))
    return found


def to_json(model: Model, found: Sequence[Residual]) -> dict[str, Any]:
    """Return the entry `model` of `hunt report --json`."""
    return {
        'label': model.label,
        'residuals': [
            {
                'branch': one.branch,
                'speed_mps': one.speed,
                'amplitude_m': one.found,
                'model_amplitude_m': one.model,
                'deviations': one.deviations,
            }
            for one in found
        ],
    }


def sentence(found: Sequence[Residual]) -> str:
    """Say how far the model is from what was found."""
    if not found:
        return 'The model has no limit cycle at the speeds that were measured.'
    parts = []
    for branch, words in (
        ('stable', 'measured limit cycles'),
        ('unstable', 'points of the identified unstable branch'),
    ):
        sizes = [abs(one.deviations) for one in found if one.branch == branch]
        if sizes:
            rms = math.sqrt(sum(size * size for size in sizes) / len(sizes))
            within = sum(size <= 2.0 for size in sizes)
            parts.append(
                f'{within} of {len(sizes)} {words} are within two standard deviations of the'
                f' model (rms {plain(rms, 2)})'
            )
    return '; '.join(parts) + '. Points of a branch are not independent of each other.'


def model_diagram(model: Model, found: Sequence[Residual], result: Result) -> Figure:
    """
    Draw the model over measurement and identified bands, and the residuals below.

    Parameters
    ----------
    model : Model
        As read.
    found : sequence of Residual
        As `residuals` gives them.
    result : Result
        Measured states and identified branches.

    Returns
    -------
    Figure
        One page wide.
    """
    mm = style.MILLIMETRES
    with style.journal_style():
        figure = style.new_figure(style.PAGE, 0.62 * style.PAGE)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
        style.frame(upper, '', style.AMPLITUDE_LABEL)
        style.frame(lower, style.SPEED_LABEL, 'Residual (std)')
        colours = {'stable': style.STABLE, 'unstable': style.UNSTABLE}
        for name, (speed, low, high) in bands_of_document(result.branches()).items():
            upper.fill_between(
                speed, mm * low, mm * high, color=colours[name], alpha=0.18, linewidth=0
            )
        for stable, dashes in ((True, '-'), (False, '--')):
            speed, amplitude = model.branch(stable)
            label = f'model, {"" if stable else "un"}stable'
            if speed.size:
                upper.plot(speed, mm * amplitude, dashes, color=style.INK, label=label)
        for direction in style.DIRECTIONS:
            measured_points(upper, result.steady_states(direction), direction)
        for branch, marker in (('stable', 'o'), ('unstable', '.')):
            part = [(one.speed, one.deviations) for one in found if one.branch == branch]
            if part:
                lower.plot(
                    *zip(*part, strict=True), marker, color=colours[branch],
                    markerfacecolor='none', label=branch,
                )  # fmt: skip
        lower.axhspan(-2.0, 2.0, color=style.GRID, alpha=0.5, linewidth=0)
        lower.axhline(0.0, color=style.MUTED, linewidth=0.5)
        style.legend_above(upper, columns=5)
        return figure
