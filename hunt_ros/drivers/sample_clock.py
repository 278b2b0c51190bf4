"""
Stamps from the clock of a device: its counts or stamps, disciplined to the clock of the host.

A sample arrives some time after it was taken: a delay that is never negative, and now and then
long, when Python wakes late. So what the host knows of the device's clock is the line below all
arrivals that comes closest to them (Moon, Skelly and Towsley 1999, "Estimation and removal of
clock skew from network delay measurements", INFOCOM): late arrivals do not move it. What is left
is the shortest delay, which no device can be asked for.
"""

from __future__ import annotations

import time
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.samples import NANOSECONDS

#: What is older is forgotten, ns: drift that changes within it is averaged. Of each part of it the
#: earliest arrival is kept.
_WINDOW_NS, _PARTS = 30 * NANOSECONDS, 32
#: The true length of a tick is within this fraction of the nominal one. Wide: who expects another
#: rate than the device has shall see it in the stamps.
_TOLERANCE = 0.5
_ENDS = np.array([-1.0, 1.0])


class _Arrival(NamedTuple):
    """A tick of the device and when the host knew of it, steady clock."""

    tick: int
    arrived_ns: int


class SampleClock:
    """
    Turns ticks of a device into stamps of the host.

    Parameters
    ----------
    tick_s : float
        Nominal length of a tick, s: the sample period where the ticks are sample numbers, 1e-9
        where they are stamps in ns.

    The line is kept on the steady clock of the host: a host clock that is set moves the stamps at
    once and by as much.
    """

    def __init__(self, tick_s: float) -> None:
        self._nominal_ns = tick_s * NANOSECONDS
        self.reset()

    def reset(self) -> None:
        """Forget all; as new."""
        self._arrivals: deque[_Arrival] = deque()  # the earliest of each part of the window
        self._slope_ns = self._nominal_ns
        self._base = _Arrival(0, 0)  # a point of the line
        self._last: _Arrival | None = None  # tick and stamp given last, steady clock

    def stamps(self, ticks: ArrayLike, arrived_ns: int | None = None) -> NDArray[np.int64]:
        """
        Return when samples were taken, ns, on the host's clock; later for each one.

        Parameters
        ----------
        ticks : array_like of int64, shape (n,)
            Increasing, without wrap-around (`Counter` unwraps); lost samples leave a gap. Ticks
            that begin again below the last ones mean that the device was started anew.
        arrived_ns : int, optional
            When the last of them was there, steady clock; default: now.
        """
        counts = np.asarray(ticks, dtype=np.int64)
        if not counts.size:
            return np.zeros(0, dtype=np.int64)
        if arrived_ns is None:
            arrived_ns = time.monotonic_ns()
        if self._last is not None and counts[0] <= self._last.tick:
            self.reset()
        self._note(_Arrival(int(counts[-1]), arrived_ns))
        steady = self._base.arrived_ns + np.rint(
            (counts - self._base.tick) * self._slope_ns
        ).astype(np.int64)
        if self._last is not None:
            # The line fell when a sample came with less delay than any before: it is approached
            # at twice the pace, and no stamp goes backwards.
            passed = (counts - self._last.tick) * (0.5 * self._slope_ns)
            least = self._last.arrived_ns + np.maximum(np.rint(passed), 1).astype(np.int64)
            steady = np.maximum(steady, least)
        self._last = _Arrival(int(counts[-1]), int(steady[-1]))
        return np.asarray(steady + host_less_steady_ns(), dtype=np.int64)

    def _note(self, arrival: _Arrival) -> None:
        """Take an arrival into the window, and draw the line anew where it counts."""
        kept = self._arrivals
        part_ns = _WINDOW_NS // _PARTS
        if kept and arrival.arrived_ns // part_ns == kept[-1].arrived_ns // part_ns:
            if self._delay_ns(arrival) >= self._delay_ns(kept[-1]):
                return
            kept.pop()
        kept.append(arrival)
        while arrival.arrived_ns - kept[0].arrived_ns > _WINDOW_NS:
            kept.popleft()
        self._draw()

    def _delay_ns(self, arrival: _Arrival) -> float:
        """Return how far an arrival is above the line."""
        ahead = (arrival.tick - self._base.tick) * self._slope_ns
        return arrival.arrived_ns - self._base.arrived_ns - ahead

    def _draw(self) -> None:
        """
        Lay the line below all arrivals, with the least mean distance.

        The part of the window that has just begun counts for its height, not for its slope: it may
        hold one late arrival and nothing else.
        """
        if len(self._arrivals) > 2:
            closed = list(self._arrivals)[:-1]
            ticks, arrived = np.array(closed).T - np.array([closed[0]]).T
            earlier, later = np.triu_indices(ticks.size, 1)
            slopes = (arrived[later] - arrived[earlier]) / (ticks[later] - ticks[earlier])
            slopes = np.clip(slopes, *(self._nominal_ns * (1.0 + _TOLERANCE * _ENDS)))
            # How high the line of each slope that is below all of them is in their middle.
            below = (arrived - np.outer(slopes, ticks - ticks.mean())).min(axis=1)
            self._slope_ns = float(slopes[below.argmax()])
        self._base = min(self._arrivals, key=self._delay_ns)


def host_less_steady_ns() -> int:
    """Return host clock less steady clock, ns: of three readings the least disturbed."""
    readings = []
    for _ in range(3):
        before, host, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        readings.append((after - before, host - (before + after) // 2))
    return min(readings)[1]


class Counter:
    """
    Makes a counter continuous that wraps around.

    Parameters
    ----------
    bits : int
        Width of the counter. It is taken to have gone the shorter way between two readings, so
        it must be read before it has gone half around.
    """

    def __init__(self, bits: int) -> None:
        self._size = 1 << bits
        self._last: int | None = None  # continuous

    def unwrap(self, raw: int) -> int:
        """Return the continuous count; the first reading ever is taken as it is."""
        last, half = raw if self._last is None else self._last, self._size // 2
        self._last = last + (raw - last + half) % self._size - half
        return self._last
