"""
The words of the detector - region, state, level - and how a number becomes one without chattering.

Functions of numbers: no sample, no stream, no clock.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part


class _Word(IntEnum):
    @property
    def label(self) -> str:
        """The word in status, events and JSON."""
        return self.name.lower()


class Region(_Word):
    """Where the speed lies on the bifurcation diagram."""

    UNKNOWN = 0
    STABLE = 1
    HYSTERESIS = 2
    UNSTABLE = 3


class State(_Word):
    """What the wheelset does."""

    QUIET = 0
    DISTURBED = 1
    ESCAPING = 2
    LIMIT_CYCLE = 3
    DECAYING = 4


class Level(_Word):
    """Severity, numbered as in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3

    @property
    def label(self) -> str:
        """The word in status, events and JSON."""
        return self.name


#: A word that is held: the word in force, the word the numbers ask for, the rows that have
#: passed since they first did, and the stamps, ns, at which they did so first for either.
HELD: np.dtype[np.void] = np.dtype(
    [(name, np.int64) for name in ('word', 'wanted', 'waited', 'since_ns', 'wanted_ns')],
    align=True,
)


@compiled_part
def hold(memory: Any, wanted: int, rows: int, stamp_ns: int) -> bool:
    """
    Take a new word once it has been wanted without a break while so many rows passed.

    From the first row that asks for it to the row at which it is taken it is `rows` rows:
    the hold time, no more and no less. 0 takes it at once.

    Parameters
    ----------
    memory
        A record of HELD.
    wanted : int
        The word the numbers ask for.
    rows : int
        Hold time in rows.
    stamp_ns : int
        Of the row.

    Returns
    -------
    bool
        True where the word in force is another from this row on.
    """
    if wanted == memory['word']:
        memory['wanted'] = wanted
        memory['waited'] = 0
        return False
    if wanted != memory['wanted']:
        memory['wanted'] = wanted
        memory['wanted_ns'] = stamp_ns
        memory['waited'] = 0
    if memory['waited'] < rows:
        memory['waited'] += 1
        return False
    memory['word'] = wanted
    memory['since_ns'] = memory['wanted_ns']
    memory['waited'] = 0
    return True


@compiled_part
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
    upper, lower = critical_speed, fold
    if region == 3:
        upper -= band
    elif region > 0:
        upper += band
    if region == 2:
        lower -= band
    elif region == 1:
        lower += band
    if speed >= upper:
        return 3
    return 2 if fold < critical_speed and speed >= lower else 1
