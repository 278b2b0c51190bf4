"""The thresholds as the kernel of the decisions reads them: SI numbers, times in rows."""

from __future__ import annotations

import math
from typing import NamedTuple

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.frequencies import with_frequencies
from hunt_ros.estimation.tracker_config import REFERENCE_HZ

# Times are in seconds of a rig that hunts at `REFERENCE_HZ`: they count as many periods of any.
#: A region is left this far beyond its boundary, m/s, and changed after this time: the reading of
#: a speed that is held wanders by less.
_REGION_BAND_MPS, _REGION_HOLD_S = 0.02, 0.2
#: Time constant of the learnt noise floor: some sixty periods tell a mean square to 13 %.
_FLOOR_S = 20.0
#: Disturbed above, quiet again below this many noise floors. The amplitude of Gaussian noise is
#: above k of them with the probability exp(-k^2): 1e-4 and 2 %.
_DISTURBED, _QUIET = 3.0, 2.0
#: A blow is a disturbance at once; what crosses zero growth on its way down is not quiet yet.
_DISTURBED_HOLD_S, _QUIET_HOLD_S = 0.02, 0.5
#: Escaping after this time above the probability: what the filter overshoots after a kick is over.
_ESCAPE_HOLD_S = 0.1
#: On the limit cycle from this part of the stable branch, whose place is known to 10 % or so, and
#: after this time: a motion passes through on its way.
_CYCLE_FRACTION, CYCLE_HOLD_S = 0.85, 1.0
#: What escapes does so no longer where it is as likely to come back.
_PROBABILITY_OUT = 0.5
#: The margin is restored above this many times its limit,
MARGIN_BACK = 1.5
#: low after the first time, restored after it where there is room, and after the second in the
#: hysteresis region, where the noise that made it low comes back.
_MARGIN_HOLD_S, _MARGIN_RESTORE_S = 0.1, 20.0
#: The two amplitudes disagree after this time: the envelope needs as long to follow.
_DISAGREE_HOLD_S = 1.0
#: Horizon of the outlook: the next minute, as its name says; on the clock, not in periods.
_OUTLOOK_S = 60.0
#: Spacing of the marks between which steps of the phasor are taken, in hunting periods.
_MARK_PERIODS = 0.75
#: Spacing of the amplitudes that are compared, in hunting periods.
_STEP_PERIODS = 0.375
_WEEK_S = 7.0 * 86400.0


class Rules(NamedTuple):
    """
    Settings in kernel form: amplitudes in m, rates in 1/s, hold times in rows.

    `period_s` is the spacing of the rows, s; `stride` the same in the time of the motion:
    seconds of a rig that hunts at `REFERENCE_HZ`, for which the kernel's times are meant;
    `faster` is the ratio of the frequencies, `nominal_hz` that of this rig. `evidence` is the log
    likelihood ratio that decides: the logarithm of the number of steps in the time of one false
    alarm.
    """

    period_s: float
    stride: float
    faster: float
    nominal_hz: float
    v_n: float
    v_c: float
    region_band: float
    region_hold: int
    floor_rows: float
    mark: int
    disturbed_in: float
    disturbed_out: float
    disturbed_hold: int
    quiet_hold: int
    probability_in: float
    probability_out: float
    escape_hold: int
    step: int
    evidence: float
    least_damping: float
    cycle_fraction: float
    cycle_hold: int
    margin_in: float
    margin_out: float
    margin_hold: int
    margin_restore: int
    disagree_hold: int
    outlook_s: float


def rules_of(config: DetectorConfig, v_n: float, v_c: float) -> Rules:
    """
    Translate the settings.

    Parameters
    ----------
    config : DetectorConfig
        In SI, with numbers for the frequencies or not.
    v_n, v_c : float
        Boundaries of the regions, m/s; NaN: none, unknown.
    """
    config = with_frequencies(config)
    period = config.period_ns * 1e-9
    faster = config.hunting_frequency_hz / REFERENCE_HZ
    stride = period * faster

    def rows(seconds: float) -> int:
        """Return a time of the settings in rows: it counts as many periods of this rig."""
        return round(seconds / stride)

    step = max(rows(_STEP_PERIODS / REFERENCE_HZ), 1)
    return Rules(
        period_s=period,
        stride=stride,
        faster=faster,
        nominal_hz=config.hunting_frequency_hz,
        v_n=v_n,
        v_c=v_c,
        region_band=_REGION_BAND_MPS,
        region_hold=rows(_REGION_HOLD_S),
        floor_rows=_FLOOR_S / stride,
        mark=max(rows(_MARK_PERIODS / REFERENCE_HZ), 1),
        disturbed_in=_DISTURBED,
        disturbed_out=_QUIET,
        disturbed_hold=rows(_DISTURBED_HOLD_S),
        quiet_hold=rows(_QUIET_HOLD_S),
        probability_in=config.escape_probability_in,
        probability_out=_PROBABILITY_OUT,
        escape_hold=rows(_ESCAPE_HOLD_S),
        step=step,
        evidence=max(math.log(_WEEK_S / (step * period * config.false_alarms_per_week)), 1.0),
        least_damping=config.least_damping_per_s * faster,
        cycle_fraction=_CYCLE_FRACTION,
        cycle_hold=rows(CYCLE_HOLD_S),
        margin_in=config.margin_in,
        margin_out=config.margin_in * MARGIN_BACK,
        margin_hold=rows(_MARGIN_HOLD_S),
        margin_restore=rows(_MARGIN_RESTORE_S),
        disagree_hold=rows(_DISAGREE_HOLD_S),
        outlook_s=_OUTLOOK_S,
    )
