"""The mode shape of the recordings, and the second mode: what both sensors show together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hunt_ros.dynamics.mode_shape import CARRY_SPEED, ModeShape, fitted_shape, rounded
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.estimation.response_windows import ResponseWindows, joined, measured_ratio
from hunt_ros.estimation.second_mode import HuntingMode, SecondMode, second_mode

#: Below this part of the critical speed the rig is on its way, or stands.
_RUNS = 0.5
#: A motion is linear whose amplitude changes its damping by less than this part.
_LINEAR = 0.1
#: A second mode that is known no better than this tells nothing.
_LEAST_KNOWN = 0.15


def measured_shape(
    recordings: Sequence[ResponseWindows], form: NormalForm, frequency_hz: float
) -> ModeShape | None:
    """
    Put together what the recordings show of the mode shape, and of the second mode.

    Parameters
    ----------
    recordings : sequence of ResponseWindows
        Of each recording; those without `yaw` add nothing.
    form : NormalForm
        Identified from them: tells which motion is small, and how it is damped.
    frequency_hz : float
        Of the hunting, with which they were measured.

    Returns
    -------
    ModeShape or None
        None where no recording shows the motion on both sensors.
    """
    if not recordings:
        return None
    windows = joined(recordings)
    shape = fitted_shape(*measured_ratio(windows, frequency_hz))
    if shape is None:
        return None
    second = _second(windows, shape, form, frequency_hz)
    if second is None or not second.relative_std < _LEAST_KNOWN:
        return shape
    held = np.clip(shape.speeds, second.speeds[0], second.speeds[-1])
    doubt = np.hypot(second.relative_std, CARRY_SPEED * np.log(shape.speeds / held))
    return replace(
        shape,
        second_frequency_hz=rounded(np.interp(held, second.speeds, second.frequency_hz)),
        second_decay=rounded(np.interp(held, second.speeds, second.decay)),
        second_std=rounded(np.minimum(doubt, 0.9)),
    )


def _second(
    windows: ResponseWindows, shape: ModeShape, form: NormalForm, frequency_hz: float
) -> SecondMode | None:
    """Fit the second mode to the windows in which the motion is small and decays."""
    least = np.asarray(form.growth_rate(windows.speed, 0.0))
    change = np.asarray(form.growth_rate(windows.speed, windows.amplitude)) - least
    calm = (least < 0.0) & (np.abs(change) < -_LINEAR * least)
    quiet = windows.only(calm & (windows.speed > _RUNS * form.critical_speed))
    if not quiet.speed.size:
        return None
    speed = float(np.mean(quiet.speed))
    turning = 2.0 * math.pi * float(np.interp(speed, shape.speeds, shape.frequency_hz))
    eigenvalue = complex(float(form.growth_rate(speed, 0.0)), turning)
    doubt = float(np.interp(speed, shape.speeds, shape.ratio_std[:, 0]))
    hunting = HuntingMode(speed, eigenvalue, shape.at(speed, 0.0), doubt)
    return second_mode(quiet, frequency_hz, hunting)
