"""
Steady amplitudes of a record: at the ends of plateaus of the speed, and along slow ramps.

The speed parts a record into holds and ramps; an amplitude counts where it neither drifts nor was
kicked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from hunt_ros.analysis.steady_state import (
    Direction,
    SteadyState,
    hunting_threshold,
    mean_of_maxima,
    standard_error,
)
from hunt_ros.identification.record.channels import Channels, runs
from hunt_ros.identification.record.envelope import Envelope
from hunt_ros.identification.settings import IdentificationSettings

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Fewest instants of a steady amplitude, and of a piece of a ramp.
_SPAN = 6
#: Relative error of an amplitude from which the beat with the roughness is not removed.
_LOCKED = 0.02
#: Change of ln A from half to half up to which a steady amplitude stands still, where its scatter
#: is smaller, and up to which it follows a ramp of the speed.
_STILL, _FOLLOWING = 0.01, 0.05
#: A limit cycle that is smaller than so much of itself meanwhile is none.
_DIPS = 0.7


@dataclass(frozen=True, eq=False)
class Run:
    """
    One stretch of a recording: all that was `seen`, and what of it enters the fit.

    `kicked` are the instants whose windows hold a kick.
    """

    seen: Envelope
    envelope: Envelope
    corrected: Envelope
    kicked: Mask
    states: Sequence[SteadyState]

    @property
    def kicks(self) -> list[tuple[str, int]]:
        """Source and stamp, ns, of each kick."""
        return [(self.envelope.source, self.envelope.stamp(k)) for k, _ in runs(self.kicked)]


def steady_states(
    channels: Channels,
    envelope: Envelope,
    corrected: Envelope,
    kicked: Mask,
    settings: IdentificationSettings,
) -> list[SteadyState]:
    """
    Read the steady amplitudes of one record.

    Parameters
    ----------
    channels : Channels
        The record.
    envelope : Envelope
        Its hunting component.
    corrected : Envelope
        The same without the beat of roughness and hunting.
    kicked : ndarray of bool, shape (n,)
        As `find_kicks` gives it.
    settings : IdentificationSettings
        Says what counts as a plateau.

    Returns
    -------
    list of SteadyState
        In the order of time.
    """
    one = _Analysis(channels, envelope, corrected, kicked)
    time, speed = envelope.time, envelope.speed
    states: list[SteadyState | None] = []
    edge = 0
    for start, end in [*speed_holds(time, speed, settings.minimum_hold_s), (time.size, time.size)]:
        for low, high in one.one_way(edge, start):
            states += one.along_ramp(low, high)
        if end > start:
            states.append(one.on_plateau(start, end))
        edge = end
    return [state for state in states if state is not None]


@dataclass(frozen=True, eq=False)
class _Analysis:
    """A record and its envelope, with and without the beat; where it was kicked."""

    channels: Channels
    envelope: Envelope
    corrected: Envelope
    kicked: Mask

    @cached_property
    def threshold(self) -> float:
        """Amplitude that parts quiet from hunting, m; inf where all is of one kind."""
        found = hunting_threshold(self.envelope.amplitude)
        return math.inf if found is None else found

    @cached_property
    def tolerance(self) -> float:
        """Change of the speed that is none, m/s."""
        return 0.004 * float(np.median(np.abs(self.envelope.speed)))

    def state(
        self, start: int, end: int, kind: Literal['plateau', 'ramp'], direction: Direction
    ) -> SteadyState | None:
        """Return the steady state of a stretch; None where it has too few amplitudes."""
        part, envelope = slice(start, end), self.envelope
        amplitude = _known(self.corrected.amplitude[part])
        locked = 0.0
        if amplitude.size < 3:
            # Locked to the roughness line: the amplitude is real, but not hunting's alone.
            amplitude, locked = _known(envelope.amplitude[part]), _LOCKED
        if amplitude.size < 3:
            return None
        noise, mean = float(np.nanmedian(envelope.noise[part])), float(np.mean(amplitude))
        hz = float(np.mean(envelope.frequency[part]))
        duration = float(envelope.time[end - 1] - envelope.time[start]) + envelope.step
        maxima = maxima_std = math.nan
        if kind == 'plateau':
            time, ends = self.channels.time, envelope.time[[start, end - 1]]
            inside = self.channels.lateral[(time >= ends[0]) & (time <= ends[1])]
            maxima, maxima_std, _ = mean_of_maxima(inside, self.channels.rate_hz, hz)
        return SteadyState(
            speed=float(np.mean(envelope.speed[part])),
            # The mean square holds the noise of two parts; take it out again.
            amplitude=math.sqrt(max(mean**2 - noise**2, 0.0)),
            amplitude_std=math.hypot(standard_error(amplitude), locked * mean),
            direction=direction,
            cycles=int(duration * hz),
            maxima=maxima,
            maxima_std=maxima_std,
            kind=kind,
            source=envelope.source,
            start_ns=envelope.stamp(start),
            end_ns=envelope.stamp(end - 1),
        )

    def on_plateau(self, start: int, end: int) -> SteadyState | None:
        """Steady amplitude at the end of a plateau; None where it changes still."""
        amplitude = self.envelope.amplitude[start:end]
        # A reading that stands still has an amplitude of zero, which tells nothing of ln A.
        broken = np.flatnonzero(self.kicked[start:end] | ~(amplitude > 0.0))
        first = int(broken[-1]) + 1 if broken.size else 0
        tail = steady_part(amplitude[first:])
        if tail is None:
            return None
        steady = amplitude[first:][tail]
        if steady.min() < _DIPS * steady.max() and steady.mean() > self.threshold:
            return None
        return self.state(start + first + tail.start, end, 'plateau', self.direction(start, end))

    def direction(self, start: int, end: int) -> Direction:
        """Which way the speed came from: the last change before a stretch, or within it."""
        speed = self.envelope.speed
        within, here = float(speed[end - 1] - speed[start]), float(np.mean(speed[start:end]))
        if abs(within) <= 2.0 * self.tolerance:
            other = np.flatnonzero(np.abs(speed[:start] - here) > 2.0 * self.tolerance)
            if not other.size:
                return 'hold'
            within = here - float(speed[other[-1]])
        return 'up' if within > 0.0 else 'down'

    def along_ramp(self, low: int, high: int) -> Iterator[SteadyState | None]:
        """Nearly steady amplitudes along a ramp, where the amplitude follows the speed."""
        rises = self.envelope.speed[high - 1] > self.envelope.speed[low]
        for begin in range(low, high - _SPAN + 1, _SPAN):
            amplitude = self.envelope.amplitude[begin : begin + _SPAN]
            if self.kicked[begin : begin + _SPAN].any() or not (amplitude > 0.0).all():
                continue
            if amplitude.mean() > self.threshold and abs(drift(amplitude)) > _FOLLOWING:
                continue
            yield self.state(begin, begin + _SPAN, 'ramp', 'up' if rises else 'down')

    def one_way(self, start: int, end: int) -> list[tuple[int, int]]:
        """Part a stretch where its speed turns round by more than the tolerance."""
        speed = self.envelope.speed[start:end]
        turns = [find_peaks(x, prominence=2.0 * self.tolerance)[0] for x in (speed, -speed)]
        edges = [start, *(start + 1 + np.sort(np.concatenate(turns))).tolist(), end]
        return [(a, b) for a, b in pairwise(edges) if b - a > 1]


def _known(values: Array) -> Array:
    return values[np.isfinite(values)]


def drift(amplitude: Array) -> float:
    """Change of ln A from the first half of a stretch to the second."""
    half = amplitude.size // 2
    return math.log(float(amplitude[half:].mean() / amplitude[:half].mean()))


def steady_part(amplitude: Array) -> slice | None:
    """
    Longest tail over which the amplitude does not drift.

    Parameters
    ----------
    amplitude : ndarray, shape (n,)
        m, free of NaN.

    Returns
    -------
    slice or None
        None where it drifts to the very end.
    """
    n = amplitude.size
    start = 0
    while n - start >= _SPAN:
        tail = amplitude[start:]
        # The error is that of the second half, or an approach would excuse itself.
        half = tail[tail.size // 2 :]
        x = np.linspace(-0.5, 0.5, half.size)
        error = standard_error(half - half.mean() - x * float(x @ half / (x @ x)))
        error = np.nan_to_num(error) / float(tail.mean())
        if abs(drift(tail)) <= max(5.0 * error, _STILL):
            return slice(start, n)
        start += max(1, (n - start) // 10)
    return None


def speed_holds(time: Array, speed: Array, shortest_s: float) -> list[tuple[int, int]]:
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
    # By second differences: a ramp has none.
    bends = np.abs(np.diff(speed, 2)) if time.size > 2 else np.zeros(1)
    jitter = 1.4826 * float(np.median(bends)) / math.sqrt(6.0)
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


def _drifts(time: Array, speed: Array, tolerance: float) -> bool:
    """Whether the speed runs through its whole tolerance: a slow ramp, not a hold."""
    slope = float(np.polyfit(time - time[0], speed, 1)[0])
    return abs(slope) * float(time[-1] - time[0]) > 1.5 * tolerance
