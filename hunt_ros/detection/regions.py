"""
The words of the detector - region, state, level - and the comparisons behind them.

Everything here is a function of numbers: no sample, no stream, no clock. What
belongs here is how a number becomes a word without chattering.
"""

from __future__ import annotations

import math
from enum import IntEnum

from hunt_ros.compiled import compiled


class Region(IntEnum):
    """Where the speed lies on the bifurcation diagram."""

    UNKNOWN = 0
    STABLE = 1
    HYSTERESIS = 2
    UNSTABLE = 3

    @property
    def label(self) -> str:
        """The word in status, events and JSON."""
        return self.name.lower()


class State(IntEnum):
    """What the wheelset does."""

    QUIET = 0
    DISTURBED = 1
    ESCAPING = 2
    LIMIT_CYCLE = 3
    DECAYING = 4

    @property
    def label(self) -> str:
        """The word in status, events and JSON."""
        return self.name.lower()


class Level(IntEnum):
    """Severity, numbered as in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3

    @property
    def label(self) -> str:
        """The word in status, events and JSON."""
        return self.name


@compiled
def switched(on: bool, value: float, threshold_in: float, threshold_out: float) -> bool:
    """
    Compare with hysteresis: on above `threshold_in`, off below `threshold_out`.

    Parameters
    ----------
    on : bool
        What it was.
    value : float
        Compared value, unit of the thresholds; NaN changes nothing.
    threshold_in, threshold_out : float
        The first not below the second.

    Returns
    -------
    bool
    """
    if value > threshold_in:
        return True
    if value < threshold_out:
        return False
    return on


@compiled
def held(current: int, wanted: int, waited: int, hold: int) -> tuple[int, int]:
    """
    Take a new word only after it has been wanted for `hold` steps on end.

    Parameters
    ----------
    current, wanted : int
        The word in force and the word the numbers ask for.
    waited : int
        Steps for which something else than `current` has been wanted.
    hold : int
        Steps it must be wanted for; 0 takes it at once.

    Returns
    -------
    current, waited : int
    """
    if wanted == current:
        return current, 0
    if waited >= hold:
        return wanted, 0
    return current, waited + 1


@compiled
def region_of(
    region: int, speed: float, nonlinear_speed: float, critical_speed: float, band: float
) -> int:
    """
    Region of a speed, with a band around each boundary in which nothing changes.

    Parameters
    ----------
    region : int
        The `Region` it was in.
    speed : float
        Running speed, m/s; NaN gives `Region.UNKNOWN`.
    nonlinear_speed, critical_speed : float
        v_n and v_c, m/s. v_n is NaN on a rig without a fold: then the hysteresis
        region does not exist. v_c is NaN where nothing is known.
    band : float
        Half the width of the band, m/s.

    Returns
    -------
    int
        A `Region`.
    """
    if math.isnan(speed) or math.isnan(critical_speed):
        return 0
    fold = critical_speed if math.isnan(nonlinear_speed) else nonlinear_speed
    # Coming from outside, the boundary stands as it is; from inside it gives way by the band.
    upper = critical_speed - band if region == 3 else critical_speed
    if 0 < region < 3:
        upper = critical_speed + band
    lower = fold - band if region == 2 else fold
    if region == 1:
        lower = fold + band
    if speed >= upper:
        return 3
    if fold < critical_speed and speed >= lower:
        return 2
    return 1
