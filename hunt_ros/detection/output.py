"""What the detector gives out: rows of estimates, events, and the samples they were made of."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection.merging.journal import JournalEntry
from hunt_ros.detection.regions import Level, State
from hunt_ros.estimation.kalman import TRACK_DTYPE
from hunt_ros.samples import CHANNELS
from hunt_ros.sensors import COORDINATES, DISPLACEMENTS, MOTION

#: Columns of the tracker that stay inside: of use to the detector, or to who tunes the filter.
_INSIDE = {
    'stamp_ns',
    *(
        f'{name}_{what}'
        for name in MOTION
        for what in ('roughness_second', 'residual', 'nis', 'clean')
    ),
    'yaw_ratio',
    'yaw_ratio_std',
    'yaw_lag',
    'bandwidth',
    'second_mode_amplitude',
    'since_kick',
    'lateral_tied',
}
#: Columns that are taken over from the tracker.
TRACKER_FIELDS: tuple[str, ...] = tuple(
    name for name in TRACK_DTYPE.names or () if name not in _INSIDE
)
#: The detector's own.
_OWN = (
    'speed',
    *(f'{name}_envelope' for name in DISPLACEMENTS),
    'noise_floor',
    'noise_intensity',
    'unstable_amplitude',
    'unstable_amplitude_std',
    'stable_amplitude',
    'margin',
    'margin_low',
    'margin_high',
    'escape_probability',
    'escape_probability_low',
    'escape_probability_high',
    'outlook',
    'time_to_limit_cycle',
    # Of the test behind the state, NaN where another one decided.
    'log_likelihood_ratio',
    'log_likelihood_ratio_limit',
)

#: The strongest motion outside the range that is followed, NaN where there is none: its
#: frequency, its amplitude in m and rad; and the range, Hz.
OUTSIDE: tuple[str, ...] = (
    'outside_hz',
    *(f'outside_{name}' for name in DISPLACEMENTS),
    'followed_min_hz',
    'followed_max_hz',
)

#: One row of the estimates. Amplitudes in m (yaw: rad), rates per second, unknown as NaN.
ESTIMATE_DTYPE: np.dtype[np.void] = np.dtype(
    [
        ('stamp_ns', np.int64),
        *((name, np.float64) for name in (*TRACKER_FIELDS, *_OWN)),
        # Motion outside the range of frequencies that is followed, and that range.
        *((name, np.float64) for name in OUTSIDE),
        ('region', np.int8),
        ('state', np.int8),
        # When region, state and the word on the margin began, and the evidence behind the state.
        ('region_since_ns', np.int64),
        ('state_since_ns', np.int64),
        ('margin_since_ns', np.int64),
        ('state_cause', np.int8),
        # Amplitude limits that are exceeded, one bit each, and when the last to change did so.
        ('limits', np.uint32),
        ('limit_since_ns', np.int64),
        ('level', np.int8),
        ('alarm', np.bool_),
        ('doubts', np.uint32),
        # Of each coordinate whether all sensors of it that the rig has show nothing.
        *((f'{name}_blind', np.bool_) for name in COORDINATES),
        *((f'{name}_wrong', np.uint32) for name in CHANNELS),
    ]
)

#: The numbers of the status, in the order in which they are published.
NUMBERS: tuple[str, ...] = (*TRACKER_FIELDS, *_OWN)

#: Column -> public name, with its unit, in status, events and JSON; all others keep theirs.
PUBLIC: dict[str, str] = {
    'speed': 'speed_mps',
    'lateral_amplitude': 'amplitude_m',
    'lateral_amplitude_std': 'amplitude_std_m',
    'lateral_amplitude_rate': 'amplitude_rate_mps',
    'yaw_amplitude': 'yaw_amplitude_rad',
    'yaw_amplitude_std': 'yaw_amplitude_std_rad',
    'lateral_envelope': 'envelope_m',
    'yaw_envelope': 'yaw_envelope_rad',
    'growth_rate': 'growth_rate_per_s',
    'growth_rate_std': 'growth_rate_std_per_s',
    'unstable_amplitude': 'unstable_amplitude_m',
    'unstable_amplitude_std': 'unstable_amplitude_std_m',
    'stable_amplitude': 'stable_amplitude_m',
    'lateral_roughness': 'roughness_m',
    'noise_floor': 'noise_floor_m',
    'outlook': 'escape_chance_next_minute',
    'time_to_limit_cycle': 'time_to_limit_cycle_s',
}
#: The numbers behind an event, by column.
_BEHIND = (
    'speed',
    'lateral_amplitude',
    'lateral_amplitude_std',
    'yaw_amplitude',
    'yaw_amplitude_std',
    'growth_rate',
    'growth_rate_std',
    'frequency_hz',
    'unstable_amplitude',
    'unstable_amplitude_std',
    'stable_amplitude',
    'margin',
    'margin_low',
    'margin_high',
    'escape_probability',
    'escape_probability_low',
    'escape_probability_high',
    'time_to_limit_cycle',
    'noise_floor',
    'noise_intensity',
    'log_likelihood_ratio',
    'log_likelihood_ratio_limit',
)
#: The same by public name, in the order in which they are published.
EVENT_NUMBERS: tuple[str, ...] = tuple(PUBLIC.get(name, name) for name in _BEHIND)


def numbers_behind(row: np.void) -> dict[str, float]:
    """Return the numbers of a row (ESTIMATE_DTYPE) that stand with an event; NaN: unknown."""
    return {PUBLIC.get(name, name): float(row[name]) for name in _BEHIND}


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
        Those of `EVENT_NUMBERS` at that row; NaN where unknown. Empty before the first row.
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
    def speed_mps(self) -> float:
        """Speed, m/s; NaN where unknown."""
        return self.numbers.get('speed_mps', math.nan)

    @property
    def amplitude_m(self) -> float:
        """Lateral amplitude of the hunting, m; NaN where unknown."""
        return self.numbers.get('amplitude_m', math.nan)

    @property
    def growth_rate_per_s(self) -> float:
        """Growth rate of the hunting, 1/s; NaN where unknown."""
        return self.numbers.get('growth_rate_per_s', math.nan)


@dataclass(frozen=True, eq=False)
class Motion:
    """
    Merged samples: the motion with speed and roller angle of the same moment.

    What runs beside the detector (`hunt_ros.detection.companions`) is fed with these, so
    that it hears the same live and in a replay.

    Parameters
    ----------
    stamps_ns : ndarray of int64, shape (n,)
    values : ndarray, shape (n,)
        Lateral displacement, m; yaw, rad, where there is no lateral sensor. Samples that
        are not finite, or of a sensor that is stuck, are left out.
    speed : ndarray, shape (n,)
        m/s; NaN where it is not known.
    roller_angle : ndarray, shape (n,)
        By its encoder, rad; NaN where there is none.
    quiet : ndarray of bool, shape (n,)
        False while the wheelset hunts.
    """

    stamps_ns: NDArray[np.int64]
    values: NDArray[np.float64]
    speed: NDArray[np.float64]
    roller_angle: NDArray[np.float64]
    quiet: NDArray[np.bool_]

    def told(self, rows: NDArray[np.void]) -> Motion:
        """Return the same with what the rows (ESTIMATE_DTYPE, at least one) say of the state."""
        row = np.searchsorted(rows['stamp_ns'], self.stamps_ns)
        states = rows['state'][np.minimum(row, rows.size - 1)]
        return replace(self, quiet=states <= State.DISTURBED)

    @classmethod
    def joined(cls, motions: Sequence[Motion]) -> Motion:
        """Return several stretches, at least one, as one."""
        names = [item.name for item in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in motions]) for name in names))


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
    motion : tuple of Motion
        The samples that the rows were made of, in order.
    """

    estimates: NDArray[np.void]
    events: tuple[Event, ...] = ()
    journal: tuple[JournalEntry, ...] = ()
    motion: tuple[Motion, ...] = ()

    @classmethod
    def joined(cls, outputs: list[Output]) -> Output:
        """Return several outputs as one."""
        full = [output for output in outputs if output is not EMPTY]
        if not full:
            return EMPTY
        if len(full) == 1:
            return full[0]
        return cls(
            np.concatenate([output.estimates for output in full]),
            tuple(event for output in full for event in output.events),
            tuple(entry for output in full for entry in output.journal),
            tuple(motion for output in full for motion in output.motion),
        )


#: Nothing new.
EMPTY = Output(np.zeros(0, dtype=ESTIMATE_DTYPE))
