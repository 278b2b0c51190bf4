"""
Events in an envelope: rest, and motion out of it that stayed, died, or grew by itself.

The envelope is parted into rest and motion out of it. A motion that began faster than the rest
before it can have grown was kicked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hunt_ros.analysis.steady_state import ABOVE_NOISE
from hunt_ros.identification.record.channels import runs
from hunt_ros.identification.record.envelope import (
    STEP_CYCLES,
    WINDOW_CYCLES,
    WINDOW_OVERLAP,
    WINDOW_REACH,
    Envelope,
)
from hunt_ros.samples import as_json, key

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Kind = Literal['rest', 'stayed', 'died', 'grew']

#: Cycles that rest, and a limit cycle, are seen at least: what passes by the place where the two
#: limit cycles have just vanished lingers there for some tens of cycles.
_REST_CYCLES, _STAY_CYCLES = 12.0, 40.0
#: ... and in times in which it dies by a factor of e: past that place by a share d of the way to
#: where rest loses its damping it lingers pi / (2 sqrt(d)) of them.
_STAY_DECAYS = 10.0
#: Speeds that count as one, relative.
ONE_SPEED = 0.01
#: Scatter of ln A of a limit cycle at one speed, at most: half of that of noise (Rayleigh's).
_SCATTER = 0.32
#: A fold is hardly smaller than so much of the largest limit cycle: what is, is noise next to v_c.
#: With growth a + b A^2 - c A^4 that is 4 a c < (15^2 - 1) b^2.
SMALLEST = 0.25
#: Mean square of random motion without damping, in units of what it gathers in its time: below
#: this once in a hundred times. That of two Wiener processes over one second, whose transform,
#: 1 / cosh sqrt(2 s), is the one of the time in which one of them comes to +-1 (Borodin, A. N.,
#: Salminen, P., Handbook of Brownian Motion (2002), 1.9.3 and 3.0.1 of part II).
_UNDAMPED = 0.127
#: Growth out of rest may be so many times faster than the rest before it allows, by its nonlinear
#: part; what is faster was kicked.
_FASTER = 4.0
#: Where growth rises in proportion to v - v_c, it took twice the time that its last rate says to
#: come out of the noise; a half more for the noise itself.
_GREW_SINCE = 3.0


@dataclass(frozen=True)
class Event:
    """
    Something that was seen, once.

    Parameters
    ----------
    kind : 'rest', 'stayed', 'died' or 'grew'
        Rest; motion that remained; motion that returned to rest; growth out of rest, unkicked.
    source : str
    start_ns, end_ns : int
    speed_low, speed_high : float
        Speeds it was seen at, m/s; of what stayed and then died with the speed falling only
        those at which it stayed.
    amplitude : float
        Root of the mean square of rest, median of what stayed, largest of what died, m.
    kick : float
        Amplitude right after the kick that began it, m; NaN for none.
    spread : (float, float)
        Smallest and largest amplitude meanwhile, m.
    undamped : float
        Of rest: amplitude, root of its mean square, that motion without damping exceeds in 99 of
        100 cases under the forcing that is seen there, m; NaN else.
    """

    kind: Kind
    source: str
    start_ns: int
    end_ns: int
    speed_low: float = field(metadata=key(''))
    speed_high: float = field(metadata=key(''))
    amplitude: float = field(metadata=key('amplitude_m'))
    kick: float = field(default=math.nan, metadata=key('kick_m'))
    spread: tuple[float, float] = field(default=(math.nan, math.nan), metadata=key(''))
    undamped: float = field(default=math.nan, metadata=key('undamped_m'))

    @property
    def seconds(self) -> float:
        """How long it was seen."""
        return (self.end_ns - self.start_ns) / 1e9

    @property
    def damped(self) -> bool:
        """Whether it is rest that without damping would have grown larger."""
        return self.amplitude < self.undamped

    @property
    def speed(self) -> float:
        """Middle of its speeds, m/s."""
        return 0.5 * (self.speed_low + self.speed_high)

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `bracket.events`."""
        return {**as_json(self), 'speed_mps': [self.speed_low, self.speed_high]}


def _is_one(speed: Array) -> bool:
    """Whether all speeds are one."""
    return bool(np.ptp(speed) < ONE_SPEED * speed[0])


def _since(speed: Array) -> int:
    """Return the first instant from which on the speed was what it is at the end."""
    other = np.flatnonzero(np.abs(speed / speed[-1] - 1.0) >= ONE_SPEED)
    return int(other[-1]) + 1 if other.size else 0


