"""The mean escape time with its interval: from the covariance of the form and the model error."""

from __future__ import annotations

import math

import numpy as np

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.noise.escape import AmplitudeDiffusion, mean_escape_time
from hunt_ros.samples import NORMAL_95, Uncertain

#: Standard deviation of ln(time) left by the one-dimensional equation itself. Against escapes of
#: the full model, A_rms / A_u from 0.28 to 0.52, the ratio was 0.78 to 1.02 with the form exact
#: about the speed, and 1.07 to 1.48 with a quintic form fitted to the whole branch.
MODEL_ERROR = 0.25


def escape_time_interval(
    identified: IdentifiedNormalForm,
    speed: float,
    diffusion: float | AmplitudeDiffusion,
    amplitude: float = 0.0,
    draws: int = 100,
    seed: int = 0,
) -> Uncertain:
    """
    Mean escape time with a 95 % interval.

    Parameters
    ----------
    identified : IdentifiedNormalForm
        Form and covariance.
    speed : float
        m/s.
    diffusion : float or AmplitudeDiffusion
        D, m^2/s.
    amplitude : float
        To start from, m.
    draws : int
        Of the covariance.
    seed : int
        Of the draws.

    Returns
    -------
    Uncertain
        s. The logarithm of the time is taken as normal, with the spread of the
        draws and `MODEL_ERROR` together; `std` is the half width of the interval
        over 1.96. All inf where it cannot happen.
    """
    value = float(mean_escape_time(identified.form, speed, diffusion, amplitude))
    if not math.isfinite(value) or value <= 0.0:
        return Uncertain(value, math.inf if value else 0.0, value, value)
    times = [
        float(mean_escape_time(form, speed, diffusion, amplitude))
        for form in identified.draws(draws, seed)
    ]
    logarithms = np.log([time for time in times if math.isfinite(time) and time > 0.0])
    spread = float(logarithms.std()) if logarithms.size > 1 else 0.0
    factor = math.exp(min(NORMAL_95 * math.hypot(spread, MODEL_ERROR), 300.0))
    low, high = value / factor, value * factor
    return Uncertain(value, (high - low) / (2.0 * NORMAL_95), low, high)
