"""Streaming estimators: Kalman filter, Hilbert envelope."""

from hunt_ros.estimation.hilbert import HilbertEnvelope
from hunt_ros.estimation.kalman import TRACK_DTYPE, HuntingTracker, TrackerConfig

__all__ = [
    'TRACK_DTYPE',
    'HilbertEnvelope',
    'HuntingTracker',
    'TrackerConfig',
]
