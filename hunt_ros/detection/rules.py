"""The thresholds as the kernel of the decisions reads them: SI numbers, times in rows."""

from __future__ import annotations

from typing import NamedTuple

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.frequencies import with_frequencies
from hunt_ros.estimation.tracker_config import REFERENCE_HZ

#: Spacing of the marks between which steps of the phasor are taken, in hunting periods.
_MARK_PERIODS = 0.75


class Rules(NamedTuple):
    """
    Settings in kernel form: amplitudes in m, rates in 1/s, hold times in rows.

    `period_s` is the spacing of the rows, s; `stride` the same in the time of the motion:
    seconds of a rig that hunts at `REFERENCE_HZ`, for which the kernel's times are meant.
    """

    period_s: float
    stride: float
    v_n: float
    v_c: float
    region_band: float
    region_hold: int
    floor: float
    floor_rows: float
    mark: int
    disturbed_in: float
    disturbed_out: float
    disturbed_hold: int
    quiet_hold: int
    probability_in: float
    probability_out: float
    escape_hold: int
    sigma: float
    growth_floor: float
    growth_hold: int
    cycle_fraction: float
    cycle_floor: float
    cycle_growth: float
    cycle_amplitude: float
    cycle_hold: int
    decay_fraction: float
    decay_rate: float
    decay_hold: int
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

    return Rules(
        period_s=period,
        stride=stride,
        v_n=v_n,
        v_c=v_c,
        region_band=config.region_band_mps,
        region_hold=rows(config.region_hold_s),
        floor=config.noise_floor_m,
        floor_rows=config.floor_time_s / stride,
        mark=max(rows(_MARK_PERIODS / REFERENCE_HZ), 1),
        disturbed_in=config.disturbed_in,
        disturbed_out=config.disturbed_out,
        disturbed_hold=rows(config.disturbed_hold_s),
        quiet_hold=rows(config.quiet_hold_s),
        probability_in=config.escape_probability_in,
        probability_out=config.escape_probability_out,
        escape_hold=rows(config.escape_hold_s),
        sigma=config.growth_sigma,
        growth_floor=config.growth_floor,
        growth_hold=rows(config.growth_hold_s),
        cycle_fraction=config.limit_cycle_fraction,
        cycle_floor=config.limit_cycle_floor,
        cycle_growth=config.limit_cycle_growth_per_s * faster,
        cycle_amplitude=config.limit_cycle_amplitude_m,
        cycle_hold=rows(config.limit_cycle_hold_s),
        decay_fraction=config.decay_fraction,
        decay_rate=config.decay_rate_per_s * faster,
        decay_hold=rows(config.decay_hold_s),
        margin_in=config.margin_in,
        margin_out=config.margin_out,
        margin_hold=rows(config.margin_hold_s),
        margin_restore=rows(config.margin_restore_s),
        disagree_hold=rows(config.agreement_hold_s),
        outlook_s=config.outlook_s,
    )
