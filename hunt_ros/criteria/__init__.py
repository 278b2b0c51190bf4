"""
The railway stability criteria as streaming detectors, to run beside the detector.

    make_criterion('cfr_213_333', rate_hz=1000.0, scale=0.02)
    CriteriaPanel(['cfr_213_333', 'six_peaks'], rate_hz=1000.0)
"""

from __future__ import annotations

from hunt_ros.criteria.base import (
    CRITERION_DTYPE,
    Criterion,
    CriterionSettings,
)
from hunt_ros.criteria.consecutive_peaks import SixPeaks, TenPeaks
from hunt_ros.criteria.panel import CriteriaPanel, Verdict
from hunt_ros.criteria.registry import CRITERIA, make_criterion
from hunt_ros.criteria.sliding_rms import SlidingRms, TrackSafetyStandards

__all__ = [
    'CRITERIA',
    'CRITERION_DTYPE',
    'CriteriaPanel',
    'Criterion',
    'CriterionSettings',
    'SixPeaks',
    'SlidingRms',
    'TenPeaks',
    'TrackSafetyStandards',
    'Verdict',
    'make_criterion',
]
