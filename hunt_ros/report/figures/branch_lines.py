"""
The lines of a normal form in a diagram: quiet state, stable and unstable limit cycle.

Stable is solid, unstable dashed, in every figure of the report (the paper, Fig. 9).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.report.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Points of a branch over the speeds of a figure.
_POINTS = 801
#: Draws from the covariance behind a band, where the document gives none.
_DRAWS = 400
#: A band is drawn where at least this share of the draws has the branch.
_MOST = 0.8

Bands = dict[str, tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]


def branch_points(
    form: NormalForm, low: float, high: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
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


def plot_form(
    axes: Axes, form: NormalForm, low: float, high: float, dimensionless: bool = False
) -> None:
    """
    Plot a form: speed in m/s and amplitude in mm, or detuning and r.

    Parameters
    ----------
    axes : Axes
        To draw into; its limits are set to the speeds.
    form : NormalForm
        The form.
    low, high : float
        Speeds, m/s.
    dimensionless : bool
        Draw r against eps, as the paper's Fig. 9.
    """
    speed, unstable, stable = branch_points(form, low, high)
    factor = 0.5 / form.length_scale if dimensionless else style.MILLIMETRES

    def across(v: NDArray[np.float64] | list[float]) -> NDArray[np.float64]:
        return form.detuning(v) if dimensionless else np.asarray(v, dtype=np.float64)

    axes.plot(across(speed), factor * stable, color=style.STABLE, label='stable')
    axes.plot(
        across(speed), factor * unstable, color=style.UNSTABLE, linestyle='--', label='unstable'
    )
    # By its own growth rate: D7 can bring the quiet state back at another speed.
    growing = form.growth_rate(speed) > 0.0
    for shown, colour, dashes in ((~growing, style.STABLE, '-'), (growing, style.UNSTABLE, '--')):
        edge = shown | np.append(shown[1:], False) | np.append(False, shown[:-1])
        quiet = np.where(edge if dashes == '--' else shown, 0.0, np.nan)
        axes.plot(across(speed), quiet, color=colour, linestyle=dashes)
    axes.set_xlim(*across([low, high]))


def bands_of_draws(
    identified: IdentifiedNormalForm, low: float, high: float, seed: int = 0
) -> Bands:
    """
    Take the bands of the branches from draws of the covariance: 2.5 % to 97.5 %.

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
        As `bands_of_document`; only where most draws have the branch.
    """
    if not identified.covariance.any():
        return {}
    speed = np.linspace(low, high, 241)
    drawn = [form.steady_amplitudes(speed) for form in identified.draws(_DRAWS, seed)]
    bands: Bands = {}
    for name, index in (('unstable', 0), ('stable', 1)):
        amplitudes = np.array([pair[index] for pair in drawn])
        often = np.isfinite(amplitudes).mean(axis=0) >= _MOST
        if often.sum() >= 2:
            lower, upper = np.nanpercentile(amplitudes[:, often], [2.5, 97.5], axis=0)
            bands[name] = (speed[often], lower, upper)
    return bands
