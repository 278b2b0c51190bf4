"""
The rows of the estimates: a grid of stamps, and what the slow channels say at any stamp.

Rows lie on whole multiples of the output period, whatever the samples' stamps
are, so that they do not depend on when the stream began or how it was cut.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import F1, I1, R1, compiled, compiled_part

_Stamps = NDArray[np.int64]
_Values = NDArray[np.float64]

#: Stands for the stamp of a sample that there is not.
_NEVER = -(2**62)


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
        True for an angle, which goes on at its last rate. A reading that repeats the one
        before says nothing then: the encoder is coarse, or it is stuck.

    Attributes
    ----------
    within : ndarray of float64, shape (n,)
        How far the values of the last call may be off, since the change of a reading that was
        repeated lies anywhere between two samples; 0 where no reading is repeated.
    """

    def __init__(self, timeout_ns: int, rising: bool) -> None:
        self._timeout = timeout_ns
        self._rising = rising
        self._whole = np.zeros(3, dtype=np.int64)
        self._real = np.array([math.nan, math.nan, 0.0, 0.0])
        self.within = np.zeros(0)

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
        found, self.within = np.empty(wanted_ns.size), np.zeros(wanted_ns.size)
        after_ns, after = (_NEVER, math.nan) if following is None else following
        _evaluate(
            wanted_ns,
            stamps_ns,
            values,
            after_ns,
            after,
            self._timeout,
            self._rising,
            self._whole,
            self._real,
            found,
            self.within,
        )
        return found


@compiled
def _evaluate(
    wanted: I1,
    stamps: I1,
    values: R1,
    after_stamp: int,
    after: float,
    timeout: int,
    rising: bool,
    whole: I1,
    real: F1,
    found: F1,
    within: F1,
) -> None:
    """
    Run `SlowChannel.at`.

    whole = [stamp of the last sample, of the last valid one, and of the last repeat]; real =
    [value of the last sample (NaN: invalid), and of the last valid one, rate of the last line,
    how far its end may be off].
    """
    n = 0
    for k in range(wanted.size):
        stamp = wanted[k]
        while n < stamps.size and stamps[n] <= stamp:
            _take(stamps[n], values[n], timeout, rising, whole, real)
            n += 1
        within[k] = real[3]
        end, value = after_stamp, after
        if n < stamps.size:
            end, value = stamps[n], values[n]
        step = end - whole[0]
        known = np.isfinite(value) and np.isfinite(real[0]) and not (rising and value == real[0])
        if known and 0 < step <= timeout:
            slope = (value - real[0]) / (step * 1e-9)
            found[k] = real[0] + slope * ((stamp - whole[0]) * 1e-9)
            continue
        age = stamp - whole[1]
        found[k] = np.nan
        if age <= timeout:
            found[k] = real[1] + (real[2] * (age * 1e-9) if rising else 0.0)
    while n < stamps.size:
        _take(stamps[n], values[n], timeout, rising, whole, real)
        n += 1


@compiled_part
def _take(
    stamp: int, value: float, timeout: int, rising: bool, whole: _Stamps, real: _Values
) -> None:
    """Take one sample."""
    if rising and value == real[0]:
        whole[2] = stamp
        return
    if not np.isfinite(value):
        whole[0], real[0] = stamp, np.nan
        return
    step = stamp - whole[0]
    if 0 < step <= timeout and np.isfinite(real[0]):
        real[2] = (value - real[0]) / (step * 1e-9)
        late = stamp - whole[2] if whole[2] > whole[0] else 0
        real[3] = abs(real[2]) * (late * 1e-9)
    whole[0] = whole[1] = stamp
    real[0] = real[1] = value
