"""
Where the detector looks for the hunting motion: from the settings, the normal form, or neither.

The one place where a `hunting_frequency_*` of 0 is given its value.
"""

from __future__ import annotations

import math
from dataclasses import replace

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.estimation.tracker_config import REFERENCE_HZ
from hunt_ros.rig import HUNTING_HZ

#: The range that goes with the nominal frequency of `REFERENCE_HZ`, Hz; with another: likewise.
_LOWEST_HZ, _HIGHEST_HZ = 1.0, 6.0
#: A form whose frequency is this near to the nominal one in force leaves all as it is: the
#: filter loses nothing by it, and goes on with what it has learnt.
_NEAR = math.log(1.2)
#: Nominal frequencies that can be followed: these, and below this share of the output rate.
_SLOWEST_HZ, _FASTEST_HZ, FASTEST_OF_RATE = 0.1, 50.0, 0.4
#: The lowest and the highest frequency that the settings can name.
_LEAST_HZ, _MOST_HZ = HUNTING_HZ['hunting_frequency_min_hz'], 150.0


def nominal_hz(config: DetectorConfig, form_hz: float | None, present_hz: float) -> float:
    """
    Return the nominal frequency for a normal form.

    Parameters
    ----------
    config : DetectorConfig
        A frequency it names is taken, whatever the form says.
    form_hz : float or None
        Hunting frequency of the normal form, Hz; None: there is none.
    present_hz : float
        Nominal frequency in force, Hz: kept without a form, or with one near to it.
    """
    if config.hunting_frequency_hz > 0.0:
        return config.hunting_frequency_hz
    if form_hz is None or abs(math.log(form_hz / present_hz)) < _NEAR:
        return present_hz
    fastest = min(_FASTEST_HZ, FASTEST_OF_RATE * config.output_rate_hz)
    return min(max(form_hz, _SLOWEST_HZ), fastest)


def with_frequencies(config: DetectorConfig, nominal: float = REFERENCE_HZ) -> DetectorConfig:
    """
    Return the settings with a number for each of the three frequencies.

    Parameters
    ----------
    config : DetectorConfig
        What it names stays; what it leaves open (0) follows from the nominal frequency.
    nominal : float
        From `nominal_hz`. It gives way to the limits of the range that are named.

    Returns
    -------
    DetectorConfig
        lowest < nominal < highest.
    """
    named = config.hunting_frequency_hz
    low, high = config.hunting_frequency_min_hz, config.hunting_frequency_max_hz
    middle = named or nominal
    lowest = low or max(middle / REFERENCE_HZ * _LOWEST_HZ, _LEAST_HZ)
    highest = high or middle / REFERENCE_HZ * _HIGHEST_HZ
    if not named and not lowest < middle < highest:
        if not low:
            lowest = max(highest * (_LOWEST_HZ / _HIGHEST_HZ), _LEAST_HZ)
        if not high:
            highest = min(lowest * (_HIGHEST_HZ / _LOWEST_HZ), _MOST_HZ)
        middle = min(math.sqrt(lowest * highest), _FASTEST_HZ)
    return replace(
        config,
        hunting_frequency_hz=middle,
        hunting_frequency_min_hz=lowest,
        hunting_frequency_max_hz=highest,
    )
