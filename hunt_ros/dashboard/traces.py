"""
The signal of one channel as it is drawn: the least and the greatest value of short intervals.

A page draws about a thousand points in a line, of twenty thousand samples or more. Of each
interval the extremes are kept, so no peak is lost, however short. The samples themselves are
kept for the spectrum.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dashboard.view import Row, Rows
from hunt_ros.samples import CLOCK_RESET_NS, NANOSECONDS

#: What is shown of the signal, s.
SHOWN_S = 20.0
#: An interval, ns: 1000 of them are shown.
_INTERVAL_NS = 20_000_000
#: A longer silence breaks the line, in intervals.
_GAP = 10


class Trace:
    """
    One channel.

    Parameters
    ----------
    scale : float
        From SI to the unit of the page.
    """

    def __init__(self, scale: float) -> None:
        self._scale = scale
        self.rows = Rows(round(SHOWN_S * NANOSECONDS / _INTERVAL_NS))
        self._open: tuple[int, float, float] | None = None
        self._blocks: deque[tuple[NDArray[np.int64], NDArray[np.float64]]] = deque()

    def append(self, stamps_ns: NDArray[np.int64], values: NDArray[np.float64]) -> None:
        """
        Take samples, in the order in which they came; those that are not finite are left out.

        Parameters
        ----------
        stamps_ns, values : ndarray, shape (n,)
            Header stamps, and values in SI units. A stamp that lies before the interval that
            is open is left out.
        """
        begin_ns = np.iinfo(np.int64).min if self._open is None else self._open[0] * _INTERVAL_NS
        if stamps_ns.size and stamps_ns[-1] + CLOCK_RESET_NS < begin_ns:
            self.clear()  # a clock that was set back, or one stamp that was far ahead of it
            begin_ns = int(stamps_ns[0])
        good = np.isfinite(values) & (stamps_ns >= begin_ns)
        if not good.all():
            stamps_ns, values = stamps_ns[good], values[good]
        if not stamps_ns.size:
            return
        self._blocks.append((stamps_ns, values))
        # Here, and not where they are asked for: a channel may never be.
        oldest_ns = int(stamps_ns[-1]) - round(SHOWN_S * NANOSECONDS)
        while self._blocks[0][0][-1] < oldest_ns:
            self._blocks.popleft()
        interval = np.maximum.accumulate(stamps_ns // _INTERVAL_NS)
        starts = np.flatnonzero(np.diff(interval, prepend=interval[0] - 1))
        low = np.minimum.reduceat(values, starts).tolist()
        high = np.maximum.reduceat(values, starts).tolist()
        closed = []
        for number, least, most in zip(interval[starts].tolist(), low, high, strict=True):
            if self._open is not None and self._open[0] == number:
                least, most = min(least, self._open[1]), max(most, self._open[2])
            elif self._open is not None:
                closed += self._closed(number)
            self._open = number, least, most
        self.rows.append(closed)

    def clear(self) -> None:
        """Forget everything: a clock was set back."""
        self.rows.replace(())
        self._open = None
        self._blocks.clear()

    def samples(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the samples of the time that is shown: stamps in ns, values in SI units."""
        if not self._blocks:
            return np.zeros(0, dtype=np.int64), np.zeros(0)
        stamps_ns = np.concatenate([stamps for stamps, _ in self._blocks])
        values = np.concatenate([values for _, values in self._blocks])
        kept = stamps_ns > stamps_ns[-1] - round(SHOWN_S * NANOSECONDS)
        return stamps_ns[kept], values[kept]

    def _closed(self, following: int) -> list[Row]:
        """Return the interval that is open as a row, and a break where a long silence follows."""
        assert self._open is not None
        number, least, most = self._open
        second = number * _INTERVAL_NS / NANOSECONDS
        rows: list[Row] = [(second, short(self._scale * least), short(self._scale * most))]
        if following - number > _GAP:
            rows.append((second + _INTERVAL_NS / NANOSECONDS, None, None))
        return rows


def short(value: float) -> float | None:
    """Return a number with the digits that a picture shows; None where it is not finite."""
    return float(f'{value:.4g}') if math.isfinite(value) else None
