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
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hunt_ros.analysis.steady_state import (
    Direction,
    SteadyState,
    hunting_threshold,
    mean_of_maxima,
    standard_error,
)
from hunt_ros.identification.record.channels import Channels
from hunt_ros.identification.record.envelope import Envelope
from hunt_ros.identification.record.segments import (
    Kind,
    Segment,
    find_kicks,
    runs,
    speed_holds,
    steady_part,
)
from hunt_ros.identification.record.transients import find_transients, mean_growth
from hunt_ros.identification.settings import IdentificationSettings

#: Relative error of an amplitude from which the beat with the roughness is not removed.
_LOCKED = 0.02
#: Change of ln A within a piece of ramp up to which the amplitude follows the speed.
_FOLLOWING = 0.05


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
        """Add a segment, from instant to instant of the envelope."""
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

    kicked = find_kicks(channels, envelope, settings.orders)
    for start, end in runs(kicked):
        note('kick', start, end, False, 'motion that no growth law makes; a new segment begins')
    for start, end in runs(~np.isfinite(envelope.amplitude)):
        note('gap', start, end, False, 'no lateral samples, or none that the sensor measured')
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
    for start, end in find_transients(envelope, kicked):
        note('transient', start, end, True, 'free motion between quiet and limit cycle')
        rate, error = mean_growth(envelope, start, end)
        segments[-1] = replace(segments[-1], growth_rate=rate, growth_rate_std=error)
    segments.sort(key=lambda segment: segment.start_ns)
    return segments, states


def _state(
    envelope: Envelope,
    corrected: Envelope,
    start: int,
    end: int,
    direction: Direction,
    kind: Literal['plateau', 'ramp'],
) -> SteadyState | None:
    """Return the steady state of a stretch; None where it has too few amplitudes."""
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
        line_power=_median(envelope.line_power[start:end]),
    )


def _median(values: NDArray[np.float64]) -> float:
    """Median of what is known; 0 where nothing is."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else 0.0


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
