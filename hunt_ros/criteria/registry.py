"""Criteria by their names, as a parameter file gives them."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from hunt_ros.criteria.base import Criterion
from hunt_ros.criteria.consecutive_peaks import SixPeaks, TenPeaks
from hunt_ros.criteria.sliding_rms import SlidingRms, TrackSafetyStandards
from hunt_ros.errors import ConfigError

#: Every criterion by the name a parameter file gives it.
CRITERIA: dict[str, type[Criterion]] = {
    kind.name: kind for kind in (TrackSafetyStandards, SixPeaks, TenPeaks, SlidingRms)
}


def make_criterion(name: str, rate_hz: float, **thresholds: Any) -> Criterion:
    """
    Make a criterion by its name.

    Parameters
    ----------
    name : str
        Key of `CRITERIA`.
    rate_hz : float
        Rate at which it works, Hz; best the displacement sensor's own.
    **thresholds
        Fields of its settings: `limit` or `scale` (both m/s^2 of the standard unless
        scaled), pass band, window, number of peaks.

    Raises
    ------
    ConfigError
        For an unknown name, an unknown threshold, or one out of its range.
    """
    if name not in CRITERIA:
        raise ConfigError(f'criterion {name!r} is unknown, expected one of {", ".join(CRITERIA)}')
    kind = CRITERIA[name]
    known = {item.name for item in fields(kind.settings_type)}
    unknown = sorted(set(thresholds) - known)
    if unknown:
        raise ConfigError(
            f'criterion {name}: unknown threshold {unknown[0]!r}, expected one of'
            f' {", ".join(sorted(known))}'
        )
    return kind(rate_hz, kind.settings_type(**thresholds))
