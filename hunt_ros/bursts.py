"""
Samples stamped when a buffer was read: found, and given the times at which they were taken.

A converter fills a buffer, and who empties it stamps all that is in it at once. The converter's
clock is even; a block arrives after its last sample was taken, now and then long after, never
before. So the time of sample i is on a line of the slope of the sample period, below the arrivals
and as high as they let it: what stays above it was late; what is higher from some sample on comes
after a loss. `drivers.sample_clock` draws the same line while samples come (Moon, Skelly and
Towsley 1999, "Estimation and removal of clock skew from network delay measurements", INFOCOM).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.samples import NANOSECONDS, Series

#: Samples are of one block where they are nearer than this part of the mean step. Of a topic on
#: which each sample comes twice half are; where this share is, they are blocks of three and more.
_TOGETHER, _SHARE = 0.5, 0.6
#: Nothing comes for so long: no buffer, but a pause; a stamp this far back is another clock, ns.
_PAUSE_NS = 3 * NANOSECONDS
#: The mean step is taken over this time: three pauses, so that one of them counts for little.
_MEAN_NS = 10 * NANOSECONDS
#: No delay, and no stretch between two losses, is looked at over less than so many blocks, and
#: this time, s.
_BLOCKS, _LEAST_S = 5, 0.5
#: The mean step of half of these stretches is within this share of that of the middle one:
#: the converter has a rate.
_EVEN = 0.05


@dataclass(frozen=True)
class Bursts:
    """
    How the samples of a channel were stamped, and what tells when they were taken.

    Parameters
    ----------
    ends : ndarray of int64, shape (n,)
        Place of the last sample of each block.
    arrived_ns : ndarray of int64, shape (n,)
        First stamp of each block: its last sample had been taken by then.
    step_ns : float
        Time between two samples, on average.
    apart_ns : float
        Median time between two blocks.
    even : bool
        The converter has a rate: the number of a sample tells when it was taken.
    """

    ends: NDArray[np.int64]
    arrived_ns: NDArray[np.int64]
    step_ns: float
    apart_ns: float
    even: bool

    def __str__(self) -> str:
        """Say what was found."""
        size = (self.ends[-1] + 1) / self.ends.size
        return f'samples come in bursts of {size:.0f}, {self.apart_ns / NANOSECONDS:.3g} s apart'

    @property
    def taken(self) -> str:
        """What is made of it."""
        if not self.even:
            return f'{self}, at no even rate: when each was taken is not known'
        return f'{self}, taken as sampled evenly at {NANOSECONDS / self.step_ns:.4g} Hz'


def bursts_of(
    stamps_ns: NDArray[np.int64], share: float = _SHARE, blocks: int = 4 * _BLOCKS
) -> Bursts | None:
    """
    Return how samples were stamped; None where each has a stamp of its own, or too few tell.

    Parameters
    ----------
    stamps_ns : ndarray of int64, shape (n,)
        In the order in which they came.
    share : float
        So many of them, at least, have come with the one before.
    blocks : int
        Fewest that tell.
    """
    steps = np.diff(stamps_ns)
    going = np.abs(steps) < _PAUSE_NS
    lasted, count = int(steps[going].sum()), int(np.count_nonzero(going))
    if lasted <= 0:
        return None
    mean = lasted / count
    if np.count_nonzero(np.abs(steps) < _TOGETHER * mean) <= share * steps.size:  # nearly always
        return None
    local = _smooth(np.where(going, steps, mean), round(_MEAN_NS / mean))
    apart = ~going | (np.abs(steps) >= _TOGETHER * local)
    if np.count_nonzero(~apart) <= share * steps.size or np.count_nonzero(apart) < blocks:
        return None
    begins = np.concatenate(([0], np.flatnonzero(apart) + 1))
    ends = np.append(begins[1:] - 1, stamps_ns.size - 1)
    arrived = stamps_ns[begins]
    between = float(np.median(np.diff(arrived)))
    many = min(_together(between), ends.size // 2)
    means = (arrived[many:] - arrived[:-many]) / (ends[many:] - ends[:-many])
    middle = float(np.median(means))
    even = float(np.median(np.abs(means - middle))) <= _EVEN * middle
    return Bursts(ends, arrived, middle, between, even)


def evened(columns: Mapping[str, Series]) -> tuple[dict[str, Series], list[str]]:
    """
    Give the samples of channels that come in bursts the times at which they were taken.

    Returns
    -------
    columns : dict of str to Series
        Those in even bursts spread, the others as they are.
    remarks : list of str
        On the channels that come in bursts; those that come alike share a line.
    """
    even = dict(columns)
    told: dict[str, list[str]] = {}
    for name, series in columns.items():
        found = bursts_of(series.stamps_ns)
        if found is None:
            continue
        if found.even:
            even[name] = spread(series, found)
        told.setdefault(found.taken, []).append(name)
    return even, [f'{", ".join(names)}: {text}' for text, names in told.items()]


def spread(series: Series, found: Bursts) -> Series:
    """
    Return samples with the times at which they were taken, later by the shortest delay.

    What was lost leaves a gap, where it is half a block or more.

    Parameters
    ----------
    series : Series
        Of n samples, as they came.
    found : Bursts
        Of its stamps, `even`.

    Returns
    -------
    Series
        Each later than the one before, but where a clock was set back.
    """
    from scipy.ndimage import grey_opening

    origin, many = int(found.arrived_ns[0]), _together(found.apart_ns)
    above = found.arrived_ns - origin - found.step_ns * found.ends
    pauses = np.flatnonzero(np.abs(np.diff(found.arrived_ns)) >= _PAUSE_NS) + 1
    places = np.arange(series.stamps_ns.size)
    times = found.step_ns * places
    for part in np.split(np.arange(above.size), pauses):
        # Delays that pass are taken off, by a morphological opening; what stays is a loss.
        low = grey_opening(above[part], size=min(many, part.size), mode='nearest')
        losses = np.flatnonzero(np.diff(low) > 0.5 * found.apart_ns) + 1
        for whole in np.split(np.arange(part.size), losses):
            ends = found.ends[part[whole]]
            begin = int(found.ends[part[whole[0]] - 1]) + 1 if part[whole[0]] else 0
            span = slice(begin, int(ends[-1]) + 1)
            times[span] += np.interp(places[span], ends, _smooth(low[whole], many))
    return Series(origin + np.rint(times).astype(np.int64), series.values)


def _together(apart_ns: float) -> int:
    return max(_BLOCKS, round(_LEAST_S * NANOSECONDS / max(apart_ns, 1.0)))


def _smooth(values: NDArray[np.generic], many: int) -> NDArray[np.float64]:
    """Return the mean of `many` values around each; of all where there are not more."""
    from scipy.ndimage import uniform_filter1d

    many = max(1, min(many, values.size))
    means: NDArray[np.float64] = uniform_filter1d(values.astype(np.float64), many, mode='nearest')
    return means
