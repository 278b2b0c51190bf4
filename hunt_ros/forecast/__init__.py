"""
Forecast of the linear critical speed before it is reached, from the damping on the way up.

    forecast = CriticalSpeedForecast()
    forecast.update(stamps_ns, lateral, speed, angle)
    forecast.forecast.critical_speed  # or None, with its reason
"""

from __future__ import annotations

from hunt_ros.forecast.critical_speed import (
    COLLECTING,
    NO_EXCITATION,
    NOT_FALLING,
    CriticalSpeedForecast,
    Forecast,
)

__all__ = [
    'COLLECTING',
    'NOT_FALLING',
    'NO_EXCITATION',
    'CriticalSpeedForecast',
    'Forecast',
]
