"""The branches of a normal form as the page draws them, with what is not known about them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dashboard.words import Words
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.report.figures.diagram import bands_of_draws, branch_points

#: Of the 800 points of a branch every n-th is drawn, and those near its ends.
_EVERY = 4
_MILLI = 1e3


def branches(identified: IdentifiedNormalForm, words: Words) -> Mapping[str, Any]:
    """
    Return the diagram of a form, from well below the fold to well above v_c.

    Parameters
    ----------
    identified : IdentifiedNormalForm
        The form in force, with its covariance.
    words : Words
        Its unit is that of all speeds.

    Returns
    -------
    dict
        `words` (the form by its critical speeds, as the detector says it), `shown` (the same in
        the unit shown), `v_c`, `v_c_std`, `v_n` (None: not known), `low`, `high` (the speeds
        of the diagram), `top_mm` (greatest amplitude of a branch), `stable` and `unstable`
        (lists of speeds and amplitudes, mm, None where there is none), `bands`: the same names to
        speeds, lower and upper edges between which the branch lies with 95 % probability.
    """
    form = identified.form
    v_c, v_n = form.critical_speed, form.nonlinear_critical_speed
    known = identified.nonlinear_critical_speed
    first = v_n if v_n is not None else v_c
    low = max(0.0, min(0.93 * first, first - 0.5 * (v_c - first)))
    high = v_c + max(0.12 * v_c, 0.5 * (v_c - first))
    speed, unstable, stable = branch_points(form, low, high)
    kept = np.zeros(speed.size, dtype=bool)
    kept[::_EVERY] = True
    for special in (first, v_c):
        kept |= np.abs(speed - special) < 0.01 * v_c
    bands = bands_of_draws(identified, low, high)
    tops = [float(np.nanmax(each)) for each in (stable, unstable) if np.isfinite(each).any()]
    std = identified.std('v_c')

    def speeds(mps: NDArray[np.float64]) -> list[float | None]:
        """Return speeds in the unit of the page."""
        return _shorts(words.factor * mps)

    return {
        'words': identified.words,
        'shown': words.in_unit(identified.words),
        'v_c': words.speed(v_c),
        'v_c_std': words.speed(std) if std > 0.0 else None,
        'v_n': None if known is None else words.speed(known),
        'low': words.speed(low),
        'high': words.speed(high),
        'top_mm': _MILLI * max(tops, default=1e-3),
        'stable': [speeds(speed[kept]), _shorts(_MILLI * stable[kept])],
        'unstable': [speeds(speed[kept]), _shorts(_MILLI * unstable[kept])],
        'bands': {
            name: [speeds(v), _shorts(_MILLI * lower), _shorts(_MILLI * upper)]
            for name, (v, lower, upper) in bands.items()
        },
    }


def _shorts(values: NDArray[np.float64]) -> list[float | None]:
    return [round(value, 5) if math.isfinite(value) else None for value in values.tolist()]
