"""
The basin of the quiet state as the detector uses it: branches with their uncertainty by
speed, and what the noise does near the edge of the basin.

The exact committor and escape time are those of `hunt_ros.dynamics.disturbance`;
here they are condensed to three numbers that change slowly, so that every row of
the estimates can be judged by a closed formula.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.disturbance import committor, mean_escape_time
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import NormalForm

_DRAWS = 200
_SPEEDS = 300
#: Width of the cells of speed (relative) and of noise intensity (logarithmic) in which the
#: condensed committor is taken as constant.
_SPEED_CELL = 0.0025
_NOISE_CELL = 0.1


class FormNumbers(NamedTuple):
    """
    A normal form as a kernel reads it; NaN throughout where there is none.

    Fields
    ------
    known : bool
    critical_speed, D1, D4, D7, D10, D15, length_scale, time_scale : float
        As in `NormalForm`.
    speed_low, speed_step : float
        First speed of the tables and their spacing, m/s.
    unstable_std, unstable_mean : ndarray, shape (n,)
        Standard deviation and mean over the draws of the unstable amplitude, m.
    quiet_share, cycle_share : ndarray, shape (n,)
        Share of the draws with a stable quiet state, and with a stable limit cycle.
    """

    known: bool
    critical_speed: float
    D1: float
    D4: float
    D7: float
    D10: float
    D15: float
    length_scale: float
    time_scale: float
    speed_low: float
    speed_step: float
    unstable_std: NDArray[np.float64]
    unstable_mean: NDArray[np.float64]
    quiet_share: NDArray[np.float64]
    cycle_share: NDArray[np.float64]


def form_numbers(identified: IdentifiedNormalForm | None) -> FormNumbers:
    """
    Prepare a normal form: branches of draws from its covariance, tabulated by speed.

    Parameters
    ----------
    identified : IdentifiedNormalForm or None
        None: nothing is known.

    Returns
    -------
    FormNumbers
    """
    if identified is None:
        none = np.full(2, math.nan)
        no = math.nan
        return FormNumbers(False, no, no, no, no, no, no, no, no, 0.0, 1.0, none, none, none, none)
    form = identified.form
    speeds = np.linspace(0.3, 1.7, _SPEEDS) * form.critical_speed
    exact = not identified.covariance.any()
    draws = [form] if exact else identified.draws(_DRAWS)
    with np.errstate(all='ignore'):
        unstable = np.array([draw.unstable_amplitude(speeds) for draw in draws])
        stable = np.array([draw.stable_amplitude(speeds) for draw in draws])
    quiet = np.array([draw.growth_rate(speeds) < 0.0 for draw in draws])
    exists = np.isfinite(unstable)
    count = np.maximum(exists.sum(axis=0), 1)
    mean = np.where(exists, unstable, 0.0).sum(axis=0) / count
    spread = np.where(exists, unstable - mean, 0.0)
    mean[~exists.any(axis=0)] = math.nan
    return FormNumbers(
        True,
        form.critical_speed,
        form.D1,
        form.D4,
        form.D7,
        form.D10,
        form.D15,
        form.length_scale,
        form.time_scale,
        float(speeds[0]),
        float(speeds[1] - speeds[0]),
        np.sqrt((spread**2).sum(axis=0) / count),
        mean,
        quiet.mean(axis=0),
        np.isfinite(stable).mean(axis=0),
    )


class EdgeNoise(NamedTuple):
    """
    What the present noise does at the edge of the quiet basin.

    Fields
    ------
    centre, width : float
        Mean and standard deviation of the amplitude at which the outcome is
        decided, as fractions of the unstable amplitude.
    rate : float
        Escapes from the quiet state per second.
    """

    centre: float
    width: float
    rate: float


#: Without noise: the edge is the unstable branch itself.
SHARP = EdgeNoise(1.0, 0.0, 0.0)


class EdgeTable:
    """
    `EdgeNoise` by speed and noise intensity, computed when first asked for.

    Speed and intensity are rounded to cells first, so that the answer depends on
    them alone and not on what was asked before.

    Parameters
    ----------
    form : NormalForm or None
        None gives `SHARP` everywhere.
    """

    def __init__(self, form: NormalForm | None) -> None:
        self._form = form
        self._known: dict[tuple[int, int], EdgeNoise] = {}

    def at(self, speed: float, diffusion: float) -> EdgeNoise:
        """
        Look up, or compute.

        Parameters
        ----------
        speed : float
            m/s.
        diffusion : float
            Noise intensity D of `hunt_ros.dynamics.disturbance`, m^2/s; zero and NaN
            give `SHARP`.

        Returns
        -------
        EdgeNoise
        """
        form = self._form
        if form is None or not diffusion > 0.0 or not math.isfinite(speed):
            return SHARP
        cell = (
            round(speed / (_SPEED_CELL * form.critical_speed)),
            round(math.log(diffusion) / _NOISE_CELL),
        )
        if cell not in self._known:
            self._known[cell] = edge_noise(
                form, cell[0] * _SPEED_CELL * form.critical_speed, math.exp(cell[1] * _NOISE_CELL)
            )
        return self._known[cell]


def edge_noise(form: NormalForm, speed: float, diffusion: float) -> EdgeNoise:
    """
    Condense the committor at one speed into the moments of the deciding amplitude.

    Parameters
    ----------
    form : NormalForm
        In the amplitude coordinate.
    speed : float
        m/s.
    diffusion : float
        m^2/s.

    Returns
    -------
    EdgeNoise
        `SHARP` where there is no unstable branch.
    """
    unstable = float(form.unstable_amplitude(speed))
    if not math.isfinite(unstable):
        return SHARP
    stable = float(form.stable_amplitude(speed))
    top = 2.0 * unstable if not math.isfinite(stable) else 0.5 * (unstable + stable)
    amplitude = np.linspace(0.0, top, 161)
    risen = committor(form, speed, amplitude, diffusion)
    share = np.diff(risen)
    total = float(share.sum())
    if not total > 0.5:
        return SHARP
    middle = 0.5 * (amplitude[1:] + amplitude[:-1])
    centre = float((share * middle).sum()) / total
    width = math.sqrt(float((share * (middle - centre) ** 2).sum()) / total)
    time = float(mean_escape_time(form, speed, diffusion))
    rate = 1.0 / time if time > 0.0 else 0.0
    return EdgeNoise(centre / unstable, width / unstable, rate)
