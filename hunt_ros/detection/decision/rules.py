"""The settings as the kernel of the decisions reads them: SI numbers, times in rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hunt_ros.compiled import F1, compiled_part
from hunt_ros.detection.configuration import DetectorConfig, with_frequency
from hunt_ros.detection.decision.limits import LIMITS
from hunt_ros.estimation.tracker_config import REFERENCE_HZ

#: Spacing of the amplitudes that are compared, in hunting periods.
_STEP_PERIODS = 0.75
_WEEK_S = 7.0 * 86400.0
#: The hazard is no larger than this.
_OFTEN = 0.3


class Rules(NamedTuple):
    """
    Settings in kernel form: amplitudes in m, speeds in m/s, rates in 1/s.

    `period_s` is the spacing of the rows, s; `stride` the same in the time of the motion:
    seconds of a rig that hunts at `REFERENCE_HZ`, for which the kernel's times are meant;
    `faster` is the ratio of the frequencies, `nominal_hz` that of this rig. `step` is the spacing
    of the amplitudes that are compared, rows, and `hazard` the chance that what is damped begins
    to hunt from one to the next: one in the time of one false alarm. `limits` are those of
    `limits.LIMITS` in SI, 0: off.
    """

    period_s: float
    stride: float
    faster: float
    nominal_hz: float
    v_n: float
    v_c: float
    step: int
    probability_in: float
    hazard: float
    least_damping: float
    margin_in: float
    limits: F1


@compiled_part
def rows_of(rules: Rules, seconds: float) -> int:
    """Return a time in rows: seconds of the reference rig, as many periods of any other."""
    return round(seconds / rules.stride)


def rules_of(config: DetectorConfig, v_n: float, v_c: float) -> Rules:
    """
    Translate the settings.

    Parameters
    ----------
    config : DetectorConfig
        In SI.
    v_n, v_c : float
        Boundaries of the regions, m/s; NaN: none, unknown.
    """
    config = with_frequency(config)
    period = config.period_ns * 1e-9
    faster = config.hunting_frequency_hz / REFERENCE_HZ
    step = max(round(_STEP_PERIODS / REFERENCE_HZ / (period * faster)), 1)
    return Rules(
        period,
        period * faster,
        faster,
        config.hunting_frequency_hz,
        v_n,
        v_c,
        step,
        config.escape_probability_in,
        min(step * period * config.false_alarms_per_week / _WEEK_S, _OFTEN),
        config.least_damping_per_s * faster,
        config.margin_in,
        np.array([getattr(config, limit.setting) / limit.scale for limit in LIMITS]),
    )
