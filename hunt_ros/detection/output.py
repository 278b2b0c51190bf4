"""What the detector gives out: rows of estimates, events, and the samples they were made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection.journal import JournalEntry
from hunt_ros.detection.regions import Level, State
from hunt_ros.estimation.kalman import TRACK_DTYPE

#: Columns of the tracker that stay inside: of use to the detector, or to who tunes the filter.
_INSIDE = {
    'stamp_ns',
    'lateral_roughness_second',
    'yaw_roughness_second',
    'lateral_residual',
    'yaw_residual',
    'lateral_nis',
    'yaw_nis',
    'lateral_clean',
    'yaw_clean',
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
    'lateral_envelope',
    'yaw_envelope',
    'noise_floor',
    'noise_intensity',
    'unstable_amplitude',
    'unstable_amplitude_std',
    'stable_amplitude',
    'margin',
    'margin_low',
    'margin_high',
    'escape_probability',
    'outlook',
    'time_to_limit_cycle',
)

#: The strongest motion outside the range that is followed, NaN where there is none: its
#: frequency, its amplitude in m and rad; and the range, Hz.
OUTSIDE: tuple[str, ...] = (
    'outside_hz',
    'outside_lateral',
    'outside_yaw',
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
        ('level', np.int8),
        ('alarm', np.bool_),
        ('doubts', np.uint32),
        ('lateral_wrong', np.uint32),
        ('yaw_wrong', np.uint32),
        ('roller_wrong', np.uint32),
        ('speed_wrong', np.uint32),
    ]
)

#: The numbers of the status, in the order in which they are published.
NUMBERS: tuple[str, ...] = (*TRACKER_FIELDS, *_OWN)


@dataclass(frozen=True)
class Event:
    """
    One transition.

    Parameters
    ----------
    stamp_ns : int
        Row at which it was decided.
    event : str
        One of the words of the design: 'hysteresis_entered', 'escaping', ...
    speed_mps, amplitude_m, growth_rate_per_s : float
        Estimates at that row; NaN where unknown.
    level : Level
        In force from then on.
    since_ns : int
        When it began: the stamp of the first row that showed it, of the last good sample of a
        channel that is silent, or of the last sign of a fault that is over.
    cause : str
        Why, as a sentence with the numbers behind it.
    """

    stamp_ns: int
    event: str
    speed_mps: float
    amplitude_m: float
    growth_rate_per_s: float
    level: Level
    since_ns: int
    cause: str


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