@dataclass(frozen=True, eq=False)
class _Piece:
    """A stretch of an envelope without a gap: amplitude (m) and speed at its instants."""

    source: str
    stamp: NDArray[np.int64]
    time: Array
    amplitude: Array
    speed: Array
    struck: Mask
    period: float
    phasor: NDArray[np.complex128]
    noise: Array

    def event(self, kind: Kind, a: int, b: int, size: float, kick: float = math.nan) -> Event:
        """Return what was seen from instant a to instant b."""
        v, seen = self.speed[a : b + 1], self.amplitude[a : b + 1]
        spread = float(seen.min()), float(seen.max())
        low, high = float(v.min()), float(v.max())
        begun, ended = int(self.stamp[a]), int(self.stamp[b])
        return Event(kind, self.source, begun, ended, low, high, size, kick, spread)

    def was_kicked(self, settled: int, begin: int, top: int) -> bool:
        """Whether a motion out of rest began faster than the rest before it can have grown."""
        if self.struck[begin : top + 1].any():
            return True
        since = max(_since(self.speed[: begin + 1]), settled)
        rested = float(self.time[begin] - self.time[since])
        if rested < _REST_CYCLES * self.period / 3.0:
            return False
        quiet = float(np.median(self.amplitude[since : begin + 1]))
        allowed = math.log(self.amplitude[top] / quiet) / rested
        took = max(self.time[top] - self.time[begin], self.period)
        rise = math.log(self.amplitude[top] / self.amplitude[begin]) / took
        # A step of what noise does from one instant to the next is no kick.
        return bool(self.amplitude[top] > ABOVE_NOISE * quiet and rise > _FASTER * allowed)

    def undamped(self, a: int, b: int) -> float:
        """
        Amplitude that motion without damping exceeds from instant a to b, 99 of 100 times, m.

        With growth, or from a start that is not zero, it exceeds it the more. Its forcing is what
        moves it from one instant to the next beyond what noise does: of damped motion less.
        """
        z = self.phasor[a : b + 1]
        turn = np.sum(z[1:] * z[:-1].conj())
        moved = np.abs(z[1:] * turn.conj() / max(abs(turn), 1e-300) - z[:-1]) ** 2
        noise = 4.0 * (1.0 - WINDOW_OVERLAP) * float(np.median(self.noise[a : b + 1])) ** 2
        # Of a random walk two windows that overlap show less than their middles are apart.
        shown = 1.0 - 0.5 * WINDOW_CYCLES * WINDOW_REACH / STEP_CYCLES
        push = max(float(np.mean(moved)) - noise, 0.0) / shown
        return math.sqrt(_UNDAMPED * 0.5 * push * moved.size)

    def rests(self, a: int, last: int) -> list[Event]:
        """Return rest, speed by speed: where it was seen for long enough at one of them."""
        found = []
        while a <= last:
            inside = np.abs(self.speed[a : last + 1] / self.speed[a] - 1.0) < ONE_SPEED
            b = a + (int(np.argmin(inside)) if not inside.all() else inside.size) - 1
            half = (a + b + 1) // 2
            if self.time[b] - self.time[a] >= (_REST_CYCLES - WINDOW_CYCLES) * self.period:
                # Rest that swells is growth that has not come far: a ratio of two mean powers,
                # of which one window in four is independent, for the mode remembers some cycles.
                powers = [
                    float(np.mean(x**2))
                    for x in (self.amplitude[a:half], self.amplitude[half : b + 1])
                ]
                freedom = 0.5 * (b + 1 - half), 0.5 * (half - a)
                if stats.f.sf(powers[1] / powers[0], *freedom) >= 0.01:
                    size = math.sqrt(float(np.mean(self.amplitude[a : b + 1] ** 2)))
                    seen = self.event('rest', a, b, size)
                    found.append(replace(seen, undamped=self.undamped(a, b)))
            a = b + 1
        return found

    def motion(self, begin: int, end: int, kick: float) -> list[Event]:
        """Return whether a motion died, stayed, or stayed until the speed had fallen."""
        died = end < self.amplitude.size - 1
        alive = self.amplitude[begin : end + 1]
        if died and _is_one(self.speed[begin : end + 1]):
            return [self.event('died', begin, end, float(alive.max()), kick)]
        large = begin + np.flatnonzero(alive >= 0.5 * float(np.median(alive)))
        first, fall, least = int(large[0]), end, _STAY_CYCLES * self.period
        if died:
            # Where the fall began: the last instant at half of what the motion was before.
            fall = int(large[large < end][-1])
            # At its end it dies as small motion does.
            middle = math.sqrt(self.amplitude[fall] * self.amplitude[end])
            half = fall + int(np.flatnonzero(self.amplitude[fall:end] >= middle)[-1])
            decays = math.log(self.amplitude[half] / self.amplitude[end])
            least = max(least, _STAY_DECAYS * float(self.time[end] - self.time[half]) / decays)
        # What was there for long after an instant, at no higher speed, stayed at that speed.
        far = np.searchsorted(self.time, self.time[first : fall + 1] + least)
        stays = [
            (k, int(m))
            for k, m in zip(range(first, fall + 1), far, strict=True)
            if m <= fall and self.speed[k : m + 1].max() <= (1.0 + 0.5 * ONE_SPEED) * self.speed[k]
        ]
        found: list[Event] = []
        if died:
            # What died at a speed did not stay there.
            there = (1.0 + ONE_SPEED) * float(self.speed[fall : end + 1].max())
            stays = [pair for pair in stays if self.speed[pair[0]] > there]
        if stays:
            lowest, until = min(stays, key=lambda ends: (self.speed[ends[0]], -ends[0]))
            kept = self.amplitude[lowest : until + 1]
            if float(np.std(np.log(kept))) > _SCATTER:
                return []
            size = float(np.median(kept))
            stayed = self.event('stayed', stays[0][0], stays[-1][0], size, kick)
            whole = self.event('stayed', lowest, stays[-1][1], size)
            # A speed that it passed and came back from, it did not stay at.
            low = float(self.speed[lowest])
            found.append(replace(stayed, end_ns=whole.end_ns, spread=whole.spread, speed_low=low))
            if died:
                # What was a limit cycle, and died as the speed fell, left it where it ends.
                found.append(self.event('died', fall, end, size))
        return found

    def events(self, rest: float, large: float) -> list[Event]:
        """Return motion out of rest of median `rest`, m, beyond `large` or kicked, and rest."""
        amplitude, time, speed, struck = self.amplitude, self.time, self.speed, self.struck
        small = math.sqrt(rest * large)
        excursions = []
        for a, b in runs(amplitude > small):
            begin, end, size = max(a - 1, 0), min(b, amplitude.size - 1), amplitude[a:b].max()
            # A kick that died before it came so far is no rest, and no hunting.
            kicked = struck[a:b].any() and size > ABOVE_NOISE * rest
            if size > large or (kicked and b < amplitude.size and _is_one(speed[a : end + 1])):
                excursions.append((begin, end))
        found: list[Event] = []
        settled = 0
        for begin, end in excursions:
            last, kick = begin - 1, math.nan
            if begin > 0:
                alive = amplitude[begin : end + 1]
                top = begin + int(np.argmax(alive > (large if alive.max() > large else small)))
                # No law grows out of rest and returns to it at one speed.
                pushed = end < amplitude.size - 1 and _is_one(speed[begin : end + 1])
                if pushed or self.was_kicked(settled, begin, top):
                    kick = float(amplitude[top : min(top + 1, end) + 1].max())
                else:
                    rate = math.log(amplitude[top] / amplitude[begin]) / (time[top] - time[begin])
                    since = _GREW_SINCE * math.log(large / rest) / max(rate, 1e-9)
                    last = int(np.searchsorted(time, time[top] - since)) - 1
                    last = min(last, _since(speed[: begin + 1]) - 1)
                    found.append(self.event('grew', begin, top, float(amplitude[top])))
            found += self.rests(settled, last)
            found += self.motion(begin, end, kick)
            settled = end + 1
        return found + self.rests(settled, amplitude.size - 1)


