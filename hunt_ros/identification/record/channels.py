"""One record on the time of its lateral samples, in order and without repeats."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.errors import IdentificationError
from hunt_ros.samples import NANOSECONDS, Record


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
    assumed : bool
        True where the roller's angle rests on a diameter that nobody gave.
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
    assumed: bool = False
    yaw: Channels | None = None

    def part(self, place: slice) -> Channels:
        """Return the samples of a slice; the time of the record stays."""
        names = ('time', 'lateral', 'speed', 'roller')
        parts = {name: getattr(self, name)[place] for name in names}
        return replace(self, **parts, rate_hz=self.rate_hz / (place.step or 1))

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
    few = f'{time.size} lateral samples over {time[-1]:.1f} s are too few'
    refuse(time.size < 50 or time[-1] < 3.0, name, f'{few}, expected at least 50 over 3 s')
    told = record['speed'].finite()
    speed = np.interp(time, told.seconds(start_ns), told.values)
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
