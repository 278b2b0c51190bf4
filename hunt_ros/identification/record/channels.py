"""One record on the time of its lateral samples, in order and without repeats."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.errors import IdentificationError
from hunt_ros.samples import NANOSECONDS, Record, Series, smallest_step

#: Steps of speed readings below this share of the speed are averaged out by its own noise; of this
#: share or more they are levels that somebody told.
_FINE_STEP, _LARGEST_STEP = 1e-3, 0.012
#: A reading that stands so many times longer than those beside it is that of a hold; one that
#: stands for less than so much of what is usual is on the way to another one.
_HOLD, _BRIEF = 3.0, 0.25
#: Means over blocks of a record in a cycle of the hunting, at least.
_SAMPLES = 40.0


@dataclass(frozen=True, eq=False)
class Channels:
    """
    One record on the time of its lateral samples.

    Parameters
    ----------
    time, lateral, speed, roller : ndarray, shape (n,)
        s, m, m/s, rad, speed and roller without the direction of travel; lateral NaN where a
        sample dropped out, roller empty without roller.
    rate_hz : float
        Sample rate by the median spacing.
    yaw : Channels or None
        The same on the time of its yaw samples, which are its `lateral`, rad.
    """

    source: str
    start_ns: int
    time: NDArray[np.float64]
    lateral: NDArray[np.float64]
    speed: NDArray[np.float64]
    roller: NDArray[np.float64]
    rate_hz: float
    yaw: Channels | None = None

    def part(self, place: slice) -> Channels:
        """Return the samples of a slice; the time of the record stays."""
        names = ('time', 'lateral', 'speed', 'roller')
        parts = {name: getattr(self, name)[place] for name in names}
        return replace(self, **parts)

    def averaged(self, frequency_hz: float) -> Channels:
        """
        Return means over blocks, each of a fortieth of a cycle at most.

        A mean over a block makes a sinusoid smaller by sinc(f T); at the frequency it is made
        good. Samples that dropped out leave the mean of the others, if these are half of it.

        Parameters
        ----------
        frequency_hz : float
            Of the hunting, Hz.
        """
        count = int(self.rate_hz / (_SAMPLES * frequency_hz))
        yaw = self.yaw and self.yaw.averaged(frequency_hz)
        if count < 2:
            return replace(self, yaw=yaw)
        blocks = self.time.size // count

        def means(values: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
            """Return weighted means over the blocks, shape (blocks,)."""
            parts = values[: blocks * count].reshape(blocks, count)
            mean: NDArray[np.float64] = np.average(parts, axis=1, weights=weight)
            return mean

        known = np.isfinite(self.lateral[: blocks * count]).reshape(blocks, count)
        # One across a gap is none.
        first, last = self.time[: blocks * count].reshape(blocks, count).T[[0, -1]]
        told = (2 * known.sum(axis=1) >= count) & (last - first < 1.5 * count / self.rate_hz)
        weight = np.where(told[:, None], known, 1.0)
        lateral = means(np.nan_to_num(self.lateral), weight)
        loss = np.sinc(frequency_hz * count / self.rate_hz)
        return replace(
            self,
            time=means(self.time, weight),
            lateral=np.where(told, lateral / loss, np.nan),
            speed=means(self.speed, weight),
            roller=means(self.roller, weight) if self.roller.size else self.roller,
            rate_hz=self.rate_hz / count,
            yaw=yaw,
        )

    def with_yaw(self, record: Record) -> Channels:
        """Return it with the yaw samples that its record has in the same time."""
        start, end = (self.start_ns + round(NANOSECONDS * at) for at in self.time[[0, -1]])
        yaw = record['yaw'].finite().between(start, end) if 'yaw' in record else None
        if yaw is None or len(yaw) < 50:
            return self
        time = yaw.seconds(self.start_ns)
        speed = np.interp(time, self.time, self.speed)
        roller = np.interp(time, self.time, self.roller) if self.roller.size else self.roller
        own = replace(
            self, time=time, lateral=yaw.values, speed=speed, roller=roller, rate_hz=yaw.rate_hz
        )
        return replace(self, yaw=own)


def refuse(bad: bool, name: str, words: str) -> None:
    """
    Refuse a recording.

    Raises
    ------
    IdentificationError
        If it is bad.
    """
    if bad:
        raise IdentificationError(f'{name}: {words}')


def speed_step(speed: Series) -> float:
    """
    Return the step of coarse speed readings, m/s; 0 where their own noise averages it out.

    Readings further apart than `_LARGEST_STEP` are levels that somebody told.
    """
    values = speed.finite().values
    step, highest = smallest_step(values), float(np.abs(values).max(initial=0.0))
    return step if _FINE_STEP * highest < step < _LARGEST_STEP * highest else 0.0


def between_steps(
    time: NDArray[np.float64], speed: NDArray[np.float64], step: float
) -> NDArray[np.float64]:
    """
    Return the speed behind readings in steps, m/s: it passes evenly what they step through.

    A reading that stands for much longer than those beside it is that of a hold, and stays.
    """
    first = np.flatnonzero(np.diff(speed, prepend=math.nan))
    begin, end = time[first], time[np.append(first[1:], speed.size) - 1]
    # Where it passes from one to the next it may waver.
    longest = np.sort(end - begin)[::-1]
    usual = longest[np.searchsorted(np.cumsum(longest), 0.5 * longest.sum())]
    stands = np.flatnonzero(end - begin >= _BRIEF * usual)
    begin, end, level = begin[stands], end[stands], speed[first[stands]]
    other = np.flatnonzero(np.diff(level, prepend=math.nan))
    begin, end, level = begin[other], end[np.append(other[1:], level.size) - 1], level[other]
    passes, rises = 0.5 * (end[:-1] + begin[1:]), np.diff(level)
    lasts = np.diff(passes, prepend=time[0], append=time[-1])
    found: NDArray[np.float64] = speed.copy()
    for k, rise in enumerate(rises[1:], start=1):
        near = max(abs(rise), abs(rises[k - 1])) < 1.5 * step and rise * rises[k - 1] > 0.0
        if near and lasts[k] <= _HOLD * min(lasts[k - 1], lasts[k + 1]):
            inside = slice(*np.searchsorted(time, passes[k - 1 : k + 1]))
            ends = level[k] - 0.5 * rises[k - 1], level[k] + 0.5 * rise
            found[inside] = np.interp(time[inside], passes[k - 1 : k + 1], ends)
    return found


def channels_of(record: Record) -> Channels:
    """
    Bring a record, its channels in order, onto the time of its lateral samples.

    Raises
    ------
    IdentificationError
        Where lateral or speed is missing, has no finite sample, or is too short.
    """
    name = record.source or 'record'
    for channel in ('lateral', 'speed'):
        absent = channel not in record or not len(record[channel])
        refuse(absent, name, f'no channel {channel!r}, identification needs it')
        none = f'channel {channel!r} has no finite sample among {len(record[channel])}'
        refuse(not len(record[channel].finite()), name, none)
    lateral = record['lateral']
    start_ns, time, values = int(lateral.stamps_ns[0]), lateral.seconds(), lateral.values
    few = f'{time.size} lateral samples over {time[-1]:.4g} s are too few'
    refuse(time.size < 50 or time[-1] < 3.0, name, f'{few}, expected at least 50 over 3 s')
    told = record['speed'].finite()
    when, read = told.seconds(start_ns), told.values
    if step := speed_step(told):
        read = between_steps(when, read, step)
    speed = np.interp(time, when, read)
    roller = np.zeros(0)
    if 'roller' in record and np.isfinite(record['roller'].values).sum() > 10:
        angle = record['roller'].finite()
        known = angle.seconds(start_ns)
        roller = np.interp(time, known, angle.values)
        # Beyond the encoder's own samples the angle is not known, and neither is the line.
        values = np.where((time < known[0]) | (time > known[-1]), np.nan, values)
        # In reverse a wheelset hunts as it does ahead: the roller turns the other way.
        turned = np.diff(roller) * np.sign(speed[1:]) if (speed < 0.0).any() else np.diff(roller)
        # An encoder that counts down: forward is the sense of the running.
        sense = -1.0 if turned.sum() < 0.0 else 1.0
        roller = roller[0] + sense * np.concatenate([[0.0], np.cumsum(turned)])
    rate = 1.0 / float(np.median(np.diff(time)))
    return Channels(name, start_ns, time, values, np.abs(speed), roller, rate)


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and one past the last index of each stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