def events_of(
    envelope: Envelope, struck: Mask, levels: tuple[float, float, float]
) -> Iterator[Event]:
    """
    Yield what an envelope shows: motion out of rest, and the rest between.

    Parameters
    ----------
    envelope : Envelope
        Of one recording.
    struck : ndarray of bool, shape (n,)
        Instants whose windows hold a kick.
    levels : (float, float, float)
        Amplitudes, m: median of rest, smallest motion out of it, largest that lasts; infinite
        where all amplitudes are of one kind.
    """
    rest, large, top = levels
    # Small beside a line of such a size is what hunting of its frequency is that went with it.
    hidden = (envelope.amplitude <= large) & (envelope.line_power > (SMALLEST * top) ** 2)
    known = np.flatnonzero(np.isfinite(envelope.amplitude) & ~hidden)
    period = 1.0 / float(np.median(envelope.frequency))
    stamp = envelope.start_ns + np.round(1e9 * envelope.time).astype(np.int64)
    other = np.nan_to_num(envelope.residual)
    beside = (envelope.amplitude <= large) & (other > SMALLEST * top)
    amplitude = np.where(beside, other, envelope.amplitude)
    # A gap of more than two windows parts what was seen.
    gaps = np.flatnonzero(np.diff(envelope.time[known]) > 2.0 * WINDOW_CYCLES * period) + 1
    for part in np.split(known, gaps):
        if part.size > 1:
            seen = _Piece(
                envelope.source,
                stamp[part],
                envelope.time[part],
                amplitude[part],
                envelope.speed[part],
                struck[part],
                period,
                envelope.phasor[part],
                envelope.noise[part],
            )
            yield from seen.events(rest, large)
