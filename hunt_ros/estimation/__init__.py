"""Streaming estimators: Kalman filter, Hilbert envelope, growth rate."""

from hunt_ros.estimation.growth import EnvelopeGrowth, growth_sign
from hunt_ros.estimation.hilbert import HilbertEnvelope
from hunt_ros.estimation.kalman import (
    TRACK_DTYPE,
    HuntingTracker,
    ModePoint,
    TrackerConfig,
)

__all__ = [
    'TRACK_DTYPE',
    'EnvelopeGrowth',
    'HilbertEnvelope',
    'HuntingTracker',
    'ModePoint',
    'TrackerConfig',
    'growth_sign',
]
