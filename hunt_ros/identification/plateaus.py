"""
Find in a recording by itself: plateaus, ramps, kicks and free transients.

The speed parts a record into holds and ramps; the envelope shows where something else
than the growth law moved the wheelset (a kick), and where it moved freely between the
quiet state and the limit cycle (a transient). Each stretch says whether it was used, and
if not, why.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from hunt_ros.analysis.steady_state import (
    Direction,
    SteadyState,
    hunting_threshold,
    mean_of_maxima,
    standard_error,
)
from hunt_ros.identification.envelope import Channels, Envelope
from hunt_ros.identification.settings import IdentificationSettings

Kind = Literal['plateau', 'ramp', 'kick', 'transient', 'gap']

#: A kick leaves a jump in its window: a residual this many times the usual one, and this
#: share of the amplitude.
_JUMP_NOISE = 3.0
_JUMP_SHARE = 0.04
#: Relative error of an amplitude from which the beat with the roughness is not removed.
_LOCKED = 0.02
#: Change of ln A within a piece of ramp up to which the amplitude follows the speed.
_FOLLOWING = 0.05


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


def _direction(envelope: Envelope, start: int, end: int, tolerance: float) -> Direction:
    """Which way the speed came from: the last change before the stretch, or within it."""
    speed = envelope.speed
    within = float(speed[end - 1] - speed[start])
    if abs(within) > 2.0 * tolerance:
        return 'up' if within > 0.0 else 'down'
    here = float(np.mean(speed[start:end]))
    for k in range(start - 1, -1, -1):
        if abs(speed[k] - here) > 2.0 * tolerance:
            return 'up' if speed[k] < here else 'down'
    return 'hold'


def analyse_record(
    channels: Channels,
    envelope: Envelope,
    corrected: Envelope,
    settings: IdentificationSettings,
) -> tuple[list[Segment], list[SteadyState]]:
    """
    Part one record into segments, and read its steady amplitudes.

    Parameters
    ----------
    channels : Channels
        The record.
    envelope : Envelope
        Its hunting component.
    corrected : Envelope
        The same without the beat of roughness and hunting.
    settings : IdentificationSettings
        Says what counts as a plateau.

    Returns
    -------
    segments : list of Segment
    states : list of SteadyState
        In the order of time.
    """
    time, speed = envelope.time, envelope.speed
    segments: list[Segment] = []
    states: list[SteadyState] = []

    def note(kind: Kind, start: int, end: int, used: bool, reason: str) -> None:
        segments.append(
            Segment(
                kind,
                envelope.source,
                envelope.start_ns + int(1e9 * time[start]),
                envelope.start_ns + int(1e9 * time[end - 1]),
                float(speed[start]),
                float(speed[end - 1]),
                used,
                reason,
            )
        )

    kicked = find_kicks(envelope)
    for start, end in runs(kicked):
        note('kick', start, end, False, 'motion that no growth law makes; a new segment begins')
    for start, end in runs(~np.isfinite(envelope.amplitude)):
        note('gap', start, end, False, 'lateral samples dropped out')
    holds = speed_holds(time, speed, settings.minimum_hold_s)
    tolerance = 0.004 * float(np.median(np.abs(speed)))
    edge = 0
    for start, end in [*holds, (time.size, time.size)]:
        if start - edge > 1:
            states += _along_ramp(envelope, corrected, kicked, edge, start, tolerance, note)
        if end > start:
            state = _on_plateau(channels, envelope, corrected, kicked, start, end, tolerance, note)
            if state is not None:
                states.append(state)
        edge = end
    for start, end in _transients(envelope, kicked):
        note('transient', start, end, True, 'free motion between quiet and limit cycle')
        rate, error = _mean_growth(envelope, start, end)
        segments[-1] = replace(segments[-1], growth_rate=rate, growth_rate_std=error)
    segments.sort(key=lambda segment: segment.start_ns)
    return segments, states


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and one past the last index of each stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _state(
    envelope: Envelope,
    corrected: Envelope,
    start: int,
    end: int,
    direction: Direction,
    kind: Literal['plateau', 'ramp'],
) -> SteadyState | None:
    amplitude = corrected.amplitude[start:end]
    amplitude = amplitude[np.isfinite(amplitude)]
    locked = 0.0
    if amplitude.size < 3:
        # Locked to the roughness line: the amplitude is real, but not hunting's alone.
        amplitude = envelope.amplitude[start:end]
        amplitude = amplitude[np.isfinite(amplitude)]
        locked = _LOCKED
    if amplitude.size < 3:
        return None
    noise = float(np.nanmedian(envelope.noise[start:end]))
    duration = float(envelope.time[end - 1] - envelope.time[start]) + envelope.step
    return SteadyState(
        speed=float(np.mean(envelope.speed[start:end])),
        # The mean square holds the noise of two parts; take it out again.
        amplitude=math.sqrt(max(float(np.mean(amplitude)) ** 2 - noise**2, 0.0)),
        amplitude_std=math.hypot(standard_error(amplitude), locked * float(np.mean(amplitude))),
        direction=direction,
        cycles=int(duration * float(np.mean(envelope.frequency[start:end]))),
        noise=noise,
        kind=kind,
        source=envelope.source,
        start_ns=envelope.start_ns + int(1e9 * envelope.time[start]),
        end_ns=envelope.start_ns + int(1e9 * envelope.time[end - 1]),
    )


def _on_plateau(
    channels: Channels,
    envelope: Envelope,
    corrected: Envelope,
    kicked: NDArray[np.bool_],
    start: int,
    end: int,
    tolerance: float,
    note: Any,
) -> SteadyState | None:
    """Steady amplitude at the end of a plateau."""
    amplitude = envelope.amplitude[start:end]
    broken = np.flatnonzero(kicked[start:end] | ~np.isfinite(amplitude))
    first = int(broken[-1]) + 1 if broken.size else 0
    least = 6
    if amplitude.size - first < least:
        note('plateau', start, end, False, 'too short after the last kick or gap')
        return None
    tail = steady_part(amplitude[first:], least)
    if tail is not None:
        part = amplitude[first:][tail]
        threshold = hunting_threshold(envelope.amplitude)
        if threshold is not None and part.mean() > threshold and part.min() < 0.7 * part.max():
            tail = None
    if tail is None:
        note('plateau', start, end, False, 'the amplitude is still changing at its end')
        return None
    begin = start + first + tail.start
    state = _state(
        envelope, corrected, begin, end, _direction(envelope, start, end, tolerance), 'plateau'
    )
    if state is None:
        note('plateau', start, end, False, 'too few instants')
        return None
    note('plateau', start, end, True, f'steady amplitude over {state.cycles} cycles')
    inside = (channels.time >= envelope.time[begin]) & (channels.time <= envelope.time[end - 1])
    maxima, error, _ = mean_of_maxima(
        channels.lateral[inside], channels.rate_hz, float(np.mean(envelope.frequency[begin:end]))
    )
    return _with_maxima(state, maxima, error)


def _with_maxima(state: SteadyState, maxima: float, error: float) -> SteadyState:
    return replace(state, maxima=maxima, maxima_std=error)


def _along_ramp(
    envelope: Envelope,
    corrected: Envelope,
    kicked: NDArray[np.bool_],
    start: int,
    end: int,
    tolerance: float,
    note: Any,
) -> Sequence[SteadyState]:
    """Nearly steady amplitudes along a ramp, where the amplitude follows the speed."""
    states = []
    span = 6
    threshold = hunting_threshold(envelope.amplitude)
    # A ramp that turns round is parted where it turns.
    for low, high in _monotonic(envelope.speed, start, end, tolerance):
        direction: Direction = 'up' if envelope.speed[high - 1] > envelope.speed[low] else 'down'
        used = 0
        for begin in range(low, high - span + 1, span):
            piece = slice(begin, begin + span)
            amplitude = envelope.amplitude[piece]
            if kicked[piece].any() or not np.isfinite(amplitude).all():
                continue
            if threshold is not None and amplitude.mean() > threshold and _moving(amplitude):
                continue
            state = _state(envelope, corrected, begin, begin + span, direction, 'ramp')
            if state is not None:
                states.append(state)
                used += 1
        reason = f'{used} nearly steady amplitudes' if used else 'too short for an amplitude'
        note('ramp', low, high, used > 0, reason)
    return states


def _moving(amplitude: NDArray[np.float64]) -> bool:
    """Whether a large amplitude is on its way somewhere else, not following the speed."""
    half = amplitude.size // 2
    drift = math.log(float(amplitude[half:].mean() / amplitude[:half].mean()))
    return abs(drift) > _FOLLOWING


def _monotonic(
    speed: NDArray[np.float64], start: int, end: int, tolerance: float
) -> list[tuple[int, int]]:
    """Part a stretch where its speed turns round by more than the tolerance."""
    parts = []
    first = start
    extreme = start
    heading = 0
    for k in range(start + 1, end):
        change = speed[k] - speed[extreme]
        if heading == 0:
            if abs(change) > tolerance:
                heading = 1 if change > 0.0 else -1
                extreme = k
        elif change * heading > 0.0:
            extreme = k
        elif abs(change) > 2.0 * tolerance:
            parts.append((first, extreme + 1))
            first = extreme + 1
            heading = -heading
            extreme = k
    if end - first > 1:
        parts.append((first, end))
    return parts


def _mean_growth(envelope: Envelope, start: int, end: int) -> tuple[float, float]:
    """Slope of ln A over the small part of a transient, and its deviation, 1/s."""
    amplitude, time = envelope.amplitude[start:end], envelope.time[start:end]
    small = amplitude < 0.5 * float(amplitude.max())
    if small.sum() < 5:
        return math.nan, math.nan
    line, covariance = np.polyfit(time[small], np.log(amplitude[small]), 1, cov=True)
    return float(line[0]), math.sqrt(float(covariance[0, 0]))


def _transients(envelope: Envelope, kicked: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Stretches in which the amplitude is on its way from one state to another."""
    amplitude = envelope.amplitude
    threshold = hunting_threshold(amplitude)
    if threshold is None:
        return []
    logs = np.log(np.where(amplitude > 0.0, amplitude, np.nan))
    span = 6
    moving = np.zeros(amplitude.size, dtype=bool)
    for k in range(amplitude.size - span):
        piece = logs[k : k + span + 1]
        if np.isfinite(piece).all() and not kicked[k : k + span + 1].any():
            steps = np.diff(piece)
            drift = piece[-1] - piece[0]
            # A drift against the scatter of its own steps, and not a small one.
            if abs(drift) > 0.3 and abs(drift) > 2.0 * float(np.std(steps)) * math.sqrt(span):
                moving[k : k + span + 1] = True
    return [(a, b) for a, b in runs(moving) if np.nanmax(amplitude[a:b]) > 0.5 * threshold]
