"""
The rows of the estimates: a grid of stamps, and what the slow channels say at any stamp.

Rows lie on whole multiples of the output period, whatever the samples' stamps
are, so that they do not depend on when the stream began or how it was cut.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_Stamps = NDArray[np.int64]
_Values = NDArray[np.float64]


class RowGrid:
    """
    Grid stamps, leaving out long silence.

    Parameters
    ----------
    period_ns : int
        Spacing of the rows.
    drain_ns : int
        Silence of all channels after which no row is made until the next sample.
    """

    def __init__(self, period_ns: int, drain_ns: int) -> None:
        self._period = period_ns
        self._drain = drain_ns
        self._newest_ns: int | None = None  # newest sample so far

    def rows(self, after_ns: int | None, until_ns: int, sample_ns: _Stamps) -> _Stamps:
        """
        Return the grid stamps in (after_ns, until_ns] that follow a sample closely enough.

        Parameters
        ----------
        after_ns : int or None
            Last row made; None at the beginning.
        until_ns : int
            A grid stamp.
        sample_ns : ndarray of int64, shape (n,)
            Sorted stamps of all samples in (after_ns, until_ns].

        Returns
        -------
        ndarray of int64, shape (m,)
        """
        if self._newest_ns is None and not sample_ns.size:
            return np.zeros(0, dtype=np.int64)
        newest = int(sample_ns[0]) if self._newest_ns is None else self._newest_ns
        marks = np.concatenate(([newest], sample_ns))
        if sample_ns.size:
            self._newest_ns = int(sample_ns[-1])
        begin = newest - 1 if after_ns is None else after_ns
        # Stretches between long silences: each reaches `drain` beyond its last sample.
        breaks = np.flatnonzero(np.diff(marks) > self._drain)
        starts = [begin, *(int(marks[k + 1]) - 1 for k in breaks)]
        ends = [*(int(marks[k]) + self._drain for k in breaks), int(marks[-1]) + self._drain]
        parts = []
        for start, end in zip(starts, ends, strict=True):
            first = max(start, begin) // self._period + 1
            last = min(end, until_ns) // self._period
            parts.append(np.arange(first, last + 1, dtype=np.int64) * self._period)
        return np.concatenate(parts)

    def reset(self) -> None:
        """Begin anew."""
        self._newest_ns = None


class SlowChannel:
    """
    Value of a slow channel (speed, roller angle) at any stamp.

    Straight lines between neighbouring samples that are valid and not further
    apart than the timeout; otherwise the last valid value, moved on by the last
    slope if `rising`. NaN once it is older than the timeout.

    Parameters
    ----------
    timeout_ns : int
        Of the channel.
    rising : bool
        True for an angle, which goes on at its last rate.
    """

    def __init__(self, timeout_ns: int, rising: bool) -> None:
        self._timeout = timeout_ns
        self._rising = rising
        self.reset()

    def reset(self) -> None:
        """Forget every sample."""
        self._stamp = 0
        self._value = math.nan  # last sample, valid or not
        self._valid_stamp = 0
        self._valid = math.nan
        self._rate = 0.0

    def at(
        self,
        wanted_ns: _Stamps,
        stamps_ns: _Stamps,
        values: _Values,
        following: tuple[int, float] | None,
    ) -> _Values:
        """
        Evaluate, and take the samples in.

        Parameters
        ----------
        wanted_ns : ndarray of int64, shape (n,)
            Sorted stamps, none before those of earlier calls.
        stamps_ns, values : ndarray, shape (m,)
            New samples up to the last wanted stamp; invalid ones as NaN.
        following : tuple of (int, float), optional
            The sample after these.

        Returns
        -------
        ndarray of float64, shape (n,)
        """
        ends = () if following is None else (following,)
        t = np.array([self._stamp, *(stamp for stamp, _ in ends)], dtype=np.int64)
        x = np.array([self._value, *(value for _, value in ends)], dtype=np.float64)
        t, x = np.insert(t, 1, stamps_ns), np.insert(x, 1, values)
        x[~np.isfinite(x)] = math.nan
        step = np.diff(t)
        with np.errstate(divide='ignore', invalid='ignore'):
            slope = np.where((step > 0) & (step <= self._timeout), np.diff(x) / (step * 1e-9), 0.0)
        joined = np.isfinite(slope) & (step > 0) & (step <= self._timeout)
        known = stamps_ns.size + 1  # samples that lie behind, the carried one included
        valid = np.where(np.isfinite(x[:known]), np.arange(known), -1)
        valid = np.maximum.accumulate(valid)
        rate = self._rates(slope, joined, valid)
        left = np.searchsorted(t[:known], wanted_ns, side='right') - 1
        left = np.maximum(left, 0)
        behind = valid[left]
        old = behind < 0
        anchor_t = np.where(old, self._valid_stamp, t[behind])
        anchor_x = np.where(old, self._valid, x[behind])
        anchor_rate = np.where(old, self._rate, rate[behind])
        age = wanted_ns - anchor_t
        held = anchor_x + (anchor_rate * (age * 1e-9) if self._rising else 0.0)
        held[age > self._timeout] = math.nan
        line = np.zeros(wanted_ns.size, dtype=bool)
        inside = left < joined.size
        line[inside] = joined[left[inside]]
        at_left = np.minimum(left, slope.size - 1) if slope.size else left
        straight = x[left] + (slope[at_left] if slope.size else 0.0) * (
            (wanted_ns - t[left]) * 1e-9
        )
        result: _Values = np.where(line, straight, held)
        self._keep(t, x, valid, rate, known)
        return result

    def _rates(
        self, slope: _Values, joined: NDArray[np.bool_], valid: NDArray[np.int64]
    ) -> _Values:
        """Rate behind each sample: of the line that ends there, else the one before it."""
        rate = np.empty(valid.size)
        rate[0] = self._rate
        ends = np.where(joined[: valid.size - 1], np.arange(1, valid.size), 0)
        latest = np.maximum.accumulate(ends) if ends.size else ends
        rate[1:] = np.where(latest > 0, slope[np.maximum(latest, 1) - 1], self._rate)
        return rate

    def _keep(
        self, t: _Stamps, x: _Values, valid: NDArray[np.int64], rate: _Values, known: int
    ) -> None:
        self._stamp, self._value = int(t[known - 1]), float(x[known - 1])
        at = int(valid[known - 1])
        if at >= 0:
            self._valid_stamp, self._valid = int(t[at]), float(x[at])
        self._rate = float(rate[known - 1])
