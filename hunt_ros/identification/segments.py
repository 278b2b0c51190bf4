"""
What a record is made of, found by itself: holds of the speed, kicks, steady tails.

Each function looks at one trace and knows nothing of the others; `plateaus` puts what
they find together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from hunt_ros.analysis.steady_state import standard_error
from hunt_ros.identification.envelope import Envelope

Kind = Literal['plateau', 'ramp', 'kick', 'transient', 'gap']

#: A kick leaves a jump in its window: a residual this many times the usual one, and this
#: share of the amplitude.
_JUMP_NOISE = 3.0
_JUMP_SHARE = 0.04


@dataclass(frozen=True)
class Segment:
    """
    One stretch of a record.

    Parameters
    ----------
    kind : 'plateau', 'ramp', 'kick', 'transient' or 'gap'
    source : str
    start_ns, end_ns : int
    speed_start, speed_end : float
        m/s.
    used : bool
    reason : str
        What it was used for, or why it was dropped.
    growth_rate, growth_rate_std : float
        Mean d ln A / dt of a transient below half its largest amplitude, 1/s; NaN else.
    """

    kind: Kind
    source: str
    start_ns: int
    end_ns: int
    speed_start: float
    speed_end: float
    used: bool
    reason: str
    growth_rate: float = math.nan
    growth_rate_std: float = math.nan

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `segments`."""
        return {
            'kind': self.kind,
            'source': self.source,
            'start_ns': self.start_ns,
            'end_ns': self.end_ns,
            'speed_start_mps': self.speed_start,
            'speed_end_mps': self.speed_end,
            'used': self.used,
            'reason': self.reason,
            'growth_rate_per_s': self.growth_rate if math.isfinite(self.growth_rate) else None,
            'growth_rate_std_per_s': self.growth_rate_std
            if math.isfinite(self.growth_rate_std)
            else None,
        }


def speed_holds(
    time: NDArray[np.float64], speed: NDArray[np.float64], shortest_s: float
) -> list[tuple[int, int]]:
    """
    Stretches at one speed.

    Parameters
    ----------
    time, speed : ndarray, shape (n,)
        s, m/s.
    shortest_s : float
        Shortest stretch that counts.

    Returns
    -------
    list of (int, int)
        First index and one past the last, in order, not overlapping.
    """
    if time.size < 2:
        return []
    jitter = 1.4826 * float(np.median(np.abs(np.diff(speed)))) / math.sqrt(2.0)
    tolerance = max(0.004 * float(np.median(np.abs(speed))), 4.0 * min(jitter, 0.05))
    holds: list[tuple[int, int]] = []
    start = 0
    while start < time.size - 1:
        low = high = speed[start]
        end = start + 1
        while end < time.size:
            low, high = min(low, speed[end]), max(high, speed[end])
            if high - low > 2.0 * tolerance:
                break
            end += 1
        if time[end - 1] - time[start] >= shortest_s and not _drifts(
            time[start:end], speed[start:end], tolerance
        ):
            holds.append((start, end))
            start = end
        else:
            start += 1
    return holds


def _drifts(time: NDArray[np.float64], speed: NDArray[np.float64], tolerance: float) -> bool:
    """Whether the speed runs through its whole tolerance: a slow ramp, not a hold."""
    slope = float(np.polyfit(time - time[0], speed, 1)[0])
    return abs(slope) * float(time[-1] - time[0]) > 1.5 * tolerance


def find_kicks(envelope: Envelope) -> NDArray[np.bool_]:
    """
    Instants at which the amplitude changed as no growth law changes it.

    Parameters
    ----------
    envelope : Envelope
        Of one record.

    Returns
    -------
    ndarray of bool, shape (n,)
        True where the window holds a kick.
    """
    amplitude, residual = envelope.amplitude, envelope.residual
    kicked = np.zeros(amplitude.size, dtype=bool)
    known = np.isfinite(residual)
    if known.sum() < 4:
        return kicked
    usual = float(np.median(residual[known]))
    jump = known & (np.nan_to_num(residual) > _JUMP_NOISE * usual)
    jump &= np.nan_to_num(residual) > _JUMP_SHARE * np.nan_to_num(amplitude)
    # Not where noise has grown for good (a worn sensor), but where it stands out.
    around = median_filter(np.where(known, residual, usual), size=15, mode='nearest')
    jump &= np.nan_to_num(residual) > 2.0 * around
    for first, last in runs(jump):
        kicked[max(first - 1, 0) : last + 1] = True
    return kicked


def steady_part(amplitude: NDArray[np.float64], least: int) -> slice | None:
    """
    Longest tail over which the amplitude does not drift.

    Parameters
    ----------
    amplitude : ndarray, shape (n,)
        m, free of NaN.
    least : int
        Fewest instants that count.

    Returns
    -------
    slice or None
        None where it drifts to the very end.
    """
    n = amplitude.size
    start = 0
    while n - start >= least:
        tail = amplitude[start:]
        third = max(tail.size // 3, 2)
        drift = abs(float(tail[-third:].mean() - tail[:third].mean()))
        # The error is that of the second half, or an approach would excuse itself.
        half = tail[tail.size // 2 :]
        x = np.linspace(-0.5, 0.5, half.size)
        level = half - half.mean() - x * float(x @ half / (x @ x))
        error = standard_error(level)
        error = 2.0 * error if math.isfinite(error) else 0.0
        if drift <= max(2.5 * error, 0.01 * float(tail.mean())):
            return slice(start, n)
        start += max(1, (n - start) // 10)
    return None


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and one past the last index of each stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
