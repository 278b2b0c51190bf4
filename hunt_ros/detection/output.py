"""What the detector gives out: rows of estimates, events, and the samples they were made of."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection.journal import JournalEntry
from hunt_ros.detection.regions import Level
from hunt_ros.estimation.kalman import TRACK_DTYPE
from hunt_ros.samples import CHANNELS, NANOSECONDS
from hunt_ros.sensors import COORDINATES, DISPLACEMENTS, MOTION


class Column(NamedTuple):
    """
    One column of the rows: the table `COLUMNS` makes dtype, status, events and JSON.

    Parameters
    ----------
    name : str
        Amplitudes are in m (yaw: rad), rates per second; unknown numbers are NaN.
    public : str or None
        Its name, with the unit, in status, events and JSON; '': the same; None: it stays inside.
    event : bool
        It stands with an event.
    dtype : type
        Of numpy.
    """

    name: str
    public: str | None = ''
    event: bool = False
    dtype: type = np.float64


#: The columns of the tracker that are named anew or stand with events; then those that stay
#: inside, of use to the detector, or to who tunes the filter.
_TRACKED = {
    column.name: column
    for column in (
        Column('stamp_ns', None, dtype=np.int64),
        Column('lateral_amplitude', 'amplitude_m', True),
        Column('lateral_amplitude_std', 'amplitude_std_m', True),
        Column('lateral_amplitude_rate', 'amplitude_rate_mps'),
        Column('yaw_amplitude', 'yaw_amplitude_rad', True),
        Column('yaw_amplitude_std', 'yaw_amplitude_std_rad', True),
        Column('growth_rate', 'growth_rate_per_s', True),
        Column('growth_rate_std', 'growth_rate_std_per_s', True),
        Column('frequency_hz', '', True),
        Column('lateral_roughness', 'roughness_m'),
    )
}
_INSIDE = {
    *(f'{name}_{what}' for name in MOTION for what in ('roughness_second', 'clean')),
    *('yaw_ratio', 'yaw_ratio_std', 'yaw_lag', 'yaw_factor', 'yaw_contrary', 'lateral_tied'),
}
_TAKEN = tuple(name for name in TRACK_DTYPE.names or () if name not in _INSIDE)
#: Columns that are taken over from the tracker.
TRACKER_FIELDS = _TAKEN[1:]

COLUMNS: tuple[Column, ...] = (
    *(_TRACKED.get(name, Column(name)) for name in _TAKEN),
    Column('speed', 'speed_mps', True),
    Column('lateral_envelope', 'envelope_m'),
    Column('yaw_envelope', 'yaw_envelope_rad'),
    Column('lateral_measured', 'largest_lateral_m'),
    Column('yaw_measured', 'largest_yaw_rad'),
    Column('noise_floor', 'noise_floor_m', True),
    Column('noise_intensity', '', True),
    Column('unstable_amplitude', 'unstable_amplitude_m', True),
    Column('unstable_amplitude_std', 'unstable_amplitude_std_m', True),
    Column('stable_amplitude', 'stable_amplitude_m', True),
    Column('margin', '', True),
    Column('margin_low', '', True),
    Column('margin_high', '', True),
    Column('escape_probability', '', True),
    Column('escape_probability_low', '', True),
    Column('escape_probability_high', '', True),
    Column('outlook', 'escape_chance_next_minute'),
    Column('time_to_limit_cycle', 'time_to_limit_cycle_s', True),
    Column('hunting_probability', '', True),
    # The strongest motion outside the range that is followed, and that range.
    *(Column(f'outside_{what}', None) for what in ('hz', *DISPLACEMENTS)),
    Column('followed_min_hz', None),
    Column('followed_max_hz', None),
    # The smallest steps of the readings, half their range in the last seconds; of the motion that
    # is judged its steps, its amplitude, and that outside the range that is followed.
    *(Column(f'{x}_{what}', None) for x in DISPLACEMENTS for what in ('step', 'swing')),
    *(Column(name, None) for name in ('step', 'judged', 'judged_std', 'outside_judged')),
    *(Column(name, None, dtype=np.int8) for name in ('region', 'state', 'level')),
    # When region, state and the word on the margin began, and the evidence behind the state.
    *(Column(f'{what}_since_ns', None, dtype=np.int64) for what in ('region', 'state', 'margin')),
    Column('state_cause', None, dtype=np.int8),
    # Amplitude limits that are exceeded, one bit each, and when the last to change did so.
    Column('limits', None, dtype=np.uint32),
    Column('limit_since_ns', None, dtype=np.int64),
    Column('alarm', None, dtype=np.bool_),
    Column('doubts', None, dtype=np.uint32),
    # Of each coordinate whether all sensors of it that the rig has show nothing.
    *(Column(f'{name}_blind', None, dtype=np.bool_) for name in COORDINATES),
    *(Column(f'{name}_wrong', None, dtype=np.uint32) for name in CHANNELS),
)
#: Public name of each number of the status, by column, in the order in which they are published.
PUBLIC: dict[str, str] = {c.name: c.public or c.name for c in COLUMNS if c.public is not None}
#: Public names of the numbers behind an event.
EVENT_NUMBERS: tuple[str, ...] = tuple(PUBLIC[c.name] for c in COLUMNS if c.event)
#: One row of the estimates.
ESTIMATE_DTYPE: np.dtype[np.void] = np.dtype([(c.name, c.dtype) for c in COLUMNS])
_BLANK = np.array(
    [tuple(math.nan if c.dtype is np.float64 else 0 for c in COLUMNS)], dtype=ESTIMATE_DTYPE
)


def blank_rows(stamps_ns: NDArray[np.int64]) -> NDArray[np.void]:
    """Return rows of which nothing is known yet but their stamps, ns."""
    rows = np.repeat(_BLANK, stamps_ns.size)
    rows['stamp_ns'] = stamps_ns
    return rows


def no_row(stamp_ns: int = 0) -> np.void:
    """Return what stands for the last row before there is one."""
    row: np.void = blank_rows(np.array([stamp_ns]))[0]
    row['level'] = Level.STALE
    return row


def joined_rows(parts: Sequence[NDArray[np.void]]) -> NDArray[np.void]:
    """Return rows of one dtype, one part after the other, at least one part."""
    # As bytes: of records numpy copies each field by itself, which takes forty times as long.
    dtype = parts[0].dtype
    plain = np.dtype((np.void, dtype.itemsize))
    return np.concatenate([part.view(plain) for part in parts]).view(dtype)


def numbers_behind(row: np.void) -> dict[str, float]:
    """Return the numbers of a row (ESTIMATE_DTYPE) that stand with an event; NaN: unknown."""
    return {PUBLIC[c.name]: float(row[c.name]) for c in COLUMNS if c.event}


def seconds_text(stamp_ns: int) -> str:
    """Return a stamp in seconds, to the millisecond; '' where there is none."""
    return f'{stamp_ns / NANOSECONDS:.3f}' if stamp_ns else ''


@dataclass(frozen=True)
class Event:
    """
    One transition, and why.

    Parameters
    ----------
    stamp_ns : int
        Row at which it was decided.
    event : str
        One of the words of the design: 'hysteresis_entered', 'escaping', ...
    level : Level
        In force from then on.
    since_ns : int
        When it began: the stamp of the first row that showed it, of the last good sample of a
        channel that is silent, or of the last sign of a fault that is over.
    test : str
        Which test decided: 'escape_probability', 'speed', 'timeout', ...
    cause : str
        Why, as a sentence with the numbers that count.
    normal_form : str
        The form in force, by its critical speeds; '' where there is none.
    numbers : mapping of str to float
        Those of `EVENT_NUMBERS` at that row; NaN where unknown.
    """

    stamp_ns: int
    event: str
    level: Level
    since_ns: int
    test: str
    cause: str
    normal_form: str = ''
    numbers: Mapping[str, float] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, object]:
        """It as it is published in `hunting/events`, with the unit in the key."""
        return {
            'event': self.event,
            'since_s': seconds_text(self.since_ns),
            'decided_s': seconds_text(self.stamp_ns),
            'test': self.test,
            'cause': self.cause,
            'normal_form': self.normal_form,
            **self.numbers,
        }

    def number(self, key: str) -> float:
        """Return one of the numbers behind it, e.g. 'amplitude_m'; NaN: unknown."""
        return self.numbers.get(key, math.nan)


#: Merged samples of the motion, what runs beside the detector (`hunt_ros.detection.companions`) is
#: fed with, so that it hears the same live and in a replay: stamp; lateral displacement, m (yaw,
#: rad, where there is no lateral sensor), without what is not finite, or of a sensor that is
#: stuck; of the same moment the speed, m/s, and the angle of the roller by its encoder, rad, NaN
#: where unknown; and False while the wheelset hunts.
MOTION_DTYPE: np.dtype[np.void] = np.dtype(
    [
        ('stamps_ns', np.int64),
        *((name, np.float64) for name in ('values', 'speed', 'roller_angle')),
        ('quiet', np.bool_),
    ]
)


@dataclass(frozen=True, eq=False)
class Output:
    """
    What one call added.

    Parameters
    ----------
    estimates : ndarray of ESTIMATE_DTYPE, shape (m,)
        Rows on the output grid, in order.
    events : tuple of Event
        Transitions, in order.
    journal : tuple of JournalEntry
        What a replay needs beside the samples.
    motion : ndarray of MOTION_DTYPE, shape (n,)
        The samples that the rows were made of, in order.
    """

    estimates: NDArray[np.void]
    events: tuple[Event, ...] = ()
    journal: tuple[JournalEntry, ...] = ()
    motion: NDArray[np.void] = field(default_factory=lambda: np.zeros(0, dtype=MOTION_DTYPE))

    @classmethod
    def joined(cls, outputs: list[Output]) -> Output:
        """Return several outputs as one."""
        full = [output for output in outputs if output is not EMPTY] or [EMPTY]
        if len(full) == 1:
            return full[0]
        return cls(
            joined_rows([output.estimates for output in full]),
            tuple(event for output in full for event in output.events),
            tuple(entry for output in full for entry in output.journal),
            joined_rows([output.motion for output in full]),
        )


#: Nothing new.
EMPTY = Output(np.zeros(0, dtype=ESTIMATE_DTYPE))
