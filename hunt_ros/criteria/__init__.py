"""
The railway stability criteria as streaming detectors, to run beside the detector.

    make_criterion('cfr_213_333', rate_hz=1000.0, scale=0.02)
    CriteriaPanel(['cfr_213_333', 'six_peaks'], rate_hz=1000.0)
"""

from __future__ import annotations

from hunt_ros.criteria.norms import (
    CRITERIA,
    CRITERION_DTYPE,
    CriteriaPanel,
    Criterion,
    Verdict,
    make_criterion,
)

__all__ = [
    'CRITERIA',
    'CRITERION_DTYPE',
    'CriteriaPanel',
    'Criterion',
    'Verdict',
    'make_criterion',
]
